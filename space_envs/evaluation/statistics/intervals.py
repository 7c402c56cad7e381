"""Figures over episodes and their 95 % intervals.

Failures stay in the denominator. A value that an episode does not have (the time to capture of one that never
captured, the final attitude of a simulation that diverged at once) is +infinity here and so ranks behind all
that exist, lower being better in every cost of the records. A figure that would rest on such a value is
infinite, which tables show as "-", rather than being computed from the episodes that happened to succeed.
"""

import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from scipy.special import ndtr, ndtri, stdtrit

from space_envs.errors import ConfigurationError

CONFIDENCE = 0.95
ATTITUDE_LIMITS = (5.0, 1.0, 0.1)  # deg: of the final attitude for capture@5deg, of the peak for kept@5deg

_CHUNK = 4_000_000  # resampled values held at a time, 32 MB
_ADDED = 4  # episodes of share_bootstrap, half of value 0 and half of value 1

Statistic = Callable[[np.ndarray], np.ndarray]


@dataclass(frozen=True)
class Estimate:
    """A figure with the ends of its 95 % interval; infinite where it rests on values that do not exist."""

    value: float
    low: float
    high: float


MISSING = Estimate(math.nan, math.nan, math.nan)  # a figure of no episodes


@dataclass(frozen=True, eq=False)
class Estimates:
    """Many figures with the ends of their pointwise 95 % intervals: three arrays of one shape."""

    value: np.ndarray
    low: np.ndarray
    high: np.ndarray


def named_generator(entropy: int, *names: str) -> np.random.Generator:
    """A generator for what has these names: the same whatever else draws from the same entropy (>= 0)."""
    text = "\0".join(names).encode("utf-8", "surrogatepass")
    return np.random.default_rng([entropy, zlib.crc32(text)])


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
    check_resampling(resamples, confidence)
    groups = strata_groups(strata)
    freedom = values.size - len(groups)
    if freedom == 0:
        return Estimate(float(statistic(values)), -math.inf, math.inf)
    drawn = np.empty(resamples)
    rows = max(1, _CHUNK // values.size)
    for start in range(0, resamples, rows):
        count = min(rows, resamples - start)
        chosen = [group[generator.integers(group.size, size=(count, group.size))] for group in groups]
        drawn[start : start + count] = statistic(values[np.concatenate(chosen, axis=1)])
    low, high = percentile_ends(drawn, values.size, freedom, confidence)
    return Estimate(float(statistic(values)), float(low), float(high))


def share_bootstrap(
    values: np.ndarray,
    strata: np.ndarray,
    generator: np.random.Generator,
    resamples: int = 5000,
    confidence: float = CONFIDENCE,
) -> Estimates:
    """Means of the columns of values (n, m), each 0, 1/2 or 1, with stratified bootstrap intervals (m,).

    For shares of episodes and of won comparisons. The rows of all columns are resampled together. Resampling
    a share of 0 or 1 returns it every time, an interval without width, and shares near them lie on few steps,
    which percentiles jump over. So intervals are Agresti and Coull's (The American Statistician 52, 1998),
    with the variance of the resampled sums: two episodes of value 0 and two of value 1 are added to the n,
    and the ends lie a normal quantile of standard deviations from the mean. The variance is widened by
    n / (n - H) for H strata; the values are without the added episodes. A single row gives the interval from
    0 to 1. Raises ConfigurationError for empty, mismatched or other values.
    """
    values, strata = _values(values), np.asarray(strata)
    if values.ndim != 2 or not len(values) or strata.shape != values.shape[:1]:
        raise ConfigurationError(
            f"expected values (n, m) and strata (n,), got {values.shape}, {strata.shape}"
        )
    if not np.isin(values, (0.0, 0.5, 1.0)).all():
        raise ConfigurationError("values of shares must be 0, 1/2 or 1")
    check_resampling(resamples, confidence)
    count, width = values.shape
    groups, value = strata_groups(strata), values.mean(axis=0)
    freedom = count - len(groups)
    if freedom == 0:
        return Estimates(value, np.zeros(width), np.ones(width))
    # Sums of halves are exact, so that a column has its interval beside any others.
    total = squares = np.zeros(width)
    for times in resampled_counts(groups, generator, resamples):
        drawn = times @ values
        total, squares = total + drawn.sum(axis=0), squares + (drawn**2).sum(axis=0)
    variance = np.maximum(squares / resamples - (total / resamples) ** 2, 0) * count / freedom
    reach = float(ndtri((1 + confidence) / 2)) * np.sqrt(variance + _ADDED / 4)
    middle = count * value + _ADDED / 2
    low, high = (np.clip(end / (count + _ADDED), 0, 1) for end in (middle - reach, middle + reach))
    return Estimates(value, np.minimum(low, value), np.maximum(high, value))


def strata_groups(strata: np.ndarray) -> list[np.ndarray]:
    """Indices of the values of each stratum (n,), strata in sorted order; those of one value are pooled."""
    _, inverse = np.unique(strata, return_inverse=True)
    groups = [np.flatnonzero(inverse == number) for number in range(inverse.max() + 1)]
    single = [group for group in groups if group.size == 1]
    return [group for group in groups if group.size > 1] + ([np.concatenate(single)] if single else [])


def resampled_counts(
    groups: Sequence[np.ndarray], generator: np.random.Generator, resamples: int
) -> Iterator[np.ndarray]:
    """How often each of n values stands in each resample, drawn with replacement inside each group.

    The groups hold each index in 0..n-1 once. Yields float arrays (rows, n), with `resamples` rows altogether
    and few enough in each to bound the memory.
    """
    size = sum(group.size for group in groups)
    rows = max(1, _CHUNK // size)
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
    captured: np.ndarray, attitude: np.ndarray | None = None, limit: float | None = None
) -> Estimate:
    """Share of all episodes that captured and, with a limit [deg], whose base attitude was within it.

    Captured (n,) bool, attitude (n,) deg, that at the end or the peak. One that turned the satellite further
    is a failure.
    """
    counted = np.asarray(captured, dtype=bool)
    if limit is not None:
        if attitude is None or np.shape(attitude) != counted.shape:
            raise ConfigurationError("a limit needs the attitude of each episode")
        counted = counted & (np.asarray(attitude) <= limit)
    return wilson_interval(int(counted.sum()), counted.size)


def kept_attitude(captured: np.ndarray, peak: np.ndarray) -> np.ndarray:
    """Score (n,) of each episode: captured / (1 + peak attitude / 1 deg).

    Captured (n,) bool, peak (n,) deg, +infinity where it does not exist. A failure scores 0, a capture that
    never turned the base 1, one that turned it by 1 deg on the way 1/2.
    """
    return np.asarray(captured, dtype=bool) / (1.0 + np.asarray(peak, dtype=np.float64))


def kept_attitude_score(
    captured: np.ndarray,
    peak: np.ndarray,
    strata: np.ndarray,
    generator: np.random.Generator,
    resamples: int = 5000,
) -> Estimate:
    """Mean of `kept_attitude` over all n episodes, the success rate times the mean over captures.

    A bootstrap of all episodes would give a policy that never failed an interval that knows no failures. So
    the rate has Wilson's interval, the mean over captures the stratified bootstrap's, and both are put
    together as the logarithms of independent factors are (Zou and Donner, Construction of confidence limits
    about effect measures, Statistics in Medicine 27, 2008). Without a capture the mean may be anything to 1.
    """
    captured = np.asarray(captured, dtype=bool)
    scores = kept_attitude(captured, peak)
    rate = capture_rate(captured)
    if not captured.any():
        return Estimate(0.0, 0.0, rate.high)
    strata = np.asarray(strata)[captured]
    kept = stratified_bootstrap(scores[captured], strata, generator, _mean, resamples)
    value = rate.value * kept.value
    below = _together(rate.low / rate.value, max(kept.low, 0.0) / kept.value)
    above = _together(rate.value / rate.high, kept.value / min(kept.high, 1.0))
    return Estimate(value, value * below, min(1.0, value / above))


def _mean(values: np.ndarray) -> np.ndarray:
    return values.mean(axis=-1)


def _together(first: float, second: float) -> float:
    """The ratio in 0..1 whose logarithm is as long as those of two ratios at right angles."""
    if min(first, second) <= 0.0:
        return 0.0
    return math.exp(-math.hypot(math.log(first), math.log(second)))


def check_resampling(resamples: int, confidence: float) -> None:
    """ConfigurationError unless resamples >= 1 and 0 < confidence < 1."""
    if resamples < 1 or not 0 < confidence < 1:
        raise ConfigurationError(f"got resamples {resamples} and confidence {confidence}")


def _values(values: np.ndarray) -> np.ndarray:
    values = np.asarray(values, dtype=np.float64)
    if values.ndim == 0 or values.shape[-1] == 0:
        raise ConfigurationError("statistics need at least one value")
    if np.any(np.isnan(values) | (values == -np.inf)):
        raise ConfigurationError("values hold NaN or -infinity; a value that does not exist is +infinity")
    return values
