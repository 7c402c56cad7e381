"""The single environment: one episode at a time."""

from typing import Any, Unpack

import gymnasium as gym
import numpy as np
from gymnasium.envs.registration import EnvSpec
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.envs.actions import action_array
from space_envs.envs.episodes import first_row
from space_envs.envs.keywords import EnvKeywords, explicit_keywords
from space_envs.envs.vector import METADATA, CaptureVectorEnv
from space_envs.errors import ActionError, ConfigurationError, UnknownKeywordError, shown
from space_envs.registration import max_steps_of_make
from space_envs.tasks.base import CaptureTask


class CaptureEnv(gym.Env[NDArray, NDArray]):
    """One episode at a time: `CaptureVectorEnv` with N = 1 and the same keywords."""

    metadata: dict[str, Any] = METADATA

    @explicit_keywords
    def __init__(
        self,
        env_id: str = "SpaceCapture/SingleArm-v0",
        control_mode: str = "joint_velocity",
        **keywords: Unpack[EnvKeywords],
    ) -> None:
        for name in ("num_envs", "autoreset_mode"):
            if name in keywords:
                raise UnknownKeywordError(
                    f"got an unexpected keyword argument {name!r}: it is one of gym.make_vec, not of gym.make"
                )
        keywords.setdefault("max_episode_steps", max_steps_of_make(self))
        self.vector = CaptureVectorEnv(env_id, 1, control_mode, "disabled", **keywords)
        self.render_mode = self.vector.render_mode
        self.metadata = {**METADATA, "render_fps": self.vector.metadata["render_fps"]}
        self.observation_space = self.vector.single_observation_space
        self.action_space = self.vector.single_action_space

    @property
    def task(self) -> CaptureTask:
        """The task's configuration."""
        return self.vector.task

    @property
    def spec(self) -> EnvSpec | None:  # type: ignore[override]
        """Specification that Gymnasium made the environment from; `max_episode_steps` is the horizon."""
        return self.vector.spec

    @spec.setter
    def spec(self, spec: EnvSpec | None) -> None:
        self.vector.spec = spec

    # Gymnasium's accessors and checkers use these two.

    @property
    def _np_random(self) -> np.random.Generator | None:  # type: ignore[override]
        return self.vector.np_random

    @_np_random.setter
    def _np_random(self, generator: np.random.Generator) -> None:
        self.vector.np_random = generator

    @property
    def _np_random_seed(self) -> int | None:  # type: ignore[override]
        return self.vector.np_random_seed

    @_np_random_seed.setter
    def _np_random_seed(self, seed: int) -> None:
        """No effect: setting `np_random` has set it to -1 in the vector environment."""

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode; options as in `CaptureVectorEnv.reset`."""
        if isinstance(seed, list | tuple | np.ndarray):
            raise ConfigurationError(f"seed must be an integer or None, got {shown(seed)}")
        observation, info = self.vector.reset(seed=seed, options=options)
        return observation[0], first_row(info)

    def step(self, action: NDArray) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Advance by one control period; action (m,) in [-1, 1]."""
        action = action_array(action)
        if action.shape != self.action_space.shape:
            raise ActionError(f"action must have shape {self.action_space.shape}, got {action.shape}")
        observation, reward, terminated, truncated, info = self.vector.step(action[None])
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), first_row(info)

    def render(self) -> NDArray[np.uint8] | None:  # type: ignore[override]
        """Image (H, W, 3), or None after updating a window, by render_mode."""
        pictures = self.vector.render()
        return None if pictures is None else pictures[0]

    def close(self) -> None:
        """Close the window and release OpenGL."""
        self.vector.close()
