"""Cubic splines on a mesh, and sparse matrices of the programs in their coefficients."""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from numpy.typing import ArrayLike
from scipy.interpolate import BSpline
from scipy.sparse import coo_matrix, csc_matrix

from space_envs.dynamics.rotations import Array

DEGREE = 3  # accelerations are linear between knots: bounds at the knots hold in between
_GAUSS = 2  # points of the quadrature on an interval


@dataclass(frozen=True, eq=False)
class Mesh:
    """Splines on intervals whose lengths grow from both ends to the middle.

    Attributes:
        breaks: (N + 1,) values of s in [0, 1]. knots: of the splines, with repeated ends.
        nodes, weights: of the Gauss quadrature. middles: of the intervals.
    """

    breaks: Array
    knots: Array
    nodes: Array
    weights: Array
    middles: Array

    @classmethod
    def graded(cls, intervals: int, growth: float, steps: int) -> "Mesh":
        """Intervals whose lengths grow by a factor for a number of steps from either end."""
        number = np.arange(intervals)
        lengths = growth ** np.minimum(np.minimum(number, intervals - 1 - number), steps)
        breaks = np.concatenate([[0.0], np.cumsum(lengths / lengths.sum())])
        breaks[-1] = 1.0
        points, weights = np.polynomial.legendre.leggauss(_GAUSS)
        half, middles = 0.5 * np.diff(breaks), 0.5 * (breaks[:-1] + breaks[1:])
        return cls(
            breaks=breaks,
            knots=np.concatenate([np.zeros(DEGREE), breaks, np.ones(DEGREE)]),
            nodes=(middles[:, None] + half[:, None] * points).ravel(),
            weights=(half[:, None] * weights).ravel(),
            middles=middles,
        )

    @property
    def size(self) -> int:
        """Number of coefficients of a spline."""
        return len(self.knots) - DEGREE - 1

    def basis(self, at: Array, derivative: int = 0) -> Array:
        """Values (len(at), size) of the basis splines or of a derivative."""
        spline = BSpline(self.knots, np.eye(self.size), DEGREE)
        return np.asarray(spline.derivative(derivative)(at) if derivative else spline(at))

    @property
    def greville(self) -> Array:
        """(size,) Greville abscissae: coefficients of the spline that equals s."""
        return np.array([self.knots[i + 1 : i + DEGREE + 1].mean() for i in range(self.size)])

    def rate_rows(self) -> Array:
        """(size - 1, size) matrix from coefficients to those of the derivative, which bound it everywhere."""
        span = self.knots[DEGREE + 1 : -1] - self.knots[1 : -DEGREE - 1]
        rows = np.arange(self.size - 1)
        matrix = np.zeros((self.size - 1, self.size))
        matrix[rows, rows], matrix[rows, rows + 1] = -DEGREE / span, DEGREE / span
        return matrix


class Terms:
    """Entries of a sparse matrix, linear in a vector of sources: (row, column, source, factor)."""

    def __init__(self) -> None:
        self._parts: list[tuple[Array, ...]] = []

    def add(self, row: ArrayLike, column: ArrayLike, source: ArrayLike, factor: ArrayLike) -> None:
        """Add factor times source to entries; the arguments are broadcast."""
        parts = np.broadcast_arrays(np.asarray(row), column, source, factor)
        self._parts.append(tuple(part.ravel() for part in parts))

    def matrix(self, sources: ca.MX, shape: tuple[int, int]) -> ca.MX:
        """Expression of the sparse matrix of the given shape."""
        row, column, source, factor = (np.concatenate(part) for part in zip(*self._parts, strict=True))
        nonzero = np.abs(factor) > 0.0
        row, column, source, factor = row[nonzero], column[nonzero], source[nonzero], factor[nonzero]
        key, place = np.unique(column * shape[0] + row, return_inverse=True)  # column by column
        count = np.bincount(key // shape[0], minlength=shape[1])
        sparsity = ca.Sparsity(
            *shape, np.concatenate([[0], np.cumsum(count)]).tolist(), (key % shape[0]).tolist()
        )
        linear = coo_matrix((factor, (place, source)), shape=(len(key), sources.numel()))
        return ca.MX(sparsity, ca.mtimes(ca.DM(csc_matrix(linear)), sources))
