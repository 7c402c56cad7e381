"""Delays by whole control periods."""

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array


class Delay:
    """The last values of N rows, each given back a number of steps later.

    Args:
        steps: of the delay; 0 gives values back at once. n, size: shape of the values.
    """

    def __init__(self, steps: int, n: int, size: int) -> None:
        self._line = np.zeros((steps + 1, n, size))

    def begin(self, rows: NDArray[np.int64], values: Array | float) -> None:
        """Let all earlier values of rows (k,) be these (k, size)."""
        self._line[:, rows] = values

    def passed(self, values: Array) -> Array:
        """The values (N, size) of some steps ago, as these (N, size) enter."""
        self._line[:-1] = self._line[1:]
        self._line[-1] = values
        return self._line[0]

    def snapshot(self) -> Array:
        """State for `restore`, a copy."""
        return self._line.copy()

    def restore(self, snapshot: Array) -> None:
        """Continue from a snapshot of the same delay and shape."""
        self._line = snapshot.copy()
