"""Capture rates and the kept-attitude score."""

import math

import numpy as np

from space_envs.errors import ConfigurationError
from space_envs.evaluation.statistics.averages import mean
from space_envs.evaluation.statistics.intervals import Estimate, stratified_bootstrap, wilson_interval
from space_envs.tasks.outcome import kept_attitude

ATTITUDE_LIMITS = (5.0, 1.0, 0.1)  # deg: of the final attitude for capture@5deg, of the peak for kept@5deg


def capture_rate(
    captured: np.ndarray, attitude: np.ndarray | None = None, limit: float | None = None
) -> Estimate:
    """Share of all episodes that captured and, with a limit [deg], whose base attitude was within it.

    Captured (n,) bool, attitude (n,) deg, that at the end or the peak. One that rotated the satellite further
    is a failure.
    """
    counted = np.asarray(captured, dtype=bool)
    if limit is not None:
        if attitude is None or np.shape(attitude) != counted.shape:
            raise ConfigurationError("a limit needs the attitude of each episode")
        counted = counted & (np.asarray(attitude) <= limit)
    return wilson_interval(int(counted.sum()), counted.size)


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
    kept = stratified_bootstrap(scores[captured], strata, generator, mean, resamples)
    value = rate.value * kept.value
    below = _together(rate.low / rate.value, max(kept.low, 0.0) / kept.value)
    above = _together(rate.value / rate.high, kept.value / min(kept.high, 1.0))
    return Estimate(value, value * below, min(1.0, value / above))


def _together(first: float, second: float) -> float:
    """Ratio in 0..1 whose logarithm is the root of the summed squares of those of two ratios."""
    if min(first, second) <= 0.0:
        return 0.0
    return math.exp(-math.hypot(math.log(first), math.log(second)))
