"""Residual actions: what an agent does is added to the action of a policy that acts already."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from agents.policies.registry import make_policy
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureEnv, CaptureVectorEnv
from space_envs.errors import ConfigurationError, positive, shown
from space_envs.policy import PolicyContext

SCALE = 0.2  # of the action that is added


class _Expert:
    """A policy with its state in N episodes."""

    def __init__(self, name: str, env: CaptureEnv | CaptureVectorEnv) -> None:
        self._policy, self._state = make_policy(name, PolicyContext.from_env(env), 0), None
        self._action: Array = np.empty(0)

    def see(self, observation: Array, start: NDArray[np.bool_]) -> None:
        """Choose actions at observations (N, size); start (N,) marks the first ones of episodes."""
        self._action, self._state = self._policy.predict(observation, self._state, start)

    def corrected(self, action: NDArray, scale: float) -> Array:
        """The present actions with a share of others (N, m) added, in [-1, 1]."""
        return np.clip(self._action + scale * np.asarray(action, dtype=np.float64), -1.0, 1.0)


class ResidualAction(gym.Wrapper[Array, NDArray, Array, NDArray], RecordConstructorArgs):
    """Wrap a capture environment so that actions are added to those of a policy.

    Args:
        env: in the policy's control mode. expert: name of the policy, or package.module:Class.
        scale: of the action that is added; 0 is the policy alone.

    Raises:
        ConfigurationError: for an environment of another kind, or an unknown policy.
        PolicyError: for a policy that does not fit.
    """

    def __init__(self, env: gym.Env[Array, NDArray], expert: str = "gjm", scale: float = SCALE) -> None:
        if not isinstance(env, gym.Env) or not isinstance(env.unwrapped, CaptureEnv):
            raise ConfigurationError(f"ResidualAction wraps a single capture environment, got {shown(env)}")
        RecordConstructorArgs.__init__(self, expert=expert, scale=scale)
        gym.Wrapper.__init__(self, env)
        self._scale = positive("scale", scale, 1.0)
        self._expert = _Expert(expert, env.unwrapped)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode; options as in `CaptureVectorEnv.reset`."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._expert.see(observation[None], np.ones(1, dtype=bool))
        return observation, info

    def step(self, action: NDArray) -> tuple[Array, Any, bool, bool, dict[str, Any]]:
        """Advance by one control period."""
        result = self.env.step(self._expert.corrected(action[None], self._scale)[0])
        self._expert.see(result[0][None], np.zeros(1, dtype=bool))
        return result


class VectorResidualAction(gym.vector.VectorWrapper):
    """The same for N episodes of a `CaptureVectorEnv` in autoreset mode same_step.

    Raises:
        ConfigurationError, PolicyError: as `ResidualAction`.
    """

    def __init__(self, env: gym.vector.VectorEnv, expert: str = "gjm", scale: float = SCALE) -> None:
        vector = getattr(env, "unwrapped", None)
        if not isinstance(vector, CaptureVectorEnv):
            raise ConfigurationError(
                f"VectorResidualAction wraps a capture vector environment, got {shown(env)}"
            )
        if vector.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ConfigurationError(
                f"autoreset_mode must be 'same_step', got {vector.autoreset_mode.name.lower()!r}"
            )
        super().__init__(env)
        self._scale, self._expert = positive("scale", scale, 1.0), _Expert(expert, vector)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start N episodes; options as in `CaptureVectorEnv.reset`."""
        observation, info = self.env.reset(seed=seed, options=options)  # type: ignore[arg-type]
        self._expert.see(observation, np.ones(self.num_envs, dtype=bool))
        return observation, info

    def step(
        self, actions: NDArray
    ) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Advance every episode by one control period."""
        result = self.env.step(self._expert.corrected(actions, self._scale))
        self._expert.see(result[0], result[2] | result[3])
        return result
