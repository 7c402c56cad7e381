"""The single environment with motions as actions, as a wrapper and by id."""

from typing import Any

import gymnasium as gym
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from agents.motions.simulated import SimulatedMotions
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureEnv
from space_envs.envs.actions import action_array
from space_envs.envs.episodes import first_row
from space_envs.errors import ActionError, ConfigurationError, shown


class MotionAction(gym.Wrapper[Array, NDArray, Array, NDArray], RecordConstructorArgs):
    """Wrap a capture environment so that an action is the rest of the joint motion.

    A step is a part of the episode, its reward the sum of the task's rewards. Actions (n m,) in [-1, 1] are
    those of `agents.motions.actions.MotionActions`.

    Args:
        env: in control mode joint_velocity. motions: actions in an episode. duration: s, of a motion; None is
            the usual share of the episode.

    Raises:
        ConfigurationError: for an environment of another kind.
    """

    def __init__(self, env: gym.Env[Array, NDArray], motions: int = 1, duration: float | None = None) -> None:
        if not isinstance(env, gym.Env) or not isinstance(env.unwrapped, CaptureEnv):
            raise ConfigurationError(f"MotionAction wraps a single capture environment, got {shown(env)}")
        RecordConstructorArgs.__init__(self, motions=motions, duration=duration)
        gym.Wrapper.__init__(self, env)
        self.vector = SimulatedMotions(env.unwrapped.vector, motions, duration, "disabled")
        self.action_space = self.vector.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start an episode; options as in `CaptureVectorEnv.reset`."""
        observation, info = self.vector.reset(seed=seed, options=options)
        return observation[0], first_row(info)

    def step(self, action: NDArray) -> tuple[Array, float, bool, bool, dict[str, Any]]:
        """Play a part of the episode."""
        action = action_array(action)
        if action.shape != self.action_space.shape:
            raise ActionError(f"action must have shape {self.action_space.shape}, got {action.shape}")
        observation, reward, terminated, truncated, info = self.vector.step(action[None])
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), first_row(info)


def make_motion(
    env_id: str, motions: int = 1, duration: float | None = None, **keywords: Any
) -> MotionAction:
    """One episode of a task whose actions are motions; arguments as in `make_motions`."""
    return MotionAction(CaptureEnv(env_id, **keywords), motions, duration)
