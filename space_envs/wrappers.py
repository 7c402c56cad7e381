"""Goal-conditioned observations, for hindsight experience replay."""

from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.utils import RecordConstructorArgs
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array, angle_between, z_axis
from space_envs.envs import CaptureEnv
from space_envs.errors import ConfigurationError, shown
from space_envs.tasks.common import UNIT

# Observation fields of end-effectors and of their goals: position and at most one kind of orientation, which
# counts as far as the task's keyword `goal` asks for it.
PAIRS = (
    ("end_effector_position", "goal_position"),
    ("end_effector_quaternion", "goal_quaternion"),
    ("end_effector_axis", "goal_axis"),
)


class GoalConditioned(gym.Wrapper[Any, NDArray, Any, NDArray], RecordConstructorArgs):
    """Wrap a capture environment as a goal environment of Gymnasium-Robotics, for HER.

    Observations are a dictionary of `observation` (all of it), `achieved_goal` and `desired_goal` (g,):
    positions of the end-effectors and of their grapples in the inertial frame, m, then their
    quaternions or approach axes, if the capture limits these. The reward is 0 if every end-effector
    is inside the capture envelope's position and angle, else -1, and can be recomputed for any goal.

    Raises:
        ConfigurationError: for an environment of another kind.
    """

    def __init__(self, env: gym.Env[Any, NDArray]) -> None:
        if not isinstance(env, gym.Env) or not isinstance(env.unwrapped, CaptureEnv):
            raise ConfigurationError(f"GoalConditioned wraps a single capture environment, got {shown(env)}")
        RecordConstructorArgs.__init__(self)
        gym.Wrapper.__init__(self, env)
        self._task = env.unwrapped.task
        slices = self._task.layout.slices
        pairs = [pair for pair in PAIRS if pair[0] in slices]
        pairs = pairs[:1] if self._task.goal == "position" else pairs
        self._achieved, self._desired = zip(*pairs, strict=True)
        part = slices[self._achieved[0]]
        self._positions = part.stop - part.start
        box = env.observation_space
        bound = self._task.layout.bound
        bounds = [bound[slices[name]] for name in self._desired]
        if self._task.goal == "axis":
            bounds[1] = np.full(3, UNIT)
        goal = gym.spaces.Box(-np.concatenate(bounds), np.concatenate(bounds), dtype=np.float64)
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
        """Reward (...) of achieved goals (..., g) for desired goals (..., g).

        Raises:
            ConfigurationError: for goals of another size.
        """
        size = self.observation_space["desired_goal"].shape[0]  # type: ignore[index]
        for goal in (achieved_goal, desired_goal):
            if np.shape(goal)[-1:] != (size,):
                raise ConfigurationError(f"a goal must have shape (..., {size}), got {np.shape(goal)}")
        limits = self._task.envelope.limits
        achieved, desired = (
            self._each(goal[..., : self._positions]) for goal in (achieved_goal, desired_goal)
        )
        inside = np.linalg.norm(achieved - desired, axis=-1) <= limits.position
        if len(self._achieved) > 1:
            rotations = (self._each(goal[..., self._positions :]) for goal in (achieved_goal, desired_goal))
            inside &= _angle(*rotations) <= limits.orientation
        return np.where(inside.all(axis=-1), 0.0, -1.0)

    def _each(self, values: Array) -> Array:
        """(..., k, width) of k end-effectors."""
        return values.reshape(*values.shape[:-1], len(self._task.mechanics.end_effector_link), -1)

    def _dictionary(self, observation: Array) -> dict[str, Array]:
        return {
            "observation": observation,
            "achieved_goal": self._goal(observation, self._achieved),
            "desired_goal": self._goal(observation, self._desired),
        }

    def _goal(self, observation: Array, names: tuple[str, ...]) -> Array:
        position, *rotation = [self._task.layout.read(observation, name) for name in names]
        if self._task.goal == "axis":
            rotation = [z_axis(quaternion) for quaternion in rotation]
        return np.concatenate([position, *rotation])


def _angle(a: Array, b: Array) -> Array:
    """Angles (...) in rad between quaternions (..., 4) or between unit vectors (..., 3)."""
    if a.shape[-1] == 4:
        return angle_between(a, b)
    # Exact for small angles too, where the cosine alone is not.
    return 2.0 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1))
