"""Short roll-outs of policies on the single arm."""

from typing import Any

import numpy as np

from agents.policies.resolve import resolve_policy
from space_envs.evaluation.play.playing import roll_out
from space_envs.evaluation.play.rollout import Rollout
from space_envs.registration import make_task

SINGLE = "SpaceCapture/SingleArm-v0"


def rollout_of(
    name: str, episodes: int = 6, apart: bool = False, split: str = "test", **keywords: Any
) -> tuple[Rollout, Any]:
    """The first goals of a split, and the task."""
    task = make_task(SINGLE, keywords)
    policy = resolve_policy(name)
    environment = {"env_id": SINGLE, "control_mode": policy.control_mode, **keywords}
    return roll_out(policy.factory(0), environment, split, np.arange(episodes), 0, apart=apart), task
