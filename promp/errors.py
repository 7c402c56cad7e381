"""Every exception that this package raises on purpose."""

import numpy as np
from numpy.typing import NDArray


class PrompError(ValueError):
    """An argument has the wrong shape or value; the message says what was got and what was expected."""


class ConditioningError(PrompError):
    """The distribution cannot meet the target: it has no variance in the direction of the target.

    `residual` (m,) is that of each conditioned quantity, and `row` the worst of them.
    """

    def __init__(self, message: str, residual: NDArray[np.float64], row: int):
        super().__init__(message)
        self.residual = residual
        self.row = row

    def __reduce__(self) -> tuple[type, tuple[str, NDArray[np.float64], int]]:
        # The default rebuilds an exception from its message alone, which would fail in a worker process.
        return type(self), (str(self), self.residual, self.row)


class StorageError(PrompError):
    """A file is not a whole, untouched ProMP of a known format version."""
