"""From records to the rows of the leaderboard: one row for each task and policy.

How failures count: success and capture@N deg are shares of all episodes. Time to capture is the median over
all episodes, a failure being later than any capture, so it exists where more than half captured. The other
figures are interquartile means over all episodes, failures included, as they stood when the episode ended; a
policy that does nothing keeps its attitude. Planning time and time per action are medians over the episodes
that have them and carry no interval.
"""

import math
from collections import Counter
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from space_envs.errors import ConfigurationError
from space_envs.evaluation.records import OUTCOMES, Entrant, EpisodeRecord, Task
from space_envs.evaluation.statistics import (
    ATTITUDE_LIMITS,
    Estimate,
    Statistic,
    capture_rate,
    interquartile_mean,
    median,
    named_generator,
    stratified_bootstrap,
)
from space_envs.registration import ENTRIES
from space_envs.tasks.common import DIFFICULTIES, SPLITS

TIMINGS = ("planning_ms", "action_ms")
DRIFTS = ("linear_momentum_drift", "angular_momentum_drift")

# Figure -> the statistic of the record field of the same name.
_BOOTSTRAPPED: dict[str, Statistic] = {
    "final_attitude": interquartile_mean,
    "peak_attitude": interquartile_mean,
    "attitude_cost": interquartile_mean,
    "time_to_capture": median,
    "position_error": interquartile_mean,
    "orientation_error": interquartile_mean,
    "base_angular_impulse": interquartile_mean,
    "kinetic_energy_integral": interquartile_mean,
    "mechanical_work": interquartile_mean,
    "peak_power": interquartile_mean,
}


@dataclass(frozen=True)
class Row:
    """One policy on one task, in the units of the records; rates in 0..1."""

    task: Task
    policy: str
    control_mode: str
    config_hash: str
    episodes: int
    seeds: tuple[int, ...]
    figures: Mapping[str, Estimate]
    outcomes: Mapping[str, int]  # every outcome with its number of episodes
    reasons: tuple[tuple[str, int], ...]  # reasons of failures, most frequent first
    drift: Mapping[str, float]  # the largest of all episodes by the names in DRIFTS
    timing: Mapping[str, float]  # ms, NaN where nothing was timed

    @property
    def entrant(self) -> Entrant:
        """What the row is about."""
        return Entrant(self.task, self.policy, self.control_mode)

    def to_dict(self) -> dict[str, Any]:
        """For summary.json; infinite and NaN become None; what a clock decided stands under `timing`."""
        return {
            "env_id": self.task.env_id,
            "difficulty": self.task.difficulty,
            "split": self.task.split,
            "policy": self.policy,
            "control_mode": self.control_mode,
            "config_hash": self.config_hash,
            "episodes": self.episodes,
            "seeds": list(self.seeds),
            "figures": {
                key: {"value": _plain(e.value), "low": _plain(e.low), "high": _plain(e.high)}
                for key, e in self.figures.items()
            },
            "outcomes": dict(self.outcomes),
            **{key: _plain(value) for key, value in self.drift.items()},
            "timing": {key: _plain(value) for key, value in self.timing.items()},
        }


def capture_key(limit: float) -> str:
    """Name of the figure for captures under an attitude limit [deg], such as capture@0.1deg."""
    return f"capture@{limit:g}deg"


FIGURES = ("success", *map(capture_key, ATTITUDE_LIMITS), *_BOOTSTRAPPED)


def build_rows(
    records: Iterable[EpisodeRecord], generator: np.random.Generator, resamples: int = 5000
) -> list[Row]:
    """Aggregate records into rows, best first within each task.

    Sorted by success, then final attitude, then eq. 20 cost, then name. The interval of a row depends on the
    generator and that row's records only, not on which other policies stand in the table. Raises
    ConfigurationError where an episode stands twice or a row would mix configurations.
    """
    groups: dict[Entrant, list[EpisodeRecord]] = {}
    for record in records:
        groups.setdefault(record.entrant, []).append(record)
    entropy = int(generator.integers(2**63))
    return sorted((_row(key, group, entropy, resamples) for key, group in groups.items()), key=_rank)


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
    seeds = np.array([record.seed for record in records])
    captured = np.array([record.captured for record in records])
    final_attitude = _column(records, "final_attitude")
    figures = {"success": capture_rate(captured)}
    for limit in ATTITUDE_LIMITS:
        figures[capture_key(limit)] = capture_rate(captured, final_attitude, limit)
    for name, statistic in _BOOTSTRAPPED.items():
        words = (task.env_id, task.difficulty, task.split, policy, control_mode, name)
        figures[name] = stratified_bootstrap(
            _column(records, name), seeds, named_generator(entropy, *words), statistic, resamples
        )
    outcomes = Counter(record.outcome for record in records)
    reasons = Counter(record.reason for record in records if record.reason and not record.captured)
    return Row(
        task=task,
        policy=policy,
        control_mode=control_mode,
        config_hash=hashes[0],
        episodes=len(records),
        seeds=tuple(sorted({record.seed for record in records})),
        figures=figures,
        outcomes={outcome: outcomes[outcome] for outcome in OUTCOMES},
        reasons=tuple(sorted(reasons.items(), key=lambda item: (-item[1], item[0]))),
        drift={key: float(_column(records, key).max()) for key in DRIFTS},
        timing={key: _timing(records, key) for key in TIMINGS},
    )


def _column(records: list[EpisodeRecord], name: str) -> np.ndarray:
    """One field of each record (n,), +infinity where the value does not exist."""
    values = [getattr(record, name) for record in records]
    return np.array([math.inf if value is None else value for value in values])


def _timing(records: list[EpisodeRecord], key: str) -> float:
    values = [value for record in records if (value := record.timing[key]) is not None]
    return float(median(np.array(values))) if values else math.nan


def _rank(row: Row) -> tuple[Any, ...]:
    task, figures = row.task, row.figures
    merit = (-figures["success"].value, figures["final_attitude"].value, figures["attitude_cost"].value)
    place = (_place(task.env_id, ENTRIES), _place(task.difficulty, DIFFICULTIES), _place(task.split, SPLITS))
    return (*place, *merit, row.policy, row.control_mode)


def _place(name: str, names: Iterable[str]) -> tuple[int, str]:
    """Sorts by the place in a list, and what is not in it behind."""
    names = list(names)
    return (names.index(name) if name in names else len(names), name)


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None
