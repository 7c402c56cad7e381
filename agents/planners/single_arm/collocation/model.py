"""Compiled functions of the collocation program, with first and second derivatives.

Total momentum is zero and the frame is inertial, at the base frame of t = 0. The system's centre of mass is
at rest, so that the position of the base follows from the joint angles and its attitude; only the attitude is
integrated. It is a Gibbs vector r = tan(angle / 2) axis, in which compositions are rational; it is singular
at half a revolution, far beyond the base disturbance of an arm.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from agents.planners.common.smooth import Smooth, smooth_parts
from agents.planners.single_arm.collocation.interval import interval_functions
from space_envs.codegen.functions import compiled
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.errors import ConfigurationError
from space_envs.tasks.goals.kinds import GoalKind

SHORT = 1e-6  # m; shorter links are points, covered by their neighbours


@dataclass(frozen=True, eq=False)
class SingleArm:
    """Functions of one robot with n joints.

    Attributes:
        interval: one interval of the mesh, in the scaled time s = t / T, of its four spline coefficients
            (n, 4) and the attitudes r at its ends (3), (3), with parameters values and slopes (4, GAUSS) of
            the splines at the Gauss points, length h and c^2 of eq. 20. Outputs: integral of eq. 20 (1) and
            the defect (3) of the attitude. The derivatives are by the 4 n + 6 variables in that order.
        ending: of q (n) and r (3) with parameters com (3), the system's centre of mass, and goal (3, 3), the
            end-effector's axes at the goal: position (3) m of the end-effector and sines (3) of its rotation
            from the goal. axis_ending, position_ending: the same for goals of these kinds, with the sines (2)
            of the approach axis's angle from that of the goal along its x and y axes, and without.
        spheres: of q (n) and r (3) with parameters com (3) and centre (3): squared distances of a
            sphere's centre from the segments of the links that have a length, m^2.
        links: numbers of these from 0.
        com: q -> the system's centre of mass (3) in the base frame.
    """

    interval: Smooth
    ending: Smooth
    axis_ending: Smooth
    position_ending: Smooth
    spheres: Smooth
    links: tuple[int, ...]
    com: ca.Function

    @classmethod
    def of(cls, robot: FloatingRobot) -> "SingleArm":
        """Return the functions of a robot, built at the first use and kept.

        Warns:
            NoCompiledCodeWarning: if they are interpreted, up to twenty times slower.

        Raises:
            ConfigurationError: if the robot is no single arm.
        """
        return _build(robot)

    def ending_of(self, kind: GoalKind) -> Smooth:
        """Ending for goals of a kind, with as many rows as they have."""
        return {"pose": self.ending, "axis": self.axis_ending, "position": self.position_ending}[kind]


@dataclass(frozen=True, eq=False)
class Torque:
    """Joint torques at zero momentum: q, q', q'' -> value (n) N m, and slope (n, 3 n) by all of them.

    There is no second derivative: it has ten times the code of everything else, and little effect.
    """

    value: ca.Function
    slope: ca.Function

    @classmethod
    def of(cls, robot: FloatingRobot) -> "Torque":
        """Return the functions of a robot, built at the first use and kept."""
        return _torque(robot)


@built_once
def _torque(robot: FloatingRobot) -> Torque:
    q, qdot, qddot = (ca.SX.sym(name, robot.n_joints) for name in ("q", "qdot", "qddot"))
    torque = SymbolicRobot(robot).inverse_dynamics(q, qdot, qddot)
    state = [q, qdot, qddot]
    slope = ca.densify(ca.jacobian(torque, ca.vertcat(*state)))
    ready = compiled(
        {
            "torque_value": ca.Function("torque_value", state, [torque]),
            "torque_slope": ca.Function("torque_slope", state, [ca.cse(slope)]),
        }
    )
    return Torque(ready["torque_value"], ready["torque_slope"])


def rotated(r: ca.SX, x: ca.SX, back: bool = False) -> ca.SX:
    """Vector rotated by the Gibbs vector r, from base to inertial axes, or back."""
    axis = -r if back else r
    across = ca.cross(axis, x)
    return x + 2.0 / (1.0 + ca.dot(r, r)) * (across + ca.cross(axis, across))


def end_pose(symbolic: SymbolicRobot, q: ca.SX, r: ca.SX, com: ca.SX, goal: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Position (3) m of the end-effector and its rotation (3, 3) from the goal's axes, as in `ending`."""
    _, _, _, _, middle = symbolic.kinematics(q)
    end_effector, axes = symbolic.end_effector_pose()(q)
    attitude = ca.horzcat(*[rotated(r, axes[:, i]) for i in range(3)])
    return com + rotated(r, end_effector - middle), goal.T @ attitude


def sines(rotation: ca.SX) -> ca.SX:
    """Sines (3) of a rotation matrix: its angle's sine times its axis."""
    return ca.inv_skew(0.5 * (rotation - rotation.T))


@built_once
def _build(robot: FloatingRobot) -> SingleArm:
    if len(robot.end_effector_link) != 1:
        raise ConfigurationError("optimal control of the single arm needs a robot with one end-effector")
    symbolic, n = SymbolicRobot(robot), robot.n_joints
    q, qdot, qddot = (ca.SX.sym(name, n) for name in ("q", "qdot", "qddot"))
    r, com, centre = (ca.SX.sym(name, 3) for name in ("r", "com", "centre"))
    goal = ca.SX.sym("goal", 3, 3)
    _, origins, _, _, middle = symbolic.kinematics(q)
    end_effector, _ = symbolic.end_effector_pose()(q)

    position, deviation = end_pose(symbolic, q, r, com, goal)
    ends = ca.horzcat(origins, end_effector)
    at_home = np.asarray(ca.Function("ends", [q], [ends])(robot.home))
    long = np.linalg.norm(np.diff(at_home, axis=1), axis=0) > SHORT
    sphere = rotated(r, centre - com, back=True) + middle
    squares = []
    for link in np.flatnonzero(long).tolist():
        root, along = ends[:, link], ends[:, link + 1] - ends[:, link]
        to_sphere = sphere - root
        share = ca.fmin(ca.fmax(ca.dot(to_sphere, along) / ca.dot(along, along), 0.0), 1.0)
        offset = to_sphere - share * along
        squares.append(ca.dot(offset, offset))

    ready = compiled(
        {
            **interval_functions(symbolic.base_twist(q, qdot), q, qdot),
            **smooth_parts("ending", ca.vertcat(position, sines(deviation)), [q, r], [com, goal]),
            **smooth_parts("axis_ending", ca.vertcat(position, deviation[:2, 2]), [q, r], [com, goal]),
            **smooth_parts("position_ending", position, [q, r], [com, goal]),
            **smooth_parts("spheres", ca.vertcat(*squares), [q, r], [com, centre]),
            "com": ca.Function("com", [q], [ca.densify(middle)]),
        }
    )

    return SingleArm(
        interval=Smooth.named(ready, "interval"),
        ending=Smooth.named(ready, "ending"),
        axis_ending=Smooth.named(ready, "axis_ending"),
        position_ending=Smooth.named(ready, "position_ending"),
        spheres=Smooth.named(ready, "spheres"),
        links=tuple(np.flatnonzero(long).tolist()),
        com=ready["com"],
    )
