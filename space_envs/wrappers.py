"""Goal-conditioned observations, for hindsight experience replay."""

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array, angle_between

GOAL_FIELDS = ("goal_position", "goal_quaternion")
ACHIEVED_FIELDS = ("end_effector_position", "end_effector_quaternion")


class GoalConditioned(gym.Wrapper[Any, NDArray, Any, NDArray]):
    """A capture environment as Gymnasium-Robotics' goal environments and HER expect it.

    Observations are a dictionary of `observation` (all of it), `achieved_goal` and `desired_goal` (7,):
    position in m and quaternion of end-effector and grapple in the inertial frame. The reward is 0 inside the
    capture envelope's position and orientation, else -1, and can be recomputed for any goal.
    """

    def __init__(self, env: gym.Env[Any, NDArray]) -> None:
        super().__init__(env)
        self._task = env.unwrapped.task  # type: ignore[attr-defined]
        box = env.observation_space
        low, high = (self._goal(bound, GOAL_FIELDS) for bound in (box.low, box.high))  # type: ignore[attr-defined]
        goal = gym.spaces.Box(low, high, dtype=np.float64)
        self.observation_space = gym.spaces.Dict(observation=box, achieved_goal=goal, desired_goal=goal)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Array], dict[str, Any]]:
        """Start an episode; options as in `CaptureVectorEnv.reset`."""
        observation, info = self.env.reset(seed=seed, options=options)
        return self._dictionary(observation), info

    def step(self, action: NDArray) -> tuple[dict[str, Array], float, bool, bool, dict[str, Any]]:
        """Advance by one control period."""
        observation, _, terminated, truncated, info = self.env.step(action)
        split = self._dictionary(observation)
        reward = self.compute_reward(split["achieved_goal"], split["desired_goal"], info)
        return split, float(reward), terminated, truncated, info

    def compute_reward(self, achieved_goal: Array, desired_goal: Array, info: Any) -> Array:
        """Reward (...) of achieved goals (..., 7) for desired goals (..., 7)."""
        envelope = self._task.envelope.limits
        distance = np.linalg.norm(achieved_goal[..., :3] - desired_goal[..., :3], axis=-1)
        angle = angle_between(achieved_goal[..., 3:], desired_goal[..., 3:])
        return np.where((distance <= envelope[0]) & (angle <= envelope[1]), 0.0, -1.0)

    def _dictionary(self, observation: Array) -> dict[str, Array]:
        return {
            "observation": observation,
            "achieved_goal": self._goal(observation, ACHIEVED_FIELDS),
            "desired_goal": self._goal(observation, GOAL_FIELDS),
        }

    def _goal(self, observation: Array, names: tuple[str, ...]) -> Array:
        return np.concatenate([self._task.layout.read(observation, name) for name in names])
