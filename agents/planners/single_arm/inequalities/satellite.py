"""Clearance of the arm from its satellite as rows of the quadratic program, at times when they are close."""

from collections.abc import Callable

import numpy as np

from agents.planners.single_arm.weights.weight_space import Disturbance, WeightSpace
from space_envs.dynamics.rotations import Array

Gaps = Callable[[Array], Array]
"""Joint angles (..., n), rad -> gaps (..., S), m, between capsules of the arm and the satellite."""

MARGIN = 0.01  # m, clearance of plans at their sampling times, or that at the start if it is less
CANDIDATES = 0.08  # m, clearance below which a capsule gets a row
STRIDE = 2  # points of the even grid for one point at which the clearance is evaluated
_STEP = 1e-6  # rad, of difference quotients


class SatelliteClearance:
    """Capsules of the arm keep out of the satellite on an even grid.

    Gaps depend on the joint angles alone: the satellite carries the arm.
    """

    def __init__(self, space: WeightSpace, gaps: Gaps) -> None:
        self._gaps = gaps
        self._rows, self._fixed = space.even[0][::STRIDE], space.even_fixed[0][::STRIDE]
        self._required = np.minimum(MARGIN, gaps(self._fixed[0]))  # (S,)

    def violation(self, y: Array) -> float:
        """Sum over the grid of clearance below the margin, m, at coordinates (n, m)."""
        return float(np.maximum(self._required - self._gaps(self._angles(y)), 0.0).sum())

    def linear(self, y: Array, at: Disturbance, part: float) -> tuple[Array, Array, Array]:
        """Rows for capsules close to the satellite, by difference quotients."""
        q = self._angles(y)
        gap = self._gaps(q)
        time, capsule = np.nonzero(gap < CANDIDATES)
        times, place = np.unique(time, return_inverse=True)
        varied = self._gaps(q[times, None] + _STEP * np.eye(q.shape[1]))  # (k, n, S)
        slope = (varied[place, :, capsule] - gap[time, capsule][:, None]) / _STEP
        rows = (slope[..., None] * self._rows[time][:, None]).reshape(len(time), y.size)
        missing = self._required[capsule] - gap[time, capsule]
        return rows, np.where(missing > 0.0, part * missing, missing), np.full(len(time), np.inf)

    def _angles(self, y: Array) -> Array:
        """Joint angles (T, n), rad, on the grid."""
        return self._fixed + self._rows @ y.T
