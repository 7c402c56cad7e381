"""Resampling with replacement inside strata, from named random numbers."""

import math
import zlib
from collections.abc import Iterator, Sequence

import numpy as np
from scipy.special import ndtr, stdtrit

from space_envs.errors import ConfigurationError

CONFIDENCE = 0.95  # of all intervals
HELD_VALUES = 4_000_000  # resampled values held at a time, 32 MB


def named_generator(entropy: int, *names: str) -> np.random.Generator:
    """Random generator of these names, the same whatever else draws from the same entropy (>= 0)."""
    text = "\0".join(names).encode("utf-8", "surrogatepass")
    return np.random.default_rng([entropy, zlib.crc32(text)])


def strata_groups(strata: np.ndarray) -> list[np.ndarray]:
    """Indices of the values of each stratum (n,), strata in sorted order; those of one value are pooled."""
    _, inverse = np.unique(strata, return_inverse=True)
    groups = [np.flatnonzero(inverse == number) for number in range(inverse.max() + 1)]
    single = [group for group in groups if group.size == 1]
    return [group for group in groups if group.size > 1] + ([np.concatenate(single)] if single else [])


def resampled_counts(
    groups: Sequence[np.ndarray], generator: np.random.Generator, resamples: int
) -> Iterator[np.ndarray]:
    """Counts of each of n values in each resample, drawn with replacement inside each group.

    The groups hold each index in 0..n-1 once. Yields float arrays (rows, n), with `resamples` rows altogether
    and few enough in each to bound the memory.
    """
    size = sum(group.size for group in groups)
    rows = max(1, HELD_VALUES // size)
    for start in range(0, resamples, rows):
        count = min(rows, resamples - start)
        chosen = [group[generator.integers(group.size, size=(count, group.size))] for group in groups]
        places = np.concatenate(chosen, axis=1) + size * np.arange(count)[:, None]
        times = np.bincount(places.ravel(), minlength=count * size)
        yield times.reshape(count, size).astype(np.float64)


def percentile_ends(
    drawn: np.ndarray, count: int, freedom: int, confidence: float = CONFIDENCE
) -> tuple[np.ndarray, np.ndarray]:
    """Ends of the expanded percentile interval (see `stratified_bootstrap`) along the first axis of `drawn`.

    `drawn` (resamples, ...) are figures of resamples of `count` values with `freedom` >= 1 degrees of
    freedom; returns low and high (...).
    """
    spread = math.sqrt(count / freedom) * stdtrit(freedom, (1 + confidence) / 2)
    tail = float(ndtr(-spread))
    low, high = np.quantile(drawn, [tail, 1 - tail], axis=0, method="inverted_cdf")
    return low, high


def check_resampling(resamples: int, confidence: float) -> None:
    """ConfigurationError unless resamples >= 1 and 0 < confidence < 1."""
    if resamples < 1 or not 0 < confidence < 1:
        raise ConfigurationError(f"got resamples {resamples} and confidence {confidence}")
