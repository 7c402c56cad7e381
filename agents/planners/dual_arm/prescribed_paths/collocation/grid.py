"""Gauss collocation: the grid of a motion and motions on it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.interpolate import BarycentricInterpolator
from scipy.special import roots_legendre

from space_envs.dynamics.rotations import Array

ACCELERATION_POINTS = 33  # at which accelerations are bounded, denser towards the ends


@dataclass(frozen=True, eq=False)
class Grid:
    """Lagrange polynomials through -1 and the N Gauss points of [-1, 1].

    Attributes:
        points: (N + 1,). weights: (N,) of the quadrature.
        slope: (N, N + 1) first derivative at the Gauss points. first_slope: (1, N + 1) the same at -1.
        bend: (ACCELERATION_POINTS, N + 1) second derivative at points from -1 to 1 at which accelerations are
            bounded.
    """

    points: Array
    weights: Array
    slope: Array
    first_slope: Array
    bend: Array


@lru_cache(maxsize=4)
def gauss_grid(n: int) -> Grid:
    """Grid of N Gauss points, kept after the first use."""
    nodes, weights = roots_legendre(n)
    points = np.concatenate([[-1.0], nodes])
    curve = BarycentricInterpolator(points, np.eye(n + 1), rng=np.random.default_rng(0))
    bounded = -np.cos(np.linspace(0.0, np.pi, ACCELERATION_POINTS))
    first, bend = curve.derivative(np.array([-1.0])), curve.derivative(bounded, 2)
    return Grid(points, weights, curve.derivative(nodes), first, bend)


@dataclass(frozen=True, eq=False)
class CollocatedMotion:
    """Solution of a program.

    Attributes:
        times: (N + 1,) s, of the start and the Gauss points. nodes: (N + 1, n) angles there, rad.
        rates: (N, n) at the Gauss points, rad/s. energy: C by the quadrature, J s.
    """

    times: Array
    nodes: Array
    rates: Array
    energy: float

    def at(self, times: Array) -> Array:
        """Angles (K, n) at times (K,) s, rad."""
        curve = self.curve()
        return np.array([curve(time)[0] for time in times])

    def curve(self) -> Callable[[float], tuple[Array, Array]]:
        """Angles and rates (n,) as polynomials of time, which scipy's interpolators evaluate more slowly."""
        n = self.nodes.shape[1]
        rates = BarycentricInterpolator(self.times[1:], self.rates, rng=np.random.default_rng(0))
        both = np.hstack([self.nodes, np.vstack([rates(self.times[0]), self.rates])])
        weights = BarycentricInterpolator(self.times, rng=np.random.default_rng(0)).wi

        def at(time: float) -> tuple[Array, Array]:
            offset = time - self.times
            nearest = int(np.abs(offset).argmin())
            if offset[nearest] == 0.0:
                return both[nearest, :n], both[nearest, n:]
            terms = weights / offset
            values = terms @ both / terms.sum()
            return values[:n], values[n:]

        return at
