"""Episodes that the report replays: their selection, and all that is needed to draw them again."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.episodes import EpisodeBatch
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import Goals

LABELS = ("best", "median", "worst")


@dataclass(frozen=True, eq=False)
class Replay:
    """One recorded episode up to its end, after T steps.

    Attributes:
        label: best, median or worst. seed, episode, index: which one. outcome, reason: how it ended.
        time: (T + 1,) s. attitude: (T + 1,) deg, angle of the base from where it started.
        distance: (T + 1,) m, position error.
        scene: (T + 1, nq) qpos of the task's `render_model`.
        task, goals: what was asked; `goals` has the one row of this episode.
    """

    label: str
    seed: int
    episode: int
    index: int
    outcome: str
    reason: str | None
    time: NDArray[np.float64]
    attitude: NDArray[np.float64]
    distance: NDArray[np.float64]
    scene: NDArray[np.float64]
    task: CaptureTask
    goals: Goals


def make_replays(
    task: CaptureTask, episodes: EpisodeBatch, records: Sequence[EpisodeRecord]
) -> tuple[Replay, ...]:
    """The best, the median and the worst episode; fewer where there are fewer episodes.

    Episodes are ordered as the leaderboard orders policies: captures before failures, then by final
    attitude, then by base disturbance. So the worst is a failure where there is one, and the median stands in
    the middle of that order.

    Args:
        task: that was played. episodes: K of them. records: K, of their rows.

    Raises:
        ConfigurationError: if episodes and records are not the same.
    """
    if [record.index for record in records] != episodes.index.tolist():
        raise ConfigurationError("episodes and records are not of the same")
    order = sorted(range(len(records)), key=lambda row: _merit(records[row]))
    if not order:
        return ()
    chosen = {LABELS[0]: order[0], LABELS[1]: order[(len(order) - 1) // 2], LABELS[2]: order[-1]}
    if len(order) < 3:
        del chosen[LABELS[1]]
    if len(order) < 2:
        del chosen[LABELS[2]]
    return tuple(replay_of(label, row, task, episodes, records[row]) for label, row in chosen.items())


def _merit(record: EpisodeRecord) -> tuple[Any, ...]:
    """Sort key of an episode, best first; a missing figure is worse than any number."""
    numbers = (record.metrics[name] for name in ("final_attitude", "attitude_cost"))
    figures = [np.inf if number is None else number for number in numbers]
    return (not record.captured, *figures, record.seed, record.episode)


def replay_of(
    label: str, row: int, task: CaptureTask, episodes: EpisodeBatch, record: EpisodeRecord
) -> Replay:
    """Replay of the episode in a row, with its label."""
    until = slice(0, int(episodes.length[row]) + 1)
    return Replay(
        label=label,
        seed=record.seed,
        episode=record.episode,
        index=record.index,
        outcome=record.outcome,
        reason=record.explanation,
        time=episodes.time[until].astype(np.float64),
        attitude=episodes.attitude[row, until].astype(np.float64),
        distance=episodes.position_error[row, until].astype(np.float64),
        scene=episodes.scene[row, until].astype(np.float64),
        task=task,
        goals=episodes.goals.take(np.array([row])),
    )
