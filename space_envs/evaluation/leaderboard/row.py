"""Row of the leaderboard: the figures of one policy on one task."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from space_envs.evaluation.leaderboard.figures import MetricFigure
from space_envs.evaluation.play.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.statistics.intervals import Estimate

BASELINES = ("hold", "random")  # what others are compared with; never the best


@dataclass(frozen=True)
class FailureCount:
    """Number of episodes of a row that failed for a cause, and the most frequent sentence about it."""

    cause: str  # one of CAUSES
    count: int
    reason: str | None


@dataclass(frozen=True)
class Row:
    """One policy on one task, in the units of the records; rates in 0..1."""

    rank: int | None  # from 1; None for what is never the best, see `competes`
    task: EvaluatedTask
    policy: str
    control_mode: str
    knowledge: str  # that the policy is made of
    config_hash: str
    task_version: int
    episodes: int
    seeds: tuple[int, ...]
    metrics: tuple[MetricFigure, ...]  # figures that are made of the task's metrics
    figures: Mapping[str, Estimate]
    outcomes: Mapping[str, int]  # every outcome with its number of episodes
    failures: tuple[FailureCount, ...]  # of all episodes that failed, most frequent first
    largest: Mapping[str, float]  # of all episodes, of metrics of which the largest value is shown
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
    def entry(self) -> LeaderboardEntry:
        """Policy and task of the row."""
        return LeaderboardEntry(self.task, self.policy, self.control_mode)

    def to_dict(self) -> dict[str, Any]:
        """For summary.json; infinite and NaN become None; what a clock decided stands under `timing`."""
        return {
            "rank": self.rank,
            "env_id": self.task.env_id,
            "robot": self.task.robot,
            "robot_digest": self.task.robot_digest,
            "difficulty": self.task.difficulty,
            "split": self.task.split,
            "goal": self.task.goal,
            "perturbation": self.task.perturbation,
            "policy": self.policy,
            "control_mode": self.control_mode,
            "knowledge": self.knowledge,
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
            **{key: _plain(value) for key, value in self.largest.items()},
            "timing": {key: _plain(value) for key, value in self.timing.items()},
        }


def _plain(value: float) -> float | None:
    return value if math.isfinite(value) else None
