"""Performance profiles and probabilities of improvement of samples.

They follow Agarwal et al. (Deep Reinforcement Learning at the Edge of the Statistical Precipice, NeurIPS
2021); the strata of every bootstrap are the seeds.
"""

from typing import Any

import numpy as np

from space_envs.errors import ConfigurationError
from space_envs.evaluation.statistics.intervals import Estimate, Estimates, share_bootstrap
from space_envs.evaluation.statistics.resampling import (
    CONFIDENCE,
    check_resampling,
    percentile_ends,
    resampled_counts,
    strata_groups,
)


def performance_profile(
    costs: np.ndarray,
    strata: np.ndarray,
    tau: np.ndarray,
    generator: np.random.Generator,
    resamples: int = 5000,
) -> Estimates:
    """Share of episodes with a cost of at most each tau, with pointwise intervals.

    Costs (n,), +infinity for failures, strata (n,), finite tau (m,); returns shares (m,). Raises
    ConfigurationError for empty, NaN or mismatched input.
    """
    costs, tau = np.asarray(costs, dtype=np.float64), np.asarray(tau, dtype=np.float64)
    if costs.ndim != 1 or tau.ndim != 1 or np.isnan(costs).any() or not np.isfinite(tau).all():
        raise ConfigurationError(
            f"expected costs (n,) without NaN and finite tau (m,), got {costs.shape} and {tau.shape}"
        )
    within = (costs[:, None] <= tau).astype(np.float64)
    return share_bootstrap(within, strata, generator, resamples)


def paired_improvement(
    costs: np.ndarray, strata: np.ndarray, generator: np.random.Generator, resamples: int = 5000
) -> Estimates:
    """P(X < Y) + P(X = Y) / 2 over the same goals, for every pair of policies.

    Costs (p, n) of p policies on n goals, failures +infinity; strata (n,). Goals are resampled, each with the
    costs of all policies. Returns (p, p), entry [i, j] for i against j; entries [j, i] are the complements.
    """
    costs = np.asarray(costs, dtype=np.float64)
    if costs.ndim != 2 or np.isnan(costs).any():
        raise ConfigurationError(f"expected costs (p, n) without NaN, got {costs.shape}")
    square = even_odds(len(costs))
    first, second = np.triu_indices(len(costs), 1)
    if not first.size:
        return square
    won = (costs[first] < costs[second]) + 0.5 * (costs[first] == costs[second])
    set_pair(square, first, second, share_bootstrap(won.T, strata, generator, resamples))
    return square


def unpaired_improvement(
    first: np.ndarray,
    second: np.ndarray,
    first_strata: np.ndarray,
    second_strata: np.ndarray,
    generator: np.random.Generator,
    resamples: int = 5000,
    confidence: float = CONFIDENCE,
) -> Estimate:
    """P(X < Y) + P(X = Y) / 2 over all pairs of an episode of each: Mann and Whitney's U over n m.

    Costs (n,) and (m,), failures +infinity, with their strata. Each sample is resampled by itself. So that
    samples apart from each other do not get an interval without width, one episode is added to each where
    the interval is drawn: with equal chances better or worse than all others (compare `share_bootstrap`). A
    single episode against a single one has the interval from 0 to 1. Raises ConfigurationError for empty or
    NaN input.
    """
    check_resampling(resamples, confidence)
    first, second = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    n, m = len(first), len(second)
    if not n or not m or np.isnan(first).any() or np.isnan(second).any():
        raise ConfigurationError(
            f"expected costs (n,) and (m,) without NaN, got {first.shape}, {second.shape}"
        )
    order = np.argsort(second, kind="stable")
    below, upto = (np.searchsorted(second[order], first, side) for side in ("left", "right"))
    value = float(1 - (below + upto).mean() / (2 * m))
    groups, others = strata_groups(np.asarray(first_strata)), strata_groups(np.asarray(second_strata)[order])
    freedom = n + m - len(groups) - len(others)
    if freedom == 0:
        return Estimate(value, 0.0, 1.0)
    drawn = []
    for times in resampled_counts([*groups, *(n + group for group in others)], generator, resamples):
        smaller = np.pad(np.cumsum(times[:, n:], axis=1), ((0, 0), (1, 0)))
        won = (times[:, :n] * (m - (smaller[:, below] + smaller[:, upto]) / 2)).sum(axis=1)
        better, other_better = generator.integers(2, size=(2, len(times)))
        won += better * m + (1 - other_better) * n + (1 + better - other_better) / 2
        drawn.append(won / ((n + 1) * (m + 1)))
    low, high = percentile_ends(np.concatenate(drawn), n + m, freedom, confidence)
    return Estimate(value, min(float(low), value), max(float(high), value))


def even_odds(count: int) -> Estimates:
    """Estimates (n, n) of 1/2: equal chances for every pair."""
    return Estimates(*(np.full((count, count), 0.5) for _ in range(3)))


def set_pair(square: Estimates, i: Any, j: Any, found: Estimate | Estimates) -> None:
    """Enter figures of i against j, and of j against i."""
    square.value[i, j], square.low[i, j], square.high[i, j] = found.value, found.low, found.high
    square.value[j, i], square.low[j, i], square.high[j, i] = 1 - found.value, 1 - found.high, 1 - found.low
