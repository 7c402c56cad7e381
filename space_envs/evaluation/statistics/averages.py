"""Statistics of a sample that may hold +infinity.

A value that an episode does not have is +infinity and so ranks behind all that exist.
"""

from collections.abc import Callable

import numpy as np

from space_envs.errors import ConfigurationError

Statistic = Callable[[np.ndarray], np.ndarray]


def interquartile_mean(values: np.ndarray) -> np.ndarray:
    """Mean along the last axis without the floor(n / 4) lowest and the floor(n / 4) highest of n values.

    This is the 25 % trimmed mean (scipy.stats.trim_mean). Values (..., n) may be +infinity; returns (...).
    """
    ordered = np.sort(sample(values), axis=-1)
    cut = ordered.shape[-1] // 4
    return ordered[..., cut : ordered.shape[-1] - cut].mean(axis=-1)


def median(values: np.ndarray) -> np.ndarray:
    """Median along the last axis of values (..., n), which may be +infinity; returns (...)."""
    ordered = np.sort(sample(values), axis=-1)
    count = ordered.shape[-1]
    return (ordered[..., (count - 1) // 2] + ordered[..., count // 2]) / 2


def mean(values: np.ndarray) -> np.ndarray:
    """Mean along the last axis of values (..., n); returns (...)."""
    return values.mean(axis=-1)


def sample(values: np.ndarray) -> np.ndarray:
    """Values as floats. Raises ConfigurationError if there are none, or for NaN or -infinity."""
    values = np.asarray(values, dtype=np.float64)
    if values.ndim == 0 or values.shape[-1] == 0:
        raise ConfigurationError("statistics need at least one value")
    if np.any(np.isnan(values) | (values == -np.inf)):
        raise ConfigurationError("values hold NaN or -infinity; a value that does not exist is +infinity")
    return values
