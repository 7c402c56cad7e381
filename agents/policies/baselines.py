"""Policies without a plan, which a table needs as its floor."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.policy import PolicyContext


class Random:
    """Uniform actions from the seed, in any control mode."""

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        self._context = context
        self._rng = np.random.default_rng(seed)

    def predict(
        self,
        observation: Array,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        """Actions (N, m), drawn anew whatever `deterministic` says."""
        n = len(self._context.check_observation(observation))
        return self._rng.uniform(-1.0, 1.0, (n, len(self._context.action_scale))), None


class Hold:
    """Zero actions: in the velocity modes the arm rests."""

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        self._context = context

    def predict(
        self,
        observation: Array,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        """Actions (N, m), all zero."""
        n = len(self._context.check_observation(observation))
        return np.zeros((n, len(self._context.action_scale))), None
