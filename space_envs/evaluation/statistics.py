"""Figures over episodes and their 95 % intervals.

Failures stay in the denominator. A value that an episode does not have (the time to capture of one that never
captured, the final attitude of a simulation that diverged at once) is +infinity here and so ranks behind all
that exist, lower being better in every cost of the records. A figure that would rest on such a value is
infinite, which tables show as "-", rather than being computed from the episodes that happened to succeed.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from scipy.special import ndtr, stdtrit

from space_envs.errors import ConfigurationError

CONFIDENCE = 0.95
ATTITUDE_LIMITS = (5.0, 1.0, 0.1)  # deg: capture@5deg, capture@1deg, capture@0.1deg

_CHUNK = 4_000_000  # resampled values held at a time, 32 MB

Statistic = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Estimate:
    """A figure with the ends of its 95 % interval; infinite where it rests on values that do not exist."""

    value: float
    low: float
    high: float


def interquartile_mean(values: np.ndarray) -> np.ndarray:
    """Mean along the last axis without the floor(n / 4) lowest and the floor(n / 4) highest of n values.

    This is the 25 % trimmed mean (scipy.stats.trim_mean). Values (..., n) may be +infinity; returns (...).
    """
    ordered = np.sort(_values(values), axis=-1)
    cut = ordered.shape[-1] // 4
    return ordered[..., cut : ordered.shape[-1] - cut].mean(axis=-1)


def median(values: np.ndarray) -> np.ndarray:
    """Median along the last axis of values (..., n), which may be +infinity; returns (...)."""
    ordered = np.sort(_values(values), axis=-1)
    count = ordered.shape[-1]
    return (ordered[..., (count - 1) // 2] + ordered[..., count // 2]) / 2


def stratified_bootstrap(
    values: np.ndarray,
    strata: np.ndarray,
    generator: np.random.Generator,
    statistic: Statistic = interquartile_mean,
    resamples: int = 5000,
    confidence: float = CONFIDENCE,
) -> Estimate:
    """Percentile bootstrap of `statistic`, resampling with replacement inside each stratum.

    Values (n,) and strata (n,), here the seed of each episode. Strata of a single value cannot vary by
    themselves and would make the interval vanish, so they are pooled into one stratum. Plain percentiles are
    too narrow for few values in H strata; the tails are widened as in Hesterberg's expanded percentile
    interval (What Teachers Should Know About the Bootstrap, The American Statistician 69, 2015): t quantiles
    of n - H degrees of freedom, and n / (n - H) for the variance. Ends are order statistics of the resamples,
    since interpolation would turn infinite values into NaN. A single value gives no interval: its ends are
    infinite.
    Raises ConfigurationError for empty, NaN or mismatched input.
    """
    values, strata = _values(values), np.asarray(strata)
    if values.ndim != 1 or values.shape != strata.shape:
        raise ConfigurationError(
            f"values and strata must have one shape (n,), got {values.shape}, {strata.shape}"
        )
    if resamples < 1 or not 0 < confidence < 1:
        raise ConfigurationError(f"got resamples {resamples} and confidence {confidence}")
    groups = _groups(strata)
    freedom = values.size - len(groups)
    if freedom == 0:
        return Estimate(float(statistic(values)), -math.inf, math.inf)
    drawn = np.empty(resamples)
    rows = max(1, _CHUNK // values.size)
    for start in range(0, resamples, rows):
        count = min(rows, resamples - start)
        chosen = [group[generator.integers(group.size, size=(count, group.size))] for group in groups]
        drawn[start : start + count] = statistic(values[np.concatenate(chosen, axis=1)])
    spread = math.sqrt(values.size / freedom) * stdtrit(freedom, (1 + confidence) / 2)
    tail = float(ndtr(-spread))
    low, high = np.quantile(drawn, [tail, 1 - tail], method="inverted_cdf")
    return Estimate(float(statistic(values)), float(low), float(high))


def wilson_interval(successes: int, trials: int, confidence: float = CONFIDENCE) -> Estimate:
    """Rate of successes in 0..1 with Wilson's score interval; ConfigurationError for impossible counts."""
    if not 0 <= successes <= trials or trials < 1:
        raise ConfigurationError(f"got {successes} successes in {trials} trials")
    z = NormalDist().inv_cdf((1 + confidence) / 2)
    rate = successes / trials
    scale = 1 + z * z / trials
    centre = (rate + z * z / (2 * trials)) / scale
    half = z / scale * math.sqrt(rate * (1 - rate) / trials + z * z / (4 * trials * trials))
    # With no or only successes one end is the rate itself; rounding would put it beside.
    low = 0.0 if successes == 0 else centre - half
    high = 1.0 if successes == trials else centre + half
    return Estimate(rate, low, high)


def capture_rate(
    captured: np.ndarray, final_attitude: np.ndarray | None = None, limit: float | None = None
) -> Estimate:
    """Share of all episodes that captured and, with a limit [deg], ended within that base attitude.

    Captured (n,) bool, final attitude (n,) deg. One that turned the satellite further is a failure.
    """
    counted = np.asarray(captured, dtype=bool)
    if limit is not None:
        if final_attitude is None or np.shape(final_attitude) != counted.shape:
            raise ConfigurationError("a limit needs the final attitude of each episode")
        counted = counted & (np.asarray(final_attitude) <= limit)
    return wilson_interval(int(counted.sum()), counted.size)


def _values(values: np.ndarray) -> np.ndarray:
    values = np.asarray(values, dtype=np.float64)
    if values.ndim == 0 or values.shape[-1] == 0:
        raise ConfigurationError("statistics need at least one value")
    if np.any(np.isnan(values) | (values == -np.inf)):
        raise ConfigurationError("values hold NaN or -infinity; a value that does not exist is +infinity")
    return values


def _groups(strata: np.ndarray) -> list[np.ndarray]:
    """Indices of each stratum, in sorted order of the strata; single ones are pooled at the end."""
    _, inverse = np.unique(strata, return_inverse=True)
    groups = [np.flatnonzero(inverse == number) for number in range(inverse.max() + 1)]
    single = [group for group in groups if group.size == 1]
    return [group for group in groups if group.size > 1] + ([np.concatenate(single)] if single else [])
