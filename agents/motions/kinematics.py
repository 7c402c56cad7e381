"""Compiled kinematics of one robot at zero momentum, with which a motion is observed."""

from dataclasses import dataclass

import casadi as ca

from space_envs.codegen.functions import Batched, batched
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.robots.gaps import ArmGaps

Points = tuple[tuple[int, tuple[float, ...]], ...]  # link from 0, and place in it, m


@dataclass(frozen=True, eq=False)
class ObservedKinematics:
    """Measurements of the sensors of a floating robot, by its angles and rates.

    Attributes:
        moving: q (n), qdot (n) -> twist (6) of the base and twist (6), position (3) and rotation (9, by
            columns) of the end-effector; in base axes, zero momentum.
        points: q (n) -> points (3 P) of the arm in the satellite's frame, against which contacts are checked.
    """

    moving: Batched
    points: Batched

    @classmethod
    def of(cls, robot: FloatingRobot, gaps: ArmGaps) -> "ObservedKinematics":
        """Kinematics of a robot and of the points that its gaps are measured with, kept after the first use.

        Warns:
            NoCompiledCodeWarning: if they are interpreted, up to twenty times slower.
        """
        links, places = gaps.fixed_points
        return _build(robot, tuple(zip(links.tolist(), map(tuple, places.tolist()), strict=True)))


@built_once
def _build(robot: FloatingRobot, fixed: Points) -> ObservedKinematics:
    symbolic, n = SymbolicRobot(robot), robot.n_joints
    q, qdot = ca.SX.sym("q", n), ca.SX.sym("qdot", n)
    position, rotation = symbolic.end_effector_pose(0)(q)
    twist = symbolic.generalized_jacobian(0)(q) @ qdot
    outputs = [symbolic.base_twist(q, qdot), twist, position, ca.vec(rotation)]
    link_rotation, link_position = symbolic.kinematics(q)[:2]
    points = [
        link_position[:, link] + link_rotation[:, 3 * link : 3 * link + 3] @ ca.DM(place)
        for link, place in fixed
    ]
    functions = {
        "moving": ca.Function("moving", [q, qdot], ca.cse([ca.densify(each) for each in outputs])),
        "points": ca.Function("points", [q], ca.cse([ca.densify(ca.vertcat(*points))])),
    }
    return ObservedKinematics(**batched(functions, vectorise=True))
