"""A robot whose base keeps its attitude, as compiled functions with first and second derivatives.

On reactionless motion the base only translates. Places with respect to the system's centre of mass are then
functions of the joint angles, and thetadot' M* thetadot (eq. 12 of shah2013) is twice the kinetic energy
about the centre of mass of a robot with that base. Far smaller than the same of a base that turns, these
expressions are sums over the arms and products of a few vectors, which their derivatives make use of.
"""

from dataclasses import dataclass

import casadi as ca

from agents.planners.common.smooth import Smooth, smooth_parts
from space_envs.codegen.functions import compiled
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.errors import ConfigurationError


@dataclass(frozen=True, eq=False)
class HeldAttitude:
    """The functions of one robot. Vectors are in the axes of the base; d is 2 for a planar robot, else 3.

    Attributes:
        dimensions: d. turns: number r of momentum components that the joints can cause, 1 or 3.
        energy: thetadot' M* thetadot, J, on reactionless motion.
        turning: (r,) angular momentum about the centre of mass with the base at rest, N m s: Ibm~ thetadot
            of eq. 4 of shah2013.
        tilts: number of products that say how an approach axis is tilted, 4; none in the plane.
        ending: (4 d + r + tilts,) with parameter across (3, 4): end-effectors from the system's centre of
            mass (2 d) m, their velocities (2 d) m/s, `turning` (r) and the products of the approach axes with
            two columns of `across` each.
        projected: (q, u) -> rate (n), the part of u that is reactionless.
        still: (q, u, udot) -> that rate and its time derivative along the motion with it.
        places: q -> tips (6) from the system's centre of mass, axes (6) and centre of mass (3), base axes, m.
    """

    dimensions: int
    turns: int
    tilts: int
    energy: Smooth
    turning: Smooth
    ending: Smooth
    projected: ca.Function
    still: ca.Function
    places: ca.Function

    @classmethod
    def of(cls, robot: FloatingRobot) -> "HeldAttitude":
        """The functions of a robot, made at first use and kept.

        Warns:
            NoCompiledCodeWarning: if they have to run in CasADi's virtual machine, twenty times slower.
        """
        return _build(robot)


@built_once
def _build(robot: FloatingRobot) -> HeldAttitude:
    symbolic, n = SymbolicRobot(robot), robot.n_joints
    q, u, udot = (ca.SX.sym(name, n) for name in ("q", "u", "udot"))
    arms = [_Arm(symbolic, joints, tip) for tip, joints in enumerate(_chains(robot))]
    base = float(robot.mass[0]) * ca.DM(robot.com[0])
    mass = float(robot.mass.sum())

    # What is nonlinear in the joints is that of one arm alone; the rest is products of a few vectors.
    kinetic = ca.SX.sym("kinetic", 4, len(arms))  # of each arm: twice the energy, linear momentum
    linear = ca.sum2(kinetic[1:, :])
    energy = ca.sum2(kinetic[0, :]) - ca.dot(linear, linear) / mass
    moving = ca.SX.sym("moving", 9, len(arms))  # linear and angular momentum, first moment
    turning, centre, linear = _turning(moving, base, mass)
    tips = ca.SX.sym("tips", 9, len(arms))  # place, velocity, axis
    places = tips[:3, :] - ca.repmat(centre, 1, len(arms))
    velocities = tips[3:6, :] - ca.repmat(linear / mass, 1, len(arms))
    across = ca.SX.sym("across", 3, 4)
    tilt = ca.vertcat(*[across[:, 2 * arm : 2 * arm + 2].T @ tips[6:, arm] for arm in range(len(arms))])
    angular = _turning(ca.horzcat(*[arm.moving for arm in arms]), base, mass)[0]
    planar = bool(angular[0].is_zero() and angular[1].is_zero())
    d = 2 if planar else 3
    turning = turning[2] if planar else turning
    ending = ca.vertcat(ca.vec(places[:d, :]), ca.vec(velocities[:d, :]), turning)
    ending = ending if planar else ca.vertcat(ending, tilt)

    matrix = symbolic.momentum_matrices(q)[1]  # of the whole robot, about the base's origin
    middle = base + sum((arm.moment(q) for arm in arms), ca.SX(3, 1))
    matrix = matrix[3:, :] - ca.skew(middle / mass) @ matrix[:3, :]
    matrix = matrix[2, :] if planar else matrix
    reactionless = u - matrix.T @ _solve(matrix @ matrix.T, matrix @ u)
    change = ca.jtimes(reactionless, q, reactionless) + ca.jtimes(reactionless, u, udot)
    ends = [symbolic.end_effector_pose(tip)(q) for tip in range(len(arms))]
    seen = ca.vertcat(*[position - middle / mass for position, _ in ends])
    axes = ca.vertcat(*[rotation[:, 2] for _, rotation in ends])
    functions = {
        "projected": ca.Function("projected", [q, u], ca.cse([reactionless])),
        "still": ca.Function("still", [q, u, udot], ca.cse([reactionless, change])),
        "places": ca.Function("places", [q], ca.cse([seen, axes, middle / mass])),
        **_composed("energy", energy, [(kinetic, [arm.kinetic for arm in arms])], arms, n, []),
        **_composed("turning", turning, [(moving, [arm.moving for arm in arms])], arms, n, []),
        **_composed(
            "ending",
            ending,
            [(moving, [arm.moving for arm in arms]), (tips, [arm.tip for arm in arms])],
            arms,
            n,
            [across],
        ),
    }
    ready = compiled(functions)

    return HeldAttitude(
        dimensions=d,
        turns=turning.numel(),
        tilts=0 if planar else 4,
        energy=Smooth.named(ready, "energy"),
        turning=Smooth.named(ready, "turning"),
        ending=Smooth.named(ready, "ending"),
        projected=ready["projected"],
        still=ready["still"],
        places=ready["places"],
    )


def _chains(robot: FloatingRobot) -> list[list[int]]:
    """Joints of each arm, from the base to its end-effector."""
    chains = [
        [j for j in range(robot.n_joints) if robot.carries[j, link - 1]] for link in robot.end_effector_link
    ]
    if [joint for chain in chains for joint in chain] != list(range(robot.n_joints)):
        raise ConfigurationError("the robot must be made of arms on the base, numbered one after the other")
    return chains


class _Arm:
    """What one arm contributes, as expressions of its own joints, the base at rest.

    Attributes:
        joints: its places among the robot's. y: [q; qdot] of these.
        kinetic: (4,) twice the kinetic energy, linear momentum. moving: (9,) linear and angular momentum
            about the base's origin, first moment of mass. tip: (9,) place and velocity of the end-effector,
            its axis.
    """

    def __init__(self, symbolic: SymbolicRobot, joints: list[int], tip: int) -> None:
        n, size = symbolic.robot.n_joints, len(joints)
        self.joints, self._symbolic = joints, symbolic
        self.y = ca.SX.sym("y", 2 * size)
        q, qdot = ca.SX(n, 1), ca.SX(n, 1)
        q[joints], qdot[joints] = self.y[:size], self.y[size:]
        rest = ca.SX(6, 1)
        momentum = symbolic.momentum(q, qdot, rest)
        energy = 2.0 * symbolic.kinetic_energy(q, qdot, rest)
        position, rotation = symbolic.end_effector_pose(tip)(q)
        velocity = ca.jtimes(position, self.y[:size], self.y[size:])
        self.kinetic = ca.vertcat(energy, momentum[:3])
        self.moving = ca.vertcat(momentum, self.moment(q))
        self.tip = ca.vertcat(position, velocity, rotation[:, 2])

    def moment(self, q: ca.SX) -> ca.SX:
        """First moment (3,) of its links about the base's origin, from all joint angles (n,)."""
        links = self._symbolic.kinematics(q)[3]
        return links[:, self.joints] @ ca.DM(self._symbolic.robot.mass[1:][self.joints])


def _turning(moving: ca.SX, base: ca.DM, mass: float) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Angular momentum about the centre of mass, the centre of mass, and the linear momentum."""
    total = ca.sum2(moving)
    centre = (base + total[6:]) / mass
    return total[3:6] - ca.cross(centre, total[:3]), centre, total[:3]


def _composed(
    name: str,
    outer: ca.SX,
    inner: list[tuple[ca.SX, list[ca.SX]]],
    arms: list[_Arm],
    n: int,
    parameters: list[ca.SX],
) -> dict[str, ca.Function]:
    """The three functions of a `Smooth` by the chain rule, the inner functions being of one arm each.

    Args:
        outer: (k,) expression of the columns of the symbols in `inner` and of `parameters`.
        inner: symbols (m, arms) and what each arm puts there.
    """
    q, qdot = ca.MX.sym("q", n), ca.MX.sym("qdot", n)
    given = [ca.MX.sym("p", *parameter.shape) for parameter in parameters]
    factor, weight = ca.SX.sym("factor", outer.numel()), ca.MX.sym("weight", outer.numel())
    z = ca.vertcat(*[ca.vec(symbol) for symbol, _ in inner])
    lagrangian = ca.dot(factor, outer)
    bend, pull = ca.hessian(lagrangian, z)
    first = ca.Function(f"{name}_outer", [z, *parameters], [outer, ca.jacobian(outer, z)])
    second = ca.Function(f"{name}_outer_bend", [z, *parameters, factor], [bend, pull])
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
    at = ca.vertcat(*values)
    result, outer_slope = first(at, *given)
    across, force = second(at, *given, weight)
    slope = ca.vertcat(*slopes)
    total, begin = slope.T @ across @ slope, 0
    for group in range(len(inner)):
        blocks = []
        for curve, y in curves[group * len(arms) : (group + 1) * len(arms)]:
            size = curve.numel_in(1)
            half = y.numel() // 2
            blocks.append(ca.blocksplit(curve(y, force[begin : begin + size]), half, half))
            begin += size
        total += ca.blockcat([[ca.diagcat(*[b[i][j] for b in blocks]) for j in (0, 1)] for i in (0, 1)])
    inputs = [q, qdot, *given]
    return {
        f"{name}_value": ca.Function(f"{name}_value", inputs, [ca.densify(result)]),
        f"{name}_slope": ca.Function(f"{name}_slope", inputs, [ca.densify(outer_slope @ slope)]),
        f"{name}_bend": ca.Function(f"{name}_bend", [*inputs, weight], [ca.densify(total)]),
    }


def _solve(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Solution of a symmetric system of one or three rows, by its adjugate."""
    if matrix.numel() == 1:
        return right / matrix
    a, b, c = ca.horzsplit(matrix)
    adjugate = ca.horzcat(ca.cross(b, c), ca.cross(c, a), ca.cross(a, b)).T
    return (adjugate @ right) / ca.dot(a, ca.cross(b, c))
