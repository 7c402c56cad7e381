"""Policies of one task against each other.

Performance profiles and probabilities of improvement follow Agarwal et al. (Deep Reinforcement Learning at
the Edge of the Statistical Precipice, NeurIPS 2021); the strata of every bootstrap are the seeds. Costs are
lower for better, and an episode that did not capture has none, +infinity here: a profile counts it as more
than any capture, and two policies are compared over what both captured. The kept-attitude score has a value
for every episode and compares them all.
"""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from space_envs.errors import ConfigurationError, unknown_name
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.statistics.figures import HEADLINE, metric_values
from space_envs.evaluation.statistics.intervals import (
    CONFIDENCE,
    MISSING,
    Estimate,
    Estimates,
    check_resampling,
    kept_attitude,
    named_generator,
    percentile_ends,
    resampled_counts,
    share_bootstrap,
    strata_groups,
)
from space_envs.evaluation.statistics.row import Row

COSTS = ("final_attitude", "attitude_cost", "time_to_capture")
COMPARED = (HEADLINE, *COSTS)
FRONT = (
    "A policy is on the Pareto front where no other has at least its kept-attitude score and takes at most as"
    " long from the goal to the first action, and is better in one of the two. hold, random and policies "
    "without a capture are never on it."
)


@dataclass(frozen=True)
class Improvement:
    """How likely one policy is better than another, for each pair of p policies.

    Attributes:
        entries: the p policies, in order. probability: (p, p), entry [i, j] that i beats j, ties counted
            half; the diagonal is 1/2, NaN where there is nothing to compare.
        paired: (p, p) bool, whether both played the same goals, so that the comparison is goal by goal.
        count: (p, p) int, goals that are compared: for a cost those that both captured. Where the goals are
            not the same, episodes of i that are compared with those of j.
    """

    entries: tuple[LeaderboardEntry, ...]
    probability: Estimates
    paired: np.ndarray
    count: np.ndarray


@dataclass(frozen=True)
class Standing:
    """Where a policy stands in the kept-attitude score and waiting time, and who keeps it off the front."""

    entry: LeaderboardEntry
    score: float  # 0..1
    success: float  # 0..1
    wait: float  # ms from goal to first action: planning and one action; +infinity where nothing was timed
    competes: bool  # as `Row.competes`
    dominated_by: tuple[LeaderboardEntry, ...]  # those of what competes

    @property
    def on_front(self) -> bool:
        """Whether it is on the Pareto front, as FRONT says in words."""
        return self.competes and not self.dominated_by


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
    square = _square(len(costs))
    first, second = np.triu_indices(len(costs), 1)
    if not first.size:
        return square
    won = (costs[first] < costs[second]) + 0.5 * (costs[first] == costs[second])
    _fill(square, first, second, share_bootstrap(won.T, strata, generator, resamples))
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


def dominance(costs: np.ndarray) -> np.ndarray:
    """Who dominates whom among n points of k costs (n, k), which may be +infinity: bool (n, n).

    [i, j] is True where i is nowhere worse than j and somewhere better; equal points do not dominate each
    other.
    """
    costs = np.asarray(costs, dtype=np.float64)
    if costs.ndim != 2 or np.isnan(costs).any():
        raise ConfigurationError(f"expected costs (n, k) without NaN, got {costs.shape}")
    one, other = costs[:, None], costs[None]
    return np.logical_and((one <= other).all(axis=-1), (one < other).any(axis=-1))


def pareto_front(rows: Sequence[Row]) -> list[Standing]:
    """Kept-attitude score (more is better) and waiting time (less is better) of the rows of one task.

    In the order of the rows; FRONT says in words who is on the front. A policy that makes no plan waits for
    its action alone.
    """
    _one_task([row.entry for row in rows])
    score = np.array([row.figures[HEADLINE].value for row in rows])
    times = [[value for value in row.timing.values() if not math.isnan(value)] for row in rows]
    wait = np.array([sum(known) if known else math.inf for known in times])
    competes = np.array([row.competes for row in rows], dtype=bool)
    better = dominance(np.stack([-score, wait], axis=1)) & competes[:, None]
    return [
        Standing(
            row.entry,
            float(score[number]),
            row.figures["success"].value,
            float(wait[number]),
            row.competes,
            tuple(other.entry for other, above in zip(rows, better[:, number], strict=True) if above),
        )
        for number, row in enumerate(rows)
    ]


def profiles(
    records: Sequence[EpisodeRecord],
    metric: str,
    tau: np.ndarray,
    generator: np.random.Generator,
    resamples: int = 5000,
) -> dict[LeaderboardEntry, Estimates]:
    """The performance profile of each policy of one task; metric is one of COSTS, tau in its unit.

    A profile does not depend on which other policies there are.
    """
    entropy = int(generator.integers(2**63))
    found = {}
    for entry, played in by_entry(records).items():
        stream = named_generator(entropy, metric, *words(entry))
        found[entry] = performance_profile(
            episode_costs(played, metric), seeds_of(played), tau, stream, resamples
        )
    return found


def improvements(
    records: Sequence[EpisodeRecord], metric: str, generator: np.random.Generator, resamples: int = 5000
) -> Improvement:
    """Probability of improvement in one of COMPARED between all policies of one task.

    Policies that played the same goals with the same seeds are compared goal by goal, others by all their
    episodes; costs over what both captured. The figures of a pair do not depend on which other policies there
    are.
    """
    entropy = int(generator.integers(2**63))
    players = by_entry(records)
    entries = tuple(players)
    values = [_compared(played, metric) for played in players.values()]
    seeds = [seeds_of(played) for played in players.values()]
    goals = [tuple((record.seed, record.index) for record in played) for played in players.values()]
    number = len(entries)
    square, paired = _square(number), np.zeros((number, number), dtype=bool)
    count = np.diag([int(np.isfinite(each).sum()) for each in values])
    for i, j in zip(*np.triu_indices(number, 1), strict=True):
        stream = named_generator(entropy, metric, *words(entries[i]), *words(entries[j]))
        there = [np.isfinite(values[each]) for each in (i, j)]
        # A goal that stands twice under one seed cannot be matched with its like.
        if goals[i] == goals[j] and len(set(goals[i])) == len(goals[i]):
            paired[i, j] = paired[j, i] = True
            there = [there[0] & there[1]] * 2
        count[i, j], count[j, i] = (int(each.sum()) for each in there)
        found = MISSING
        if all(each.any() for each in there):
            first, second = (
                (values[each][kept], seeds[each][kept]) for each, kept in zip((i, j), there, strict=True)
            )
            found = _improvement(first, second, bool(paired[i, j]), stream, resamples)
        _fill(square, i, j, found)
    return Improvement(entries, square, paired, count)


def _improvement(
    first: tuple[np.ndarray, np.ndarray],
    second: tuple[np.ndarray, np.ndarray],
    paired: bool,
    generator: np.random.Generator,
    resamples: int,
) -> Estimate:
    """Of values and strata against values and strata."""
    if not paired:
        return unpaired_improvement(first[0], second[0], first[1], second[1], generator, resamples)
    found = paired_improvement(np.stack([first[0], second[0]]), first[1], generator, resamples)
    return Estimate(*(float(end[0, 1]) for end in (found.value, found.low, found.high)))


def by_entry(records: Sequence[EpisodeRecord]) -> dict[LeaderboardEntry, list[EpisodeRecord]]:
    """Records of each policy, in the order of seed and goal. ConfigurationError for several tasks."""
    players: dict[LeaderboardEntry, list[EpisodeRecord]] = {}
    for record in records:
        players.setdefault(record.entry, []).append(record)
    _one_task(players)
    return {
        entry: sorted(players[entry], key=lambda record: (record.seed, record.index, record.episode))
        for entry in sorted(players)
    }


def episode_costs(records: Sequence[EpisodeRecord], metric: str) -> np.ndarray:
    """One of COSTS of each episode (n,), +infinity where it did not capture."""
    if metric not in COSTS:
        raise unknown_name("cost", metric, COSTS)
    return np.where([record.captured for record in records], metric_values(records, metric), math.inf)


def _compared(records: Sequence[EpisodeRecord], metric: str) -> np.ndarray:
    """What of each episode is compared (n,), lower for better, +infinity where there is nothing."""
    if metric != HEADLINE:
        return episode_costs(records, metric)
    captured = np.array([record.captured for record in records])
    return -kept_attitude(captured, metric_values(records, "peak_attitude"))


def seeds_of(records: Sequence[EpisodeRecord]) -> np.ndarray:
    """The strata (n,)."""
    return np.array([record.seed for record in records])


def words(entry: LeaderboardEntry) -> tuple[str, ...]:
    """All names of a policy and its task, to name its random numbers by."""
    task = entry.task
    return (task.env_id, task.difficulty, task.split, entry.policy, entry.control_mode)


def _square(count: int) -> Estimates:
    """Every one against itself."""
    return Estimates(*(np.full((count, count), 0.5) for _ in range(3)))


def _fill(square: Estimates, i: Any, j: Any, found: Estimate | Estimates) -> None:
    """Enter figures of i against j, and of j against i."""
    square.value[i, j], square.low[i, j], square.high[i, j] = found.value, found.low, found.high
    square.value[j, i], square.low[j, i], square.high[j, i] = 1 - found.value, 1 - found.high, 1 - found.low


def _one_task(entries: Collection[LeaderboardEntry]) -> None:
    tasks = sorted({entry.task for entry in entries})
    if len(tasks) > 1:
        raise ConfigurationError(
            f"policies of different tasks cannot be compared: {'; '.join(map(str, tasks))}"
        )
