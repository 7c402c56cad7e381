"""Baseline policies without a plan, the lower end of every table."""

from typing import Any

import numpy as np

from agents.policies.base import BasePolicy
from space_envs.dynamics.rotations import Array
from space_envs.policy import Knowledge, PolicyContext


class Random(BasePolicy):
    """Uniform actions from the seed, in any control mode, drawn again at each step."""

    knowledge = Knowledge.NONE

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        self._rng = np.random.default_rng(seed)

    def actions(self, observation: Array, state: Any, deterministic: bool) -> Array:
        """Actions (N, m), random also if `deterministic` is set."""
        return self._rng.uniform(-1.0, 1.0, (len(observation), len(self.context.action_scale)))


class Hold(BasePolicy):
    """Zero actions in any control mode: in the velocity modes the arm stays at rest."""

    knowledge = Knowledge.NONE

    def actions(self, observation: Array, state: Any, deterministic: bool) -> Array:
        """Actions (N, m), all zero."""
        return np.zeros((len(observation), len(self.context.action_scale)))
