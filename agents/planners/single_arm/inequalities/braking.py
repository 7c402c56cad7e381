"""Rates from which the drives can stop joints before the ends of their ranges, as rows of a program."""

import numpy as np

from agents.planners.single_arm.inequalities.satellite import STRIDE
from agents.planners.single_arm.weights.weight_space import Disturbance, WeightSpace
from space_envs.dynamics.rotations import Array

CANDIDATES = 0.8  # fraction of the largest rate above which a rate gets a row
FRACTION = 0.95  # of the largest rate that plans use
LEAST_RATE = 0.02  # rad/s, below which rates are not limited


class Braking:
    """|rate|^2 <= 2 deceleration room on an even grid; room is the angle to the end that a joint approaches.

    Args:
        deceleration: (n,) rad/s^2, of the drives. limits: (n, 2) rad, angles at which they stop the joints.
    """

    def __init__(self, space: WeightSpace, deceleration: Array, limits: Array) -> None:
        self._rows, self._fixed = space.even[:2, ::STRIDE], space.even_fixed[:2, ::STRIDE]
        self._twice, self._limits = 2.0 * deceleration, limits

    def violation(self, y: Array) -> float:
        """Sum over the grid of rates beyond the largest, as fractions of it, at coordinates (n, m)."""
        _, rate, fastest = self._rates(y)
        return float(np.maximum(np.abs(rate) / fastest - FRACTION, 0.0).sum())

    def linear(self, y: Array, at: Disturbance, part: float) -> tuple[Array, Array, Array]:
        """Rows for rates close to the largest."""
        sign, rate, fastest = self._rates(y)
        share = np.abs(rate) / fastest
        time, joint = np.nonzero(share > CANDIDATES)
        # The largest rate falls with the angle in the direction of motion.
        falls = np.where(fastest > LEAST_RATE, 0.5 * share * self._twice / fastest, 0.0)[time, joint]
        own = sign[time, joint, None] * (self._rows[1][time] + falls[:, None] * self._rows[0][time])
        rows = np.zeros((len(time), *y.shape))
        rows[np.arange(len(time)), joint] = own / fastest[time, joint][:, None]
        excess = FRACTION - share[time, joint]
        high = np.where(excess < 0.0, part * excess, excess)
        return rows.reshape(len(time), y.size), np.full(len(time), -np.inf), high

    def _rates(self, y: Array) -> tuple[Array, Array, Array]:
        """Directions, rates and largest rates (T, n), rad/s, on the grid."""
        angle, rate = self._fixed + self._rows @ y.T
        sign = np.where(rate < 0.0, -1.0, 1.0)
        room = np.where(rate < 0.0, angle - self._limits[:, 0], self._limits[:, 1] - angle)
        return sign, rate, np.maximum(np.sqrt(self._twice * np.maximum(room, 0.0)), LEAST_RATE)
