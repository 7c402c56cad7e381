"""Bounds on motions in weight space."""

import numpy as np

from agents.planners.common.plans import Limits
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

LIMIT_FRACTION = 0.99  # of rates and accelerations at the sampling times; in between they are slightly larger
ANGLE_MARGIN = 1e-3  # rad, to the joint limits
TOLERANCE = 1e-4  # fraction of a bound's half width by which it may be violated


def lower_and_upper(robot: FloatingRobot, limits: Limits) -> tuple[Array, Array]:
    """Least and greatest angles rad, rates rad/s and accelerations rad/s^2 of plans, (3, n) each."""
    n = robot.n_joints
    angles = limits.angles(n) + ANGLE_MARGIN * np.array([1.0, -1.0])
    largest = [
        np.broadcast_to(np.inf if limit is None else LIMIT_FRACTION * limit, n)
        for limit in (limits.rate, limits.acceleration)
    ]
    return np.stack([angles[:, 0], *(-x for x in largest)]), np.stack([angles[:, 1], *largest])


class Bounds:
    """Bounds on angles, rates and accelerations at sampling times, linear in the coordinates.

    Args:
        rows: (3, T, m) values of the free functions: of angle, rate, acceleration. fixed: (3, T, n) of the
            motion at coordinates zero.
        low, high: (3, n); infinite where there is no bound.
    """

    def __init__(self, rows: Array, fixed: Array, low: Array, high: Array) -> None:
        scale = np.where(np.isfinite(high - low), 0.5 * (high - low), 1.0)
        self._m = rows.shape[2]
        self._rows = rows.reshape(-1, self._m)
        self._scale = np.broadcast_to(scale[:, None], fixed.shape).reshape(len(self._rows), -1)
        self._low = (low[:, None] - fixed).reshape(self._scale.shape) / self._scale
        self._high = (high[:, None] - fixed).reshape(self._scale.shape) / self._scale
        self._block = rows.shape[1]
        self.any = bool(np.isfinite(self._low).any() or np.isfinite(self._high).any())

    def excess(self, y: Array) -> Array:
        """Violation (3 T, n) of each bound at coordinates (n, m), as a fraction of its half width."""
        value = self._rows @ y.T / self._scale
        return np.maximum(self._low - value, value - self._high)

    def peaks(self, y: Array) -> set[tuple[int, int]]:
        """Rows and joints of the bounds whose violation is largest among neighbouring times."""
        excess = self.excess(y)
        if excess.max() <= TOLERANCE:
            return set()
        excess = excess.reshape(3, self._block, -1)
        top = excess > TOLERANCE
        top[:, 1:] &= excess[:, 1:] >= excess[:, :-1]
        top[:, :-1] &= excess[:, :-1] >= excess[:, 1:]
        kind, time, joint = np.nonzero(top)
        return set(zip((kind * self._block + time).tolist(), joint.tolist(), strict=True))

    def linear(self, y: Array, chosen: set[tuple[int, int]]) -> tuple[Array, Array, Array]:
        """Rows (k, n m) with lower and upper limits on a step from y (n, m), for chosen bounds."""
        row, joint = np.array(sorted(chosen)).T
        matrix = np.zeros((len(row), *y.shape))
        rows, scale = self._rows[row], self._scale[row, joint]
        matrix[np.arange(len(row)), joint] = rows / scale[:, None]
        value = (rows * y[joint]).sum(axis=1) / scale
        low, high = self._low[row, joint] - value, self._high[row, joint] - value
        return matrix.reshape(len(row), y.size), low, high
