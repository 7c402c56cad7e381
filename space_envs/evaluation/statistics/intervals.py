"""Estimates and their 95 % intervals."""

import math
from dataclasses import dataclass
from statistics import NormalDist

import numpy as np
from scipy.special import ndtri

from space_envs.errors import ConfigurationError
from space_envs.evaluation.statistics.averages import Statistic, interquartile_mean, sample
from space_envs.evaluation.statistics.resampling import (
    CONFIDENCE,
    HELD_VALUES,
    check_resampling,
    percentile_ends,
    resampled_counts,
    strata_groups,
)

_ADDED = 4  # episodes of share_bootstrap, half of value 0 and half of value 1


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
    values, strata = sample(values), np.asarray(strata)
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
    rows = max(1, HELD_VALUES // values.size)
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
    values, strata = sample(values), np.asarray(strata)
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
