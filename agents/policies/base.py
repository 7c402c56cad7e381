"""Base class of the policies: one `predict` that checks observations, updates the state and acts."""

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.policy import Knowledge, Needs, PolicyContext


class BasePolicy:
    """Base class of policies: a subclass returns joint rates or actions, and updates a state if it has one.

    Attributes:
        needs: properties of the tasks that it can act in. knowledge: that it is made of.
    """

    needs: ClassVar[Needs] = Needs()
    knowledge: ClassVar[Knowledge] = Knowledge.UNSTATED

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        self.context = context

    def update(self, state: Any, observation: Array, episode_start: NDArray[np.bool_] | None) -> Any:
        """State for acting on observations (N, size); None for a policy without memory."""
        return None

    def rates(self, observation: Array, state: Any) -> Array:
        """Joint rates (N, n), rad/s, commanded for the end of the control period."""
        raise NotImplementedError

    def actions(self, observation: Array, state: Any, deterministic: bool) -> Array:
        """Actions (N, m): `rates` in units of the action scale, clipped to [-1, 1]."""
        return np.clip(self.rates(observation, state) / self.context.action_scale, -1.0, 1.0)

    def predict(
        self,
        observation: Array,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        """Actions (N, m) for observations (N, size) and the next state, as in `Policy.predict`."""
        observation = self.context.check_observation(observation)
        state = self.update(state, observation, episode_start)
        return self.actions(observation, state, deterministic), state
