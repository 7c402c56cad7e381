"""Equations for the end of a path: rows of the goal, one class for each kind of goal."""

from typing import NamedTuple, Protocol

import numpy as np

from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.shapes import INTERVALS
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.tasks.goals.kinds import GOAL_ROWS, GoalKind


class PathEnd(NamedTuple):
    """End of a path: joint angles (n,) rad, and displacement (3,) m of the base, which does not rotate."""

    angle: Array
    shift: Array


class EndError(NamedTuple):
    """Goal error (r,) m and rad, with its derivatives by the angles (r, n) and by the displacement (r, 3)."""

    miss: Array
    by_angle: Array
    by_shift: Array


class GoalRows(Protocol):
    """Equations of a goal; their number is the same at every end."""

    def __call__(self, end: PathEnd) -> EndError:
        """The goal error of an end."""
        ...


class PoseRows:
    """Rows of a goal at rest: position of the end-effector, and rotation vector or tilt of its approach axis.

    Args:
        position, rotation: (3,) m and (3, 3) of the pose in the frame of the base at the start.
        kind: of the goal, which has 6, 5 or 3 rows.
    """

    def __init__(
        self, robot: FloatingRobot, position: Array, rotation: Array, kind: GoalKind = "pose"
    ) -> None:
        self._ending, self._rows = ArmFunctions.of(robot, INTERVALS).ending_of(kind), GOAL_ROWS[kind]
        self._goal = np.concatenate([position, rotation.T.ravel(), np.eye(3).ravel()])

    def __call__(self, end: PathEnd) -> EndError:
        """The goal error of an end."""
        pose = np.concatenate([end.shift, np.eye(3).ravel()])
        miss, slope = self._ending(end.angle, pose, self._goal)
        rows = self._rows
        return EndError(miss[:rows], slope[:rows, 6:], slope[:rows, :3])
