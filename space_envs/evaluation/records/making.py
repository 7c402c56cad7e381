"""Records of episodes that were evaluated."""

import numpy as np

from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.play.rollout import Rollout
from space_envs.evaluation.records.configuration import config_hash
from space_envs.evaluation.records.episode import SCHEMA_VERSION, EpisodeRecord
from space_envs.evaluation.records.metrics import episode_metrics
from space_envs.evaluation.records.timing import UNTIMED, Timing
from space_envs.policy import Knowledge
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.outcome import Outcome


def episode_records(
    episodes: Rollout,
    task: CaptureTask,
    entry: LeaderboardEntry,
    seed: int,
    first: int = 0,
    timing: Timing = UNTIMED,
    knowledge: str = Knowledge.UNSTATED,
) -> list[EpisodeRecord]:
    """Records of episodes, one each; their numbers within the seed begin with `first`.

    `knowledge` is that of the policy.
    """
    metrics = episode_metrics(episodes, task)
    config = config_hash(entry.task.env_id, entry.control_mode, task)
    return [
        EpisodeRecord(
            schema=SCHEMA_VERSION,
            env_id=entry.task.env_id,
            robot=entry.task.robot,
            robot_digest=entry.task.robot_digest,
            policy=entry.policy,
            control_mode=entry.control_mode,
            knowledge=knowledge,
            difficulty=entry.task.difficulty,
            split=entry.task.split,
            goal=entry.task.goal,
            perturbation=entry.task.perturbation,
            index=int(episodes.index[row]),
            episode=first + row,
            seed=seed,
            config_hash=config,
            task_version=task.version,
            captured=episodes.outcome[row] == Outcome.CAPTURED,
            outcome=episodes.outcome[row],
            cause=episodes.cause[row],
            reason=episodes.reason[row],
            metrics={name: None if np.isnan(v[row]) else v[row].item() for name, v in metrics.items()},
            timing=timing,
        )
        for row in range(len(episodes.index))
    ]
