"""Series in the phase s from 0 to 1: sines that drive a path, and derivatives of sampled functions.

Along a path from rest to rest all rates are odd functions of s about both ends, and angles are even ones, as
long as sines drive it. Sums of sines and cosines through their samples therefore converge faster than any
power of the number of samples, and so do their derivatives.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from space_envs.dynamics.rotations import Array


class Between(NamedTuple):
    """Matrices (2 N + 1, N + 1) from samples to those at and in the middle between them.

    Attributes:
        odd, even: of the functions themselves. odd_slope, even_slope: of their derivatives by s.
    """

    odd: Array
    even: Array
    odd_slope: Array
    even_slope: Array


class Series(NamedTuple):
    """Matrices of one number K of sines and N of steps.

    Attributes:
        points: (N, 3, K) sines at the start, the middle and the end of every step.
        odd, even: (N + 1, N + 1), from samples at s = 0, 1 / N, ... to those of the derivative by s.
        between: the same at s = 0, 1 / 2 N, ...
        weight: (N + 1,) of samples in an integral over s.
    """

    points: Array
    odd: Array
    even: Array
    between: "Between"
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
    to_sines = 2.0 * (np.sin(np.pi * np.outer(order / steps, order)) * weight[:, None]).T
    half = np.where((order == 0) | (order == steps), 0.5, 1.0)  # the first and the last cosine
    to_cosines = 2.0 * half[:, None] * (np.cos(np.pi * np.outer(order / steps, order)) * weight[:, None]).T
    angle = np.pi * np.outer(fine, order)  # (2 N + 1 samples, orders)
    slope = np.pi * order
    between = Between(
        np.sin(angle) @ to_sines,
        np.cos(angle) @ to_cosines,
        (np.cos(angle) * slope) @ to_sines,
        (-np.sin(angle) * slope) @ to_cosines,
    )
    return Series(points, between.odd_slope[::2], between.even_slope[::2], between, weight)
