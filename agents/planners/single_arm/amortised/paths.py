"""Paths in the reaction null space of many problems at once, with derivatives by their weights.

A path dq/ds = P(q) v(s) as in `PathSpace`, which is for one problem: v is a sum of sines with amplitudes w.
"""

from typing import NamedTuple

import numpy as np

from agents.planners.single_arm.amortised.motions import Problems
from agents.planners.single_arm.reactionless.flow.functions import FlowFunctions
from agents.planners.single_arm.reactionless.flow.series import Series
from agents.planners.single_arm.reactionless.paths import FUNCTIONS, STEPS
from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.shapes import INTERVALS
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array


class LinearisedPaths(NamedTuple):
    """Paths of S problems with derivatives by their weights, flattened (m) function by function.

    Attributes:
        motion: (3, S, N + 1, n) angles rad, rates rad/s and accelerations rad/s^2. motion_by: (3, S, N + 1,
            n, m).
        residual: (S, R), whose squares sum to the cost, eq. 20 times dt, m^2/s. by: (S, R, m).
        error: (S, 6) at the end: position m and rotation rad of the end-effector from the goal. error_by:
            (S, 6, m).
    """

    motion: Array
    motion_by: Array
    residual: Array
    by: Array
    error: Array
    error_by: Array


class PathBatch:
    """Paths of S problems; those start at rest, and their attitudes are the ones at the start.

    Args:
        robot: of one arm with at least seven joints.

    Attributes:
        size: m, number of weights.
    """

    def __init__(self, robot: FloatingRobot, problems: Problems) -> None:
        self._functions = FlowFunctions.of(robot, FUNCTIONS, STEPS)
        self._ending = ArmFunctions.of(robot, INTERVALS).ending
        self._series, self.problems = Series.of(FUNCTIONS, STEPS), problems
        self.joints, self.size = robot.n_joints, robot.n_joints * FUNCTIONS

    def linearised(self, weights: Array) -> LinearisedPaths:
        """Paths of weights (S, m), with their derivatives."""
        s, n, m, functions = len(weights), self.joints, self.size, self._functions
        amplitudes = weights.reshape(s, FUNCTIONS, n)
        velocity = self._series.points @ amplitudes[:, None]  # (S, N, 3, n)
        angle, slope, points = functions.path(self.problems.start, velocity.reshape(s, -1))
        slopes = functions.slopes(points.reshape(s, STEPS, 4, n), velocity[:, :, [0, 1, 1, 2]])
        transfer = functions.transfer(*[x.reshape(s, STEPS, -1) for x in slopes])
        angle_by, slope_by = np.empty((2, s, STEPS + 1, n, m))
        for row in range(s):
            found = functions.chain([x[row] for x in transfer], self._series.points)
            angle_by[row], slope_by[row] = (x.reshape(STEPS + 1, n, m) for x in found)
        angle = np.concatenate([self.problems.start[:, None], angle.reshape(s, STEPS, n)], axis=1)
        slope = np.concatenate([slope.reshape(s, STEPS, n), np.zeros((s, 1, n))], axis=1)
        return self._at(angle, slope, angle_by, slope_by)

    def _at(self, angle: Array, slope: Array, angle_by: Array, slope_by: Array) -> LinearisedPaths:
        s, n, m, t = len(angle), self.joints, self.size, self.problems.duration[:, None, None]
        series = self._series
        motion = np.stack([angle, slope / t, series.odd @ slope / t**2])
        curve_by = (series.odd @ slope_by.reshape(s, STEPS + 1, n * m)).reshape(slope_by.shape)
        motion_by = np.stack([angle_by, slope_by / t[..., None], curve_by / t[..., None] ** 2])
        centre, centre_by = self._functions.centre(angle)
        shift, shift_by = centre[:, :1] - centre, -centre_by @ angle_by
        scale = np.sqrt(series.weight)[:, None] / np.sqrt(t)
        drift_by = (series.even @ shift_by.reshape(s, STEPS + 1, 3 * m)).reshape(shift_by.shape)
        residual = (scale * (series.even @ shift)).reshape(s, -1)
        pose = np.concatenate([shift[:, -1], np.tile(np.eye(3).ravel(), (s, 1))], axis=1)
        error, ending = self._ending(angle[:, -1], pose, self.problems.goal)
        error_by = ending[:, :6, 6:] @ angle_by[:, -1] + ending[:, :6, :3] @ shift_by[:, -1]
        by = (scale[..., None] * drift_by).reshape(s, -1, m)
        return LinearisedPaths(motion, motion_by, residual, by, error[:, :6], error_by)
