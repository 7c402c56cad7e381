"""Roll-outs of policies, for the tests of what is recorded."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from agents.policies.resolve import resolve_policy
from space_envs.evaluation.play.playing import roll_out
from space_envs.evaluation.play.rollout import Rollout
from space_envs.registration import make_task

SINGLE = "SpaceCapture/SingleArm-v0"


def rollout_of(
    name: str,
    episodes: int | Sequence[int] = 6,
    env_id: str = SINGLE,
    split: str = "test",
    mode: str | None = None,
    apart: bool = False,
    **keywords: Any,
) -> tuple[Rollout, Any]:
    """Episodes of a policy on the first goals of a split, or on those of these numbers, and the task."""
    policy = resolve_policy(name, mode)
    environment = {"env_id": env_id, "control_mode": policy.control_mode, **keywords}
    goals = np.arange(episodes) if isinstance(episodes, int) else np.asarray(episodes)
    rollout = roll_out(policy.factory(0), environment, split, goals, 0, apart=apart)
    return rollout, make_task(env_id, keywords)
