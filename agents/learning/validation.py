"""Validation of a policy on the goals of a split, while it learns those of the validation split."""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.steps import steps
from space_envs.policy import Policy, PolicyContext
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.outcome import kept_attitude

SPLIT = "validation"
EPISODES = 256


@dataclass(frozen=True)
class Validation:
    """Means over the episodes.

    Attributes:
        score: kept-attitude score, of which a failure has 0. captured: share.
        episode_return: undiscounted sum of rewards.
        final_attitude: deg from the initial attitude at the end. attitude_cost: eq. 20 times dt.
        seconds: length of an episode. episodes: how many.
    """

    score: float
    captured: float
    episode_return: float
    final_attitude: float
    attitude_cost: float
    seconds: float
    episodes: int

    @property
    def order(self) -> tuple[float, float]:
        """Order of policies: that of the leaderboard; the return decides between equal scores, such as 0."""
        return self.score, self.episode_return

    def to_json(self) -> dict[str, Any]:
        """As plain JSON values."""
        return asdict(self)


def checked_episodes(task: CaptureTask, requested: int | None, split: str = SPLIT) -> int:
    """Number of episodes of a validation: the requested number, or `EPISODES`, or all goals.

    Raises:
        ConfigurationError: for less than one, or more than the split has goals.
    """
    size = task.split_size(split)
    if requested is not None and not 1 <= requested <= size:
        raise ConfigurationError(
            f"validation-episodes must lie in 1..{size}, the goals of the split, got {requested}"
        )
    return min(EPISODES, size) if requested is None else requested


class Validator:
    """Plays the first goals of a split, all at once.

    Args:
        env_id, keywords: of the environment.
        episodes: how many of the split's goals; None takes `EPISODES`, or all if there are fewer.
        split: validation, or test for a policy that is chosen already.

    Raises:
        ConfigurationError: if the split has fewer goals.
    """

    def __init__(self, env_id: str, episodes: int | None = None, split: str = SPLIT, **keywords: Any) -> None:
        self.split = split
        n = checked_episodes(CaptureVectorEnv(env_id, **keywords).task, episodes, split)
        self.env = CaptureVectorEnv(env_id, n, autoreset_mode="disabled", split=split, **keywords)

    @property
    def context(self) -> PolicyContext:
        """Context of the policies that are validated."""
        return PolicyContext.from_env(self.env)

    def __call__(self, policy: Policy) -> Validation:
        """Validate a policy; PolicyError if it raises or returns no actions."""
        env, n = self.env, self.env.num_envs
        observation, _ = env.reset(seed=0, options={"split": self.split, "index": np.arange(n)})
        total, cost, attitude = np.zeros(n), np.zeros(n), np.zeros(n)
        length = np.zeros(n, dtype=np.int64)
        captured = np.zeros(n, dtype=bool)
        for step in steps(policy, env, observation):
            total += step.reward  # 0 where an episode has ended
            cost += step.running * env.task.errors(step.observation).base_speed ** 2 * env.task.control_period
            length += step.running
            attitude = np.where(step.running, step.info["attitude"], attitude)
            captured |= step.info["is_success"]
        peak = np.rad2deg(env.task.layout.read(env.episodes.observation, "peak_attitude")[:, 0])
        return Validation(
            score=float(kept_attitude(captured, peak).mean()),
            captured=float(captured.mean()),
            episode_return=float(total.mean()),
            final_attitude=float(attitude.mean()),
            attitude_cost=float(cost.mean()),
            seconds=float(length.mean() * env.task.control_period),
            episodes=n,
        )
