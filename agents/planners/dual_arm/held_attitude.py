"""Compiled functions of a robot whose base keeps its attitude, with first and second derivatives.

In reactionless motion the base only translates. Positions with respect to the system's centre of mass are
then functions of the joint angles, and thetadot' M* thetadot (eq. 12 of shah2013) is twice the kinetic energy
about the centre of mass of a robot with that base. These expressions are far smaller than those of a rotating
base: sums over the arms and products of a few vectors, of which their derivatives make use.
"""

from dataclasses import dataclass

import casadi as ca

from agents.planners.common.smooth import Smooth
from agents.planners.dual_arm.arms import ArmExpressions, chains, composed, momentum_about_com
from space_envs.codegen.functions import compiled
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.symbolic import SymbolicRobot


@dataclass(frozen=True, eq=False)
class HeldAttitude:
    """Functions of one robot. Vectors are in the axes of the base; d is 2 for a planar robot, else 3.

    Attributes:
        dimensions: d. momenta: number r of angular-momentum components that the joints can change, 1 or 3.
        energy: thetadot' M* thetadot, J, on reactionless motion.
        angular_momentum: (r,) angular momentum about the centre of mass with the base at rest, N m s: Ibm~
            thetadot of eq. 4 of shah2013.
        tilts: number of products for the alignment of the approach axes, 4; none in the plane.
        ending: (4 d + r + tilts,) with parameter across (3, 4): positions of the end-effectors from the
            system's centre of mass (2 d) m, their velocities (2 d) m/s, `angular_momentum` (r) and the
            products of the approach axes with two columns of `across` each.
        projected: (q, u) -> rate (n), the reactionless part of u.
        accelerated: (q, u, udot) -> that rate and its time derivative along the motion with it.
        positions: q -> end-effectors (6) from the system's centre of mass, axes (6), and the centre of mass
            (3), base axes, m.
    """

    dimensions: int
    momenta: int
    tilts: int
    energy: Smooth
    angular_momentum: Smooth
    ending: Smooth
    projected: ca.Function
    accelerated: ca.Function
    positions: ca.Function

    @classmethod
    def of(cls, robot: FloatingRobot) -> "HeldAttitude":
        """Return the functions of a robot, built at the first use and kept.

        Warns:
            NoCompiledCodeWarning: if they are interpreted, up to twenty times slower.
        """
        return _build(robot)


@built_once
def _build(robot: FloatingRobot) -> HeldAttitude:
    symbolic, n = SymbolicRobot(robot), robot.n_joints
    arms = [ArmExpressions(symbolic, joints, number) for number, joints in enumerate(chains(robot))]
    base, mass = float(robot.mass[0]) * ca.DM(robot.com[0]), float(robot.mass.sum())
    angular = momentum_about_com(ca.horzcat(*[arm.moving for arm in arms]), base, mass)[0]
    planar = bool(angular[0].is_zero() and angular[1].is_zero())
    motion = _motion_functions(arms, base, mass, planar, n)
    functions = compiled({**_joint_functions(symbolic, arms, base, mass, planar), **motion})
    return HeldAttitude(
        dimensions=2 if planar else 3,
        momenta=1 if planar else 3,
        tilts=0 if planar else 4,
        energy=Smooth.named(functions, "energy"),
        angular_momentum=Smooth.named(functions, "angular_momentum"),
        ending=Smooth.named(functions, "ending"),
        projected=functions["projected"],
        accelerated=functions["accelerated"],
        positions=functions["positions"],
    )


def _motion_functions(
    arms: list[ArmExpressions], base: ca.DM, mass: float, planar: bool, n: int
) -> dict[str, ca.Function]:
    """Functions of `energy`, `angular_momentum` and `ending`.

    Only contributions of one arm are nonlinear in the joints; the rest are products of a few vectors.
    """
    count, d = len(arms), 2 if planar else 3
    kinetic = ca.SX.sym("kinetic", 4, count)  # of each arm: twice the energy, linear momentum
    linear = ca.sum2(kinetic[1:, :])
    energy = ca.sum2(kinetic[0, :]) - ca.dot(linear, linear) / mass
    moving = ca.SX.sym("moving", 9, count)  # linear and angular momentum, first moment
    momentum, centre, linear = momentum_about_com(moving, base, mass)
    momentum = momentum[2] if planar else momentum
    ends = ca.SX.sym("ends", 9, count)  # position, velocity, axis
    positions = ends[:3, :] - ca.repmat(centre, 1, count)
    velocities = ends[3:6, :] - ca.repmat(linear / mass, 1, count)
    across = ca.SX.sym("across", 3, 4)
    tilt = ca.vertcat(*[across[:, 2 * arm : 2 * arm + 2].T @ ends[6:, arm] for arm in range(count)])
    ending = ca.vertcat(ca.vec(positions[:d, :]), ca.vec(velocities[:d, :]), momentum)
    ending = ending if planar else ca.vertcat(ending, tilt)
    momenta = (moving, [arm.moving for arm in arms])
    end_effectors = (ends, [arm.end_effector for arm in arms])
    return {
        **composed("energy", energy, [(kinetic, [arm.kinetic for arm in arms])], arms, n, []),
        **composed("angular_momentum", momentum, [momenta], arms, n, []),
        **composed("ending", ending, [momenta, end_effectors], arms, n, [across]),
    }


def _joint_functions(
    symbolic: SymbolicRobot, arms: list[ArmExpressions], base: ca.DM, mass: float, planar: bool
) -> dict[str, ca.Function]:
    """`projected`, `accelerated` and `positions`."""
    q, u, udot = (ca.SX.sym(name, symbolic.robot.n_joints) for name in ("q", "u", "udot"))
    matrix = symbolic.momentum_matrices(q)[1]  # of the whole robot, about the base's origin
    moment = base + sum((arm.moment(q) for arm in arms), ca.SX(3, 1))
    matrix = matrix[3:, :] - ca.skew(moment / mass) @ matrix[:3, :]
    matrix = matrix[2, :] if planar else matrix
    reactionless = u - matrix.T @ _solve(matrix @ matrix.T, matrix @ u)
    change = ca.jtimes(reactionless, q, reactionless) + ca.jtimes(reactionless, u, udot)
    ends = [symbolic.end_effector_pose(number)(q) for number in range(len(arms))]
    relative = ca.vertcat(*[position - moment / mass for position, _ in ends])
    axes = ca.vertcat(*[rotation[:, 2] for _, rotation in ends])
    return {
        "projected": ca.Function("projected", [q, u], ca.cse([reactionless])),
        "accelerated": ca.Function("accelerated", [q, u, udot], ca.cse([reactionless, change])),
        "positions": ca.Function("positions", [q], ca.cse([relative, axes, moment / mass])),
    }


def _solve(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """Solution of a symmetric system of one or three rows, by its adjugate."""
    if matrix.numel() == 1:
        return right / matrix
    a, b, c = ca.horzsplit(matrix)
    adjugate = ca.horzcat(ca.cross(b, c), ca.cross(c, a), ca.cross(a, b)).T
    return (adjugate @ right) / ca.dot(a, ca.cross(b, c))
