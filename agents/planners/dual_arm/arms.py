"""Expressions of single arms, and functions of the robot that are composed of them by the chain rule."""

import casadi as ca

from agents.planners.common.smooth import smooth_parts
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.errors import ConfigurationError


def chains(robot: FloatingRobot) -> list[list[int]]:
    """Joints of each arm, from the base to its end-effector.

    Raises:
        ConfigurationError: if the robot is not made of arms on the base.
    """
    joints = [
        [j for j in range(robot.n_joints) if robot.carries[j, link - 1]] for link in robot.end_effector_link
    ]
    if [joint for chain in joints for joint in chain] != list(range(robot.n_joints)):
        raise ConfigurationError("the robot must be made of arms on the base, numbered one after the other")
    return joints


class ArmExpressions:
    """Contributions of one arm, as expressions of its own joints, with the base at rest.

    Attributes:
        joints: their numbers in the robot. y: [q; qdot] of these.
        kinetic: (4,) twice the kinetic energy, linear momentum. moving: (9,) linear and angular momentum
            about the base's origin, first moment of mass. end_effector: (9,) its position, velocity and axis.
    """

    def __init__(self, symbolic: SymbolicRobot, joints: list[int], end_effector: int) -> None:
        n, size = symbolic.robot.n_joints, len(joints)
        self.joints, self._symbolic = joints, symbolic
        self.y = ca.SX.sym("y", 2 * size)
        q, qdot = ca.SX(n, 1), ca.SX(n, 1)
        q[joints], qdot[joints] = self.y[:size], self.y[size:]
        rest = ca.SX(6, 1)
        momentum = symbolic.momentum(q, qdot, rest)
        energy = 2.0 * symbolic.kinetic_energy(q, qdot, rest)
        position, rotation = symbolic.end_effector_pose(end_effector)(q)
        velocity = ca.jtimes(position, self.y[:size], self.y[size:])
        self.kinetic = ca.vertcat(energy, momentum[:3])
        self.moving = ca.vertcat(momentum, self.moment(q))
        self.end_effector = ca.vertcat(position, velocity, rotation[:, 2])

    def moment(self, q: ca.SX) -> ca.SX:
        """First moment of mass (3,) of its links about the base's origin, from all joint angles (n,)."""
        links = self._symbolic.kinematics(q)[3]
        return links[:, self.joints] @ ca.DM(self._symbolic.robot.mass[1:][self.joints])


def momentum_about_com(moving: ca.SX, base: ca.DM, mass: float) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Angular momentum about the centre of mass, the centre of mass, and the linear momentum."""
    total = ca.sum2(moving)
    centre = (base + total[6:]) / mass
    return total[3:6] - ca.cross(centre, total[:3]), centre, total[:3]


def composed(
    name: str,
    outer: ca.SX,
    inner: list[tuple[ca.SX, list[ca.SX]]],
    arms: list[ArmExpressions],
    n: int,
    parameters: list[ca.SX],
) -> dict[str, ca.Function]:
    """Functions of a `Smooth` by the chain rule, with inner functions of one arm each.

    Args:
        outer: (k,) expression of the columns of the symbols in `inner` and of `parameters`.
        inner: symbols (m, arms) and the expressions of each arm for them.
    """
    q, qdot = ca.MX.sym("q", n), ca.MX.sym("qdot", n)
    given = [ca.MX.sym("p", *parameter.shape) for parameter in parameters]
    weight = ca.MX.sym("weight", outer.numel())
    z = ca.vertcat(*[ca.vec(symbol) for symbol, _ in inner])
    first, second = _outer(name, outer, z, parameters)
    values, slopes, curves = _inner(name, inner, arms, q, qdot)
    at, slope = ca.vertcat(*values), ca.vertcat(*slopes)
    result, outer_slope = first(at, *given)
    across, force = second(at, *given, weight)
    total = sum(_inner_bends(curves, force, len(arms)), slope.T @ across @ slope)
    inputs = [q, qdot, *given]
    return {
        f"{name}_value": ca.Function(f"{name}_value", inputs, [ca.densify(result)]),
        f"{name}_slope": ca.Function(f"{name}_slope", inputs, [ca.densify(outer_slope @ slope)]),
        f"{name}_bend": ca.Function(f"{name}_bend", [*inputs, weight], [ca.densify(total)]),
    }


def _outer(name: str, outer: ca.SX, z: ca.SX, parameters: list[ca.SX]) -> tuple[ca.Function, ca.Function]:
    """(z, parameters) -> outer and its Jacobian; with weights -> second derivative and gradient."""
    factor = ca.SX.sym("factor", outer.numel())
    bend, pull = ca.hessian(ca.dot(factor, outer), z)
    first = ca.Function(f"{name}_outer", [z, *parameters], [outer, ca.jacobian(outer, z)])
    return first, ca.Function(f"{name}_outer_bend", [z, *parameters, factor], [bend, pull])


def _inner(
    name: str,
    inner: list[tuple[ca.SX, list[ca.SX]]],
    arms: list[ArmExpressions],
    q: ca.MX,
    qdot: ca.MX,
) -> tuple[list[ca.MX], list[ca.MX], list[tuple[ca.Function, ca.MX]]]:
    """Values and Jacobians by [q; qdot] of the inner functions; their second derivatives with inputs."""
    values, slopes, curves = [], [], []
    for number, (_, expressions) in enumerate(inner):
        rows = []
        for arm, expression in zip(arms, expressions, strict=True):
            part = smooth_parts(f"{name}{number}_arm{arm.joints[0]}", expression, [arm.y], [])
            value, slope, curve = part.values()
            y = ca.vertcat(q[arm.joints], qdot[arm.joints])
            values.append(value(y))
            rows.append(ca.horzsplit(slope(y), len(arm.joints)))
            curves.append((curve, y))
        slopes.append(ca.horzcat(*[ca.diagcat(*side) for side in zip(*rows, strict=True)]))
    return values, slopes, curves


def _inner_bends(curves: list[tuple[ca.Function, ca.MX]], force: ca.MX, arms: int) -> list[ca.MX]:
    """Second derivatives by [q; qdot] of the inner functions, weighted by the outer gradient."""
    bends, first = [], 0
    for group in range(len(curves) // arms):
        blocks = []
        for curve, y in curves[group * arms : (group + 1) * arms]:
            size, half = curve.numel_in(1), y.numel() // 2
            blocks.append(ca.blocksplit(curve(y, force[first : first + size]), half, half))
            first += size
        sides = [[ca.diagcat(*[b[i][j] for b in blocks]) for j in (0, 1)] for i in (0, 1)]
        bends.append(ca.blockcat(sides))
    return bends
