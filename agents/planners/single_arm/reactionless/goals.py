"""Equations for the end of a path: rows of the goal, one class for each kind of goal."""

from typing import NamedTuple, Protocol

import numpy as np

from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.shapes import INTERVALS
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array


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
    """Six rows: position and rotation vector of the end-effector from a pose.

    Args:
        position, rotation: (3,) m and (3, 3) of the pose in the frame of the base at the start.
    """

    def __init__(self, robot: FloatingRobot, position: Array, rotation: Array) -> None:
        self._arm = ArmFunctions.of(robot, INTERVALS)
        self._goal = np.concatenate([position, rotation.T.ravel(), np.eye(3).ravel()])

    def __call__(self, end: PathEnd) -> EndError:
        """The pose error of an end."""
        pose = np.concatenate([end.shift, np.eye(3).ravel()])
        miss, slope = self._arm.ending(end.angle, pose, self._goal)
        return EndError(miss[:6], slope[:6, 6:], slope[:6, :3])
