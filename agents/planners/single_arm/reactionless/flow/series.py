"""Series in the phase s from 0 to 1: sines that drive a path, and derivatives of sampled functions.

Along a path from rest to rest all rates are odd functions of s about both ends, and angles are even ones, as
long as sines drive it. Sums of sines and cosines through their samples therefore converge faster than any
power of the number of samples, and so do their derivatives.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from space_envs.dynamics.rotations import Array


class Series(NamedTuple):
    """Matrices of one number K of sines and N of steps.

    Attributes:
        points: (N, 3, K) sines at the start, the middle and the end of every step.
        odd, even: (N + 1, N + 1), from samples at s = 0, 1 / N, ... to those of the derivative by s.
        weight: (N + 1,) of samples in an integral over s.
    """

    points: Array
    odd: Array
    even: Array
    weight: Array

    @classmethod
    def of(cls, functions: int, steps: int) -> "Series":
        """Return the matrices, which are kept after the first use."""
        return _series(functions, steps)


@lru_cache(maxsize=16)
def _series(functions: int, steps: int) -> Series:
    fine = np.arange(2 * steps + 1) / (2 * steps)
    sines = np.sin(np.pi * fine[:, None] * np.arange(1, functions + 1))
    points = sines[2 * np.arange(steps)[:, None] + np.arange(3)]
    weight = np.full(steps + 1, 1.0 / steps)
    weight[[0, -1]] *= 0.5
    order = np.arange(steps + 1)
    angle = np.pi * np.outer(order / steps, order)  # (N + 1 samples, orders)
    scale = 2.0 * weight  # of the samples in a coefficient; the first and the last cosine count half
    half = np.where((order == 0) | (order == steps), 0.5, 1.0)
    odd = (np.cos(angle) * np.pi * order) @ (np.sin(angle) * scale[:, None]).T
    even = (-np.sin(angle) * np.pi * order * half) @ (np.cos(angle) * scale[:, None]).T
    return Series(points, odd, even, weight)
