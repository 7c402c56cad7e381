"""Torque limits of motions in weight space."""

import numpy as np

from agents.planners.single_arm.weights.weight_space import Disturbance, WeightSpace
from space_envs.dynamics.rotations import Array

TORQUE_CANDIDATES = 0.9  # fraction of the limit above which a torque gets a row
TORQUE_FRACTION = 0.99  # of the limit that plans use


class Torques:
    """|torque| <= limit on an even grid.

    Args:
        limit: N m, () or (n,). accelerating: whether torques of accelerations are included, or of Coriolis
            forces only.
    """

    def __init__(self, space: WeightSpace, limit: Array | float, accelerating: bool = True) -> None:
        self._space, self._limit = space, limit
        kinds = np.array([1.0, 1.0, float(accelerating)])[:, None, None]
        self._rows, self._fixed = kinds * space.even, kinds * space.even_fixed
        self._last: tuple[Array, Array, Array] | None = None  # coordinates, motion and shares

    def _shares(self, y: Array) -> tuple[Array, Array]:
        """Angles, rates and accelerations (3, T, n) and torques (T, n) as fractions of the limit."""
        if self._last is None or self._last[0] is not y:
            motion = self._fixed + self._rows @ y.T
            self._last = y, motion, self._space.functions.torque(*motion)[0] / self._limit
        return self._last[1:]

    def violation(self, y: Array) -> float:
        """Sum over the grid of torques beyond the limit, as fractions of it."""
        share = np.abs(self._shares(y)[1])
        return float(np.maximum(share - TORQUE_FRACTION, 0.0).sum())

    def linear(self, y: Array, at: Disturbance, part: float) -> tuple[Array, Array, Array]:
        """Rows for peaks close to the limit."""
        motion, share = self._shares(y)
        size = np.abs(share)
        peak = size > TORQUE_CANDIDATES  # and no smaller than before and after
        peak[1:] &= size[1:] >= size[:-1]
        peak[:-1] &= size[:-1] >= size[1:]
        time, joint = np.nonzero(peak)
        unit = np.eye(y.shape[0])[joint] / self._limit
        (slope,) = self._space.functions.torque_slope(*motion[:, time], unit)
        by = slope.reshape(len(time), 3, y.shape[0])
        rows = np.einsum("kcj,ckm->kjm", by, self._rows[:, time]).reshape(len(time), y.size)
        value = share[time, joint]
        low, high = -TORQUE_FRACTION - value, TORQUE_FRACTION - value
        return rows, np.where(low > 0.0, part * low, low), np.where(high < 0.0, part * high, high)
