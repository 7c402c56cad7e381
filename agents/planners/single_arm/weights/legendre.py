"""Polynomials of the phase as a basis of motions."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import ArrayLike

from space_envs.dynamics.rotations import Array
from space_envs.errors import positive_integer


@dataclass(frozen=True)
class LegendreBasis:
    """Legendre polynomials of the phase, shifted to [0, 1].

    The remainder of a polynomial motion is a polynomial motion again: a plan is reproduced exactly when the
    horizon shrinks. With Gaussian basis functions up to a fifth of a rate is lost in half a second.

    Args:
        size: nb, number of polynomials.
    """

    size: int = 10

    def __post_init__(self) -> None:
        positive_integer("number of polynomials", self.size, 64)

    @cached_property
    def _derivatives(self) -> tuple[Array, Array]:
        """Matrices (nb, nb) from polynomials to their derivatives by phase."""
        first = np.zeros((self.size, self.size))
        first[:-1] = 2.0 * legendre.legder(np.eye(self.size))
        return first, first @ first

    def value(self, phase: ArrayLike) -> Array:
        """Values (..., nb) at phases (...)."""
        phase = np.asarray(phase, dtype=np.float64)
        return legendre.legvander(2.0 * phase - 1.0, self.size - 1).reshape(*phase.shape, self.size)

    def derivative(self, phase: ArrayLike) -> Array:
        """First derivatives by phase."""
        return self.value(phase) @ self._derivatives[0]

    def second_derivative(self, phase: ArrayLike) -> Array:
        """Second derivatives by phase."""
        return self.value(phase) @ self._derivatives[1]
