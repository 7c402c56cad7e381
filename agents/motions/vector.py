"""Vector environments whose actions are motions: resets, ends of episodes, and what a step returns."""

from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from agents.motions.actions import MotionActions
from space_envs.dynamics.rotations import Array
from space_envs.envs.actions import checked_actions
from space_envs.envs.episodes import masked
from space_envs.errors import ConfigurationError, ResetNeededError, unknown_name
from space_envs.tasks.base import CaptureTask

_MODES = {mode.name.lower(): mode for mode in AutoresetMode}


class PartResult(NamedTuple):
    """Result of one part of N episodes.

    Attributes:
        observation: (N, size) at its end, or at the end of the episode. reward: (N,) sum of the rewards.
        terminated, truncated: (N,) bool, also of rows that had ended before. info: of a vector environment,
            with the sums of the reward terms.
    """

    observation: Array
    reward: Array
    terminated: NDArray[np.bool_]
    truncated: NDArray[np.bool_]
    info: dict[str, Any]


class MotionVectorEnv(gym.vector.VectorEnv[Array, NDArray, Array]):
    """N episodes of a capture task whose action is the rest of the joint motion.

    A step is a part of an episode; its reward is the sum of the task's rewards. Subclasses simulate.

    Args:
        task: of the episodes. num_envs: N. actions: from actions to motions.
        autoreset_mode: next_step, same_step or disabled (Gymnasium's `AutoresetMode`).
    """

    single_observation_space: gym.spaces.Box
    single_action_space: gym.spaces.Box

    def __init__(
        self, task: CaptureTask, num_envs: int, actions: MotionActions, autoreset_mode: str | AutoresetMode
    ) -> None:
        mode = _MODES.get(autoreset_mode) if isinstance(autoreset_mode, str) else autoreset_mode
        if not isinstance(mode, AutoresetMode):
            raise unknown_name("autoreset mode", autoreset_mode, _MODES)
        self.task, self.num_envs, self.actions, self.autoreset_mode = task, num_envs, actions, mode
        self.metadata = {"render_modes": [], "autoreset_mode": mode}
        bound = task.layout.bound
        self.single_observation_space = gym.spaces.Box(-bound, bound, dtype=np.float64)
        self.single_action_space = gym.spaces.Box(-1.0, 1.0, (actions.size,), np.float32)
        self.observation_space = gym.vector.utils.batch_space(self.single_observation_space, num_envs)
        self.action_space = gym.vector.utils.batch_space(self.single_action_space, num_envs)
        self.over: NDArray[np.bool_] | None = None  # (N,) rows that ended, None before the first reset

    # Implemented by subclasses -----------------------------------------------------------------------------

    def begin(self, options: dict[str, Any], seed: Any = None) -> tuple[Array, dict[str, Any]]:
        """Start episodes in the rows of the option reset_mask; observations (N, size) of all, and info."""
        raise NotImplementedError

    def play(self, actions: Array, part: NDArray[np.int64]) -> PartResult:
        """Simulate the parts (N,) of the episodes that begin now; rows that ended stay as they are."""
        raise NotImplementedError

    @property
    def observation(self) -> Array:
        """Present observations (N, size)."""
        raise NotImplementedError

    # Gymnasium's interface ---------------------------------------------------------------------------------

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Start new episodes; seeds and options as in `CaptureVectorEnv.reset`."""
        options = {} if options is None else options
        observation, info = self.begin(options, seed)
        over = np.zeros(self.num_envs, dtype=bool) if self.over is None else self.over.copy()
        over[np.asarray(options.get("reset_mask", np.ones(self.num_envs, dtype=bool)))] = False
        self.over = over
        return observation.copy(), info

    def step(
        self, actions: NDArray
    ) -> tuple[Array, Array, NDArray[np.bool_], NDArray[np.bool_], dict[str, Any]]:
        """Play a part of every episode.

        Args:
            actions: (N, n m) in [-1, 1], of `MotionActions`.

        Returns:
            As `CaptureVectorEnv.step`; rewards are sums over the part.

        Raises:
            ActionError: for a wrong shape or type, NaN or infinity; the state is then unchanged.
        """
        if self.over is None:
            raise ResetNeededError("call reset before step")
        action, _ = checked_actions(actions, (self.num_envs, self.actions.size))
        over, layout = self.over, self.task.layout
        part = self.actions.part(layout.read(self.observation, "time")[:, 0])
        observation, reward, terminated, truncated, info = self.play(action, part)
        done = terminated | truncated
        reward = np.where(over, 0.0, reward)
        self.over = done
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and over.any():
            observation, reset = self._again(over)
            info = masked(info, ~over) | reset
            terminated, truncated = terminated & ~over, truncated & ~over
        elif self.autoreset_mode is AutoresetMode.SAME_STEP and done.any():
            final = np.full(self.num_envs, None, dtype=object)
            for row in np.flatnonzero(done):
                final[row] = observation[row].copy()
            last = masked(info, done)
            observation, reset = self._again(done)
            extra = {"final_obs": final, "_final_obs": done, "final_info": last, "_final_info": done}
            info = masked(info, ~done) | reset | extra
        return observation.copy(), reward, terminated, truncated, info

    def _again(self, rows: NDArray[np.bool_]) -> tuple[Array, dict[str, Any]]:
        """Start new episodes in rows (N,) bool."""
        observation, info = self.begin({"reset_mask": rows})
        self.over = None if self.over is None else self.over & ~rows
        return observation, info


def refuse_moving(task: CaptureTask) -> None:
    """Refuse a task whose goals move: a motion here ends at rest.

    Raises:
        ConfigurationError: naming the task.
    """
    if any(name in task.layout.slices for name in ("goal_linear_velocity", "target_angular_velocity")):
        raise ConfigurationError(
            f"motions as actions end at rest, and need static goals; those of {type(task).__name__} move"
        )
