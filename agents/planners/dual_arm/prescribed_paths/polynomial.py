"""End-effector paths with given end velocities: the 3-4-5 polynomial, eq. 10 and 11 of shah2013."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from space_envs.dynamics.rotations import Array


@dataclass(frozen=True, eq=False)
class PolynomialPath:
    """x(t) = x_I + T [a s + b s^3 + c s^4 + d s^5], s = t / T; accelerations vanish at both ends.

    Attributes:
        start, end: (k,) m. start_velocity, end_velocity: (k,) m/s. duration: T, s.
    """

    start: Array
    end: Array
    start_velocity: Array
    end_velocity: Array
    duration: float

    @cached_property
    def coefficients(self) -> tuple[Array, Array, Array, Array]:
        """a, b, c, d of eq. 10, m/s."""
        v = (self.end - self.start) / self.duration
        first, last = self.start_velocity, self.end_velocity
        return (
            first,
            10.0 * v - (6.0 * first + 4.0 * last),
            -15.0 * v + (8.0 * first + 7.0 * last),
            6.0 * v - (3.0 * first + 3.0 * last),
        )

    def position(self, time: Array | float) -> Array:
        """x (..., k) m at times (...,) s, eq. 10."""
        a, b, c, d = self.coefficients
        s = np.asarray(time, dtype=np.float64)[..., None] / self.duration
        return self.start + self.duration * s * (a + s**2 * (b + s * (c + s * d)))

    def velocity(self, time: Array | float) -> Array:
        """Time derivative (..., k) m/s, eq. 11."""
        a, b, c, d = self.coefficients
        s = np.asarray(time, dtype=np.float64)[..., None] / self.duration
        return a + s**2 * (3.0 * b + s * (4.0 * c + s * 5.0 * d))
