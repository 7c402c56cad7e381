"""Probabilities of improvement and performance profiles of the policies of one task, from their records."""

import math
from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from space_envs.errors import ConfigurationError, unknown_name
from space_envs.evaluation.leaderboard.figures import HEADLINE, metric_values
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.statistics.improvement import (
    even_odds,
    paired_improvement,
    performance_profile,
    set_pair,
    unpaired_improvement,
)
from space_envs.evaluation.statistics.intervals import (
    MISSING,
    Estimate,
    Estimates,
)
from space_envs.evaluation.statistics.resampling import (
    named_generator,
)
from space_envs.tasks.outcome import kept_attitude

COSTS = ("final_attitude", "attitude_cost", "time_to_capture")
COMPARED = (HEADLINE, *COSTS)


@dataclass(frozen=True)
class Improvement:
    """Probability that one policy is better than another, for each pair of p policies.

    Attributes:
        entries: the p policies, in order. probability: (p, p), entry [i, j] that i beats j, ties counted
            half; the diagonal is 1/2, NaN where there is nothing to compare.
        paired: (p, p) bool, whether both had the same goals, so that the comparison is goal by goal.
        count: (p, p) int, goals that are compared: for a cost those that both captured. Where the goals are
            not the same, episodes of i that are compared with those of j.
    """

    entries: tuple[LeaderboardEntry, ...]
    probability: Estimates
    paired: np.ndarray
    count: np.ndarray


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
    square, paired = even_odds(number), np.zeros((number, number), dtype=bool)
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
        set_pair(square, i, j, found)
    return Improvement(entries, square, paired, count)


def _improvement(
    first: tuple[np.ndarray, np.ndarray],
    second: tuple[np.ndarray, np.ndarray],
    paired: bool,
    generator: np.random.Generator,
    resamples: int,
) -> Estimate:
    """Probability that values are better than other values, each with their strata."""
    if not paired:
        return unpaired_improvement(first[0], second[0], first[1], second[1], generator, resamples)
    found = paired_improvement(np.stack([first[0], second[0]]), first[1], generator, resamples)
    return Estimate(*(float(end[0, 1]) for end in (found.value, found.low, found.high)))


def by_entry(records: Sequence[EpisodeRecord]) -> dict[LeaderboardEntry, list[EpisodeRecord]]:
    """Records of each policy, in the order of seed and goal. ConfigurationError for several tasks."""
    players: dict[LeaderboardEntry, list[EpisodeRecord]] = {}
    for record in records:
        players.setdefault(record.entry, []).append(record)
    check_one_task(players)
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
    """Value of each episode (n,) in a comparison, lower for better, +infinity where there is none."""
    if metric != HEADLINE:
        return episode_costs(records, metric)
    captured = np.array([record.captured for record in records])
    return -kept_attitude(captured, metric_values(records, "peak_attitude"))


def seeds_of(records: Sequence[EpisodeRecord]) -> np.ndarray:
    """Evaluation seeds (n,) of records, the strata of the bootstrap."""
    return np.array([record.seed for record in records])


def words(entry: LeaderboardEntry) -> tuple[str, ...]:
    """Names of a policy and its task, from which its random numbers are seeded."""
    task = entry.task
    return (task.env_id, task.difficulty, task.split, entry.policy, entry.control_mode)


def check_one_task(entries: Collection[LeaderboardEntry]) -> None:
    """Refuse entries of several tasks. Raises ConfigurationError."""
    tasks = sorted({entry.task for entry in entries})
    if len(tasks) > 1:
        raise ConfigurationError(
            f"policies of different tasks cannot be compared: {'; '.join(map(str, tasks))}"
        )
