"""From records to the rows of the leaderboard: one row for each task and policy.

Rows are ranked by the kept-attitude score, the mean over all episodes of captured / (1 + peak attitude /
1 deg). Success, capture@N deg (of the final attitude) and kept@N deg (of the peak) are shares of all
episodes. What tells of a motion or its cost is over the captures alone, interquartile means and for the time
to capture the median: a failure is no gentle capture. Where a policy captured nothing these figures do not
exist.
Planning time and time per action are medians over the episodes that have them and carry no interval.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, replace
from itertools import groupby
from operator import attrgetter
from typing import Any

import numpy as np

from space_envs.errors import ConfigurationError
from space_envs.evaluation.records.record import CAUSES, OUTCOMES, Entrant, EpisodeRecord, Task
from space_envs.evaluation.statistics.intervals import (
    ATTITUDE_LIMITS,
    MISSING,
    Estimate,
    Statistic,
    capture_rate,
    interquartile_mean,
    kept_attitude_score,
    median,
    named_generator,
    stratified_bootstrap,
)
from space_envs.registration import ENTRIES
from space_envs.tasks.common import DIFFICULTIES, SPLITS

HEADLINE = "kept_attitude_score"
BASELINES = ("hold", "random")  # what others are compared with; never the best
TIMINGS = ("planning_ms", "action_ms")
DRIFTS = ("linear_momentum_drift", "angular_momentum_drift")


def cost_times_duration(record: EpisodeRecord) -> float | None:
    """Eq. 20 times the time until the envelope is entered, m^2; None without a capture.

    The cost of a path falls with the time that it takes, this does not: it is the least for a path that is
    run at an even pace, the square of its length in the metric of eq. 20.
    """
    if record.attitude_cost is None or record.time_to_envelope is None:
        return None
    return record.attitude_cost * record.time_to_envelope


# Figures over captures: what of a record, and the statistic.
_OVER_CAPTURES: dict[str, tuple[Callable[[EpisodeRecord], float | None], Statistic]] = {
    "final_attitude": (attrgetter("final_attitude"), interquartile_mean),
    "peak_attitude": (attrgetter("peak_attitude"), interquartile_mean),
    "attitude_cost": (attrgetter("attitude_cost"), interquartile_mean),
    "cost_times_duration": (cost_times_duration, interquartile_mean),
    "time_to_capture": (attrgetter("time_to_capture"), median),
    "position_error_at_capture": (attrgetter("position_error"), interquartile_mean),
    "orientation_error_at_capture": (attrgetter("orientation_error"), interquartile_mean),
    "base_angular_impulse": (attrgetter("base_angular_impulse"), interquartile_mean),
    "kinetic_energy_integral": (attrgetter("kinetic_energy_integral"), interquartile_mean),
    "mechanical_work": (attrgetter("mechanical_work"), interquartile_mean),
    "peak_power": (attrgetter("peak_power"), interquartile_mean),
}


@dataclass(frozen=True)
class FailureCount:
    """How many episodes of a row failed for a cause, and the sentence about it that stands most often."""

    cause: str  # one of CAUSES
    count: int
    reason: str | None


@dataclass(frozen=True)
class Row:
    """One policy on one task, in the units of the records; rates in 0..1."""

    rank: int | None  # from 1; None for what is never the best, see `competes`
    task: Task
    policy: str
    control_mode: str
    config_hash: str
    task_version: int
    episodes: int
    seeds: tuple[int, ...]
    figures: Mapping[str, Estimate]
    outcomes: Mapping[str, int]  # every outcome with its number of episodes
    failures: tuple[FailureCount, ...]  # of all episodes that failed, most frequent first
    drift: Mapping[str, float]  # the largest of all episodes by the names in DRIFTS
    timing: Mapping[str, float]  # ms, NaN where nothing was timed

    @property
    def captures(self) -> int:
        """Number of episodes that captured: those that figures of motion and cost are over."""
        return self.outcomes["captured"]

    @property
    def competes(self) -> bool:
        """Whether it may be the best at anything: not a baseline, nor what captured nothing."""
        return self.captures > 0 and self.policy.partition(" (")[0] not in BASELINES

    @property
    def entrant(self) -> Entrant:
        """What the row is about."""
        return Entrant(self.task, self.policy, self.control_mode)

    def to_dict(self) -> dict[str, Any]:
        """For summary.json; infinite and NaN become None; what a clock decided stands under `timing`."""
        return {
            "rank": self.rank,
            "env_id": self.task.env_id,
            "difficulty": self.task.difficulty,
            "split": self.task.split,
            "policy": self.policy,
            "control_mode": self.control_mode,
            "config_hash": self.config_hash,
            "task_version": self.task_version,
            "episodes": self.episodes,
            "captures": self.captures,
            "seeds": list(self.seeds),
            "figures": {
                key: {"value": _plain(e.value), "low": _plain(e.low), "high": _plain(e.high)}
                for key, e in self.figures.items()
            },
            "outcomes": dict(self.outcomes),
            "failures": {each.cause: each.count for each in self.failures},
            **{key: _plain(value) for key, value in self.drift.items()},
            "timing": {key: _plain(value) for key, value in self.timing.items()},
        }


def capture_key(limit: float) -> str:
    """Name of the figure for captures under an attitude limit [deg], such as capture@0.1deg."""
    return f"capture@{limit:g}deg"


def kept_key(limit: float) -> str:
    """Name of the figure for captures under a limit [deg] of the peak attitude, such as kept@0.1deg."""
    return f"kept@{limit:g}deg"


SHARES = ("success", *map(capture_key, ATTITUDE_LIMITS), *map(kept_key, ATTITUDE_LIMITS))
FIGURES = (HEADLINE, *SHARES, *_OVER_CAPTURES)


def build_rows(
    records: Iterable[EpisodeRecord], generator: np.random.Generator, resamples: int = 5000
) -> list[Row]:
    """Aggregate records into rows, best first within each task.

    Sorted by the kept-attitude score, then success, then eq. 20 cost, then name; baselines and policies
    without a capture stand behind and have no rank. The interval of a row depends on the generator and that
    row's records only, not on which other policies stand in the table. Raises ConfigurationError where an
    episode stands twice, a row would mix configurations or a table versions of its task.
    """
    groups: dict[Entrant, list[EpisodeRecord]] = {}
    versions: dict[Task, set[int]] = {}
    for record in records:
        groups.setdefault(record.entrant, []).append(record)
        versions.setdefault(record.entrant.task, set()).add(record.task_version)
    for task, found in versions.items():
        if len(found) > 1:
            told = " and ".join(map(str, sorted(found)))
            raise ConfigurationError(f"records of {task} mix the versions {told} of the task")
    entropy = int(generator.integers(2**63))
    rows = sorted((_row(key, group, entropy, resamples) for key, group in groups.items()), key=_order)
    return [row for _, group in groupby(rows, key=lambda row: row.task) for row in _ranked(list(group))]


def _ranked(rows: list[Row]) -> list[Row]:
    """The rows of one task, in order, with their ranks."""
    return [replace(row, rank=number if row.competes else None) for number, row in enumerate(rows, start=1)]


def _row(entrant: Entrant, records: list[EpisodeRecord], entropy: int, resamples: int) -> Row:
    task, policy, control_mode = entrant.task, entrant.policy, entrant.control_mode
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

    seeds = np.array([record.seed for record in records])
    captured = np.array([record.captured for record in records])
    final, peak = (_column(records, attrgetter(name)) for name in ("final_attitude", "peak_attitude"))
    figures = {HEADLINE: kept_attitude_score(captured, peak, seeds, stream(HEADLINE), resamples)}
    figures["success"] = capture_rate(captured)
    for key, attitude in ((capture_key, final), (kept_key, peak)):
        figures |= {key(limit): capture_rate(captured, attitude, limit) for limit in ATTITUDE_LIMITS}
    captures = [record for record in records if record.captured]
    for name, (of_record, statistic) in _OVER_CAPTURES.items():
        figures[name] = MISSING
        if captures:
            values = _column(captures, of_record)
            figures[name] = stratified_bootstrap(values, seeds[captured], stream(name), statistic, resamples)
    outcomes = Counter(record.outcome for record in records)
    return Row(
        rank=None,
        task=task,
        policy=policy,
        control_mode=control_mode,
        config_hash=hashes[0],
        task_version=records[0].task_version,
        episodes=len(records),
        seeds=tuple(sorted({record.seed for record in records})),
        figures=figures,
        outcomes={outcome: outcomes[outcome] for outcome in OUTCOMES},
        failures=_failures(records),
        drift={key: float(_column(records, attrgetter(key)).max()) for key in DRIFTS},
        timing={key: _timing(records, key) for key in TIMINGS},
    )


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
        told = sorted(reasons[cause].items(), key=lambda item: (-item[1], item[0]))
        found.append(FailureCount(cause, counts[cause], told[0][0] if told else None))
    return tuple(found)


def _column(records: list[EpisodeRecord], of_record: Callable[[EpisodeRecord], float | None]) -> np.ndarray:
    """A value of each record (n,), +infinity where it does not exist."""
    return np.array([math.inf if (value := of_record(record)) is None else value for record in records])


def _timing(records: list[EpisodeRecord], key: str) -> float:
    values = [value for record in records if (value := record.timing[key]) is not None]
    return float(median(np.array(values))) if values else math.nan


def _order(row: Row) -> tuple[Any, ...]:
    """Best first; what is equal to the last bit stands by its name."""
    task, figures = row.task, row.figures
    cost = figures["attitude_cost"].value
    merit = (-figures[HEADLINE].value, -figures["success"].value, math.inf if math.isnan(cost) else cost)
    place = (_place(task.env_id, ENTRIES), _place(task.difficulty, DIFFICULTIES), _place(task.split, SPLITS))
    return (*place, not row.competes, *merit, row.policy, row.control_mode)


def _place(name: str, names: Iterable[str]) -> tuple[int, str]:
    """Sorts by the place in a list, and what is not in it behind."""
    names = list(names)
    return (names.index(name) if name in names else len(names), name)


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None
