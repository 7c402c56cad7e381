"""Functions of phase with given boundary conditions, for motions in the weights of a ProMP."""

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from space_envs.dynamics.rotations import Array

INTERVALS = 16  # of the base's roll-out, with two Gauss points each
SAMPLES = 101  # at which limits are imposed
_FINE = 401  # samples of the integral of squared rates


class Basis(Protocol):
    """Basis functions of phase in [0, 1], (...) -> (..., nb), with derivatives by phase; hashable."""

    def __hash__(self) -> int: ...

    def value(self, phase: ArrayLike) -> Array:
        """Values at phases."""
        ...

    def derivative(self, phase: ArrayLike) -> Array:
        """First derivatives by phase."""
        ...

    def second_derivative(self, phase: ArrayLike) -> Array:
        """Second derivatives by phase."""
        ...


@dataclass(frozen=True, eq=False)
class Shapes:
    """Functions of phase that motions of one basis are sums of; times are in units of the duration.

    Attributes:
        fixed: (nb, 3) weights of a joint per start angle, start rate (times T) and end rate (times T).
        free: (nb, m) weights of the free functions.
        gauss, even: basis functions (3, count, nb): value, first and second derivative by phase, at the
            Gauss points and on an even grid. end: (nb,) at phase 1.
    """

    basis: Basis
    fixed: Array
    free: Array
    gauss: Array
    even: Array
    end: Array

    @classmethod
    def of(cls, basis: Basis, intervals: int = INTERVALS, samples: int = SAMPLES) -> "Shapes":
        """Return the functions of a basis, which are kept after the first use."""
        return _shapes(basis, intervals, samples)


@lru_cache(maxsize=8)
def _shapes(basis: Basis, intervals: int, samples: int) -> Shapes:
    ends = np.stack([basis.value(0.0), basis.derivative(0.0), basis.derivative(1.0)])
    rate = basis.derivative(np.linspace(0.0, 1.0, _FINE))
    square = rate.T @ rate / (_FINE - 1)  # integral of qdot^2
    null = np.linalg.svd(ends)[2][3:].T
    factor = np.linalg.cholesky(null.T @ square @ null)
    particular = np.linalg.pinv(ends)
    correction = np.linalg.solve(null.T @ square @ null, null.T @ square @ particular)
    minimum_energy = particular - null @ correction
    points = (np.arange(intervals)[:, None] + 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)).ravel() / intervals

    def at(phase: Array) -> Array:
        return np.stack([basis.value(phase), basis.derivative(phase), basis.second_derivative(phase)])

    return Shapes(
        basis=basis,
        fixed=minimum_energy,
        free=null @ np.linalg.inv(factor).T,
        gauss=at(points),
        even=at(np.linspace(0.0, 1.0, samples)),
        end=basis.value(1.0),
    )


def in_basis(basis: Basis, other: Basis, weights: Array) -> Array:
    """Weights (n, nb) in a basis of the motion nearest to one with weights (n, nb) in another."""
    phase = np.linspace(0.0, 1.0, _FINE)
    return np.linalg.lstsq(basis.value(phase), other.value(phase) @ weights.T, rcond=None)[0].T
