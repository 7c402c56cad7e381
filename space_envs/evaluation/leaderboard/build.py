"""Rows of the leaderboard from records: one row for each task and policy.

Rows are ranked by the kept-attitude score, the mean over all episodes of captured / (1 + peak attitude /
1 deg). Success, capture@N deg (of the final attitude) and kept@N deg (of the peak) are shares of all
episodes. Figures of motion and cost are over captures alone: interquartile means, and the median for the time
to capture. Without a capture they do not exist.
Planning time and time per action are medians over the episodes that have them and carry no interval.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from itertools import groupby
from types import MappingProxyType
from typing import Any

import numpy as np

from space_envs.errors import ConfigurationError
from space_envs.evaluation.leaderboard.figures import (
    HEADLINE,
    TIMINGS,
    MetricFigure,
    capture_key,
    figures_of,
    kept_key,
    metric_values,
)
from space_envs.evaluation.leaderboard.row import FailureCount, Row
from space_envs.evaluation.play.causes import CAUSES, OUTCOMES
from space_envs.evaluation.play.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.metrics import Described
from space_envs.evaluation.statistics.averages import Statistic, interquartile_mean, median
from space_envs.evaluation.statistics.intervals import MISSING, Estimate, stratified_bootstrap
from space_envs.evaluation.statistics.resampling import named_generator
from space_envs.evaluation.statistics.scores import ATTITUDE_LIMITS, capture_rate, kept_attitude_score
from space_envs.perturbations.amounts import PRESETS
from space_envs.registration import ENTRIES
from space_envs.robots.zoo import robot_names
from space_envs.tasks.common import DIFFICULTIES, SPLITS
from space_envs.tasks.goals.kinds import GOAL_KINDS

Stream = Callable[[str], np.random.Generator]  # random numbers by the name of what they are for
STATISTICS: dict[str, Statistic] = {
    "interquartile mean": interquartile_mean,
    "median": median,
    "mean": partial(np.mean, axis=-1),
}


def build_rows(
    records: Iterable[EpisodeRecord],
    generator: np.random.Generator,
    resamples: int = 5000,
    described: Described = MappingProxyType({}),
) -> list[Row]:
    """Aggregate records into rows, best first within each task.

    Sorted by the kept-attitude score, then success, then base disturbance, then name; baselines and policies
    without a capture stand behind and have no rank. The interval of a row depends on the generator and that
    row's records only, not on which other policies stand in the table. Metrics of tasks of other packages are
    shown as they are `described`. Raises ConfigurationError where an
    episode stands twice, a row would mix configurations or a table versions of its task.
    """
    groups: dict[LeaderboardEntry, list[EpisodeRecord]] = {}
    versions: dict[EvaluatedTask, set[int]] = {}
    for record in records:
        groups.setdefault(record.entry, []).append(record)
        versions.setdefault(record.entry.task, set()).add(record.task_version)
    for task, found in versions.items():
        if len(found) > 1:
            numbers = " and ".join(map(str, sorted(found)))
            raise ConfigurationError(f"records of {task} mix the versions {numbers} of the task")
    entropy = int(generator.integers(2**63))
    rows = sorted(
        (_row(key, group, entropy, resamples, described) for key, group in groups.items()), key=_order
    )
    return [
        replace(row, rank=number if row.competes else None)
        for _, group in groupby(rows, key=lambda row: row.task)
        for number, row in enumerate(group, start=1)
    ]


def _row(
    entry: LeaderboardEntry,
    records: list[EpisodeRecord],
    entropy: int,
    resamples: int,
    described: Described,
) -> Row:
    task, policy, control_mode = entry.task, entry.policy, entry.control_mode
    hashes = sorted({record.config_hash for record in records})
    if len(hashes) > 1:
        raise ConfigurationError(
            f"records of {policy!r} on {task} mix the configurations {', '.join(hashes)}"
        )
    (seed, episode), count = Counter((record.seed, record.episode) for record in records).most_common(1)[0]
    if count > 1:
        raise ConfigurationError(
            f"episode {episode} of seed {seed} of {policy!r} on {task} stands {count} times"
        )
    # The order in which episodes were run must not change the interval.
    records = sorted(records, key=lambda record: (record.seed, record.episode))

    def stream(name: str) -> np.random.Generator:
        words = (task.env_id, task.difficulty, task.split, policy, control_mode, name)
        return named_generator(entropy, *words)

    names = dict.fromkeys(name for record in records for name in record.metrics)
    metrics = figures_of(task.env_id, names, described)
    outcomes = Counter(record.outcome for record in records)
    return Row(
        rank=None,
        task=task,
        policy=policy,
        control_mode=control_mode,
        knowledge=records[0].knowledge,
        config_hash=hashes[0],
        task_version=records[0].task_version,
        episodes=len(records),
        seeds=tuple(sorted({record.seed for record in records})),
        metrics=metrics,
        figures=_shares(records, stream, resamples) | _metric_figures(records, metrics, stream, resamples),
        outcomes={outcome: outcomes[outcome] for outcome in OUTCOMES},
        failures=_failures(records),
        largest={each.key: float(_column(records, each.value).max()) for each in metrics if each.largest},
        timing={key: _timing(records, key) for key in TIMINGS},
    )


def _shares(records: list[EpisodeRecord], stream: Stream, resamples: int) -> dict[str, Estimate]:
    """Kept-attitude score, and shares of all episodes."""
    seeds = np.array([record.seed for record in records])
    captured = np.array([record.captured for record in records])
    final, peak = (metric_values(records, name) for name in ("final_attitude", "peak_attitude"))
    figures = {HEADLINE: kept_attitude_score(captured, peak, seeds, stream(HEADLINE), resamples)}
    figures["success"] = capture_rate(captured)
    for key, attitude in ((capture_key, final), (kept_key, peak)):
        figures |= {key(limit): capture_rate(captured, attitude, limit) for limit in ATTITUDE_LIMITS}
    return figures


def _metric_figures(
    records: list[EpisodeRecord], metrics: Iterable[MetricFigure], stream: Stream, resamples: int
) -> dict[str, Estimate]:
    """Figures of metrics over the episodes that each is of, MISSING where there are none."""
    captures = [record for record in records if record.captured]
    figures = {}
    for figure in metrics:
        if figure.largest:
            continue
        counted = captures if figure.display.over == "captures" else records
        figures[figure.key] = MISSING
        if counted:
            seeds = np.array([record.seed for record in counted])
            statistic = STATISTICS[figure.display.statistic]
            figures[figure.key] = stratified_bootstrap(
                _column(counted, figure.value), seeds, stream(figure.key), statistic, resamples
            )
    return figures


def _failures(records: list[EpisodeRecord]) -> tuple[FailureCount, ...]:
    """Every failed episode under its cause, the most frequent first."""
    reasons: dict[str, Counter[str]] = {}
    counts: Counter[str] = Counter()
    for record in records:
        if record.cause is not None:
            counts[record.cause] += 1
            reasons.setdefault(record.cause, Counter()).update([record.reason] if record.reason else [])
    found = []
    for cause in sorted(counts, key=lambda cause: (-counts[cause], CAUSES.index(cause))):
        texts = sorted(reasons[cause].items(), key=lambda item: (-item[1], item[0]))
        found.append(FailureCount(cause, counts[cause], texts[0][0] if texts else None))
    return tuple(found)


def _column(records: list[EpisodeRecord], of_record: Callable[[EpisodeRecord], float | None]) -> np.ndarray:
    """A value of each record (n,), +infinity where it does not exist."""
    return np.array([math.inf if (value := of_record(record)) is None else value for record in records])


def _timing(records: list[EpisodeRecord], key: str) -> float:
    values = [value for record in records if (value := record.timing[key]) is not None]
    return float(median(np.array(values))) if values else math.nan


def _order(row: Row) -> tuple[Any, ...]:
    """Sort key of a row: best first, equal rows by name."""
    task, figures = row.task, row.figures
    cost = figures["attitude_cost"].value
    merit = (-figures[HEADLINE].value, -figures["success"].value, math.inf if math.isnan(cost) else cost)
    robot = (*_place(task.robot, robot_names()), task.robot_digest)
    place = (_place(task.env_id, ENTRIES), robot, _place(task.difficulty, DIFFICULTIES))
    place = (*place, _place(task.goal, GOAL_KINDS), _place(task.split, SPLITS))
    place = (*place, _place(task.perturbation, PRESETS))
    return (*place, not row.competes, *merit, row.policy, row.control_mode)


def _place(name: str, names: Iterable[str]) -> tuple[int, str]:
    """Sort key of a name: its place in a list; names that are not in it come last."""
    names = list(names)
    return (names.index(name) if name in names else len(names), name)
