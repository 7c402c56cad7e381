"""stable-baselines3's view of the native vector environment: one step of N episodes is one call."""

import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray
from stable_baselines3.common.vec_env import VecEnv

from agents.policies.learned.features import FeatureView
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError

Indices = None | int | Iterable[int]


class NativeVecEnv(VecEnv):
    """A `CaptureVectorEnv` in same_step autoreset as a stable-baselines3 `VecEnv`.

    Rows that ended carry `terminal_observation`, `TimeLimit.truncated`, `episode` (r, l, t; what
    stable-baselines3's Monitor reports), `is_success`, `outcome` and `attitude` (deg) in their info; the
    infos of all other rows are empty, so that a step costs no Python work for an environment.

    Args:
        env: in autoreset mode same_step.
        view: what the learner sees of an observation; None is the observation itself.

    Raises:
        ConfigurationError: for another autoreset mode.
    """

    def __init__(self, env: CaptureVectorEnv, view: FeatureView | None = None) -> None:
        if env.autoreset_mode is not AutoresetMode.SAME_STEP:
            raise ConfigurationError(f"autoreset_mode must be 'same_step', got {env.autoreset_mode.value!r}")
        self.env = env
        space = env.single_observation_space
        self._view: Callable[[NDArray], NDArray] = _unchanged
        if view is not None:
            space = gym.spaces.Box(-np.inf, np.inf, (view.size,), np.float32)
            self._view = view
        super().__init__(env.num_envs, space, env.single_action_space)
        self._actions: NDArray | None = None
        self._return = np.zeros(self.num_envs)
        self._length = np.zeros(self.num_envs, dtype=np.int64)
        self._start_time = time.perf_counter()

    def reset(self) -> NDArray:
        """Start N episodes; returns observations (N, ...). Seeds and options are those set before, once."""
        given = any(seed is not None for seed in self._seeds)
        seed = [None if s is None else int(s) for s in self._seeds] if given else None
        observation, info = self.env.reset(seed=seed, options=self._merged_options())
        self._reset_seeds()
        self._reset_options()
        names = [name for name in info if not name.startswith("_")]
        self.reset_infos = [{name: info[name][row] for name in names} for row in range(self.num_envs)]
        self._return[:] = 0.0
        self._length[:] = 0
        return self._view(observation)

    def _merged_options(self) -> dict[str, Any] | None:
        """Options of all rows as one dictionary of the vector environment."""
        first = self._options[0]
        if any(options.keys() != first.keys() for options in self._options):
            raise ConfigurationError("reset options must have the same names for every environment")
        if "reset_mask" in first:
            raise ConfigurationError("reset_mask is no option here: a VecEnv resets all rows")
        merged: dict[str, Any] = {}
        for name in first:
            values = [options[name] for options in self._options]
            if name != "split":
                merged[name] = np.array(values)
            elif len(set(values)) == 1:
                merged[name] = values[0]
            else:
                raise ConfigurationError(
                    f"split must be the same for every environment, got {sorted(set(values))}"
                )
        return merged or None

    def step_async(self, actions: NDArray) -> None:
        """Take actions (N, m) for the step to come."""
        self._actions = actions

    def step_wait(self) -> tuple[NDArray, NDArray, NDArray, list[dict[str, Any]]]:
        """Observations (N, ...), rewards (N,) float32, dones (N,) and infos; rows that ended are reset."""
        if self._actions is None:
            raise ConfigurationError("call step_async before step_wait")
        actions, self._actions = self._actions, None
        observation, reward, terminated, truncated, info = self.env.step(actions)
        self._return += reward
        self._length += 1
        done = terminated | truncated
        # New dictionaries, since callers may write into them; they cost 30 ns each.
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        if done.any():
            self._describe_ended(np.flatnonzero(done), truncated & ~terminated, info, infos)
        return self._view(observation), reward.astype(np.float32), done, infos

    def _describe_ended(
        self,
        rows: NDArray[np.int64],
        cut: NDArray[np.bool_],
        info: dict[str, Any],
        infos: list[dict[str, Any]],
    ) -> None:
        final = self._view(np.stack(info["final_obs"][rows]))
        elapsed = round(time.perf_counter() - self._start_time, 6)
        for observation, row in zip(final, rows.tolist(), strict=True):
            infos[row] = {
                "terminal_observation": observation,
                "TimeLimit.truncated": bool(cut[row]),
                "episode": {"r": float(self._return[row]), "l": int(self._length[row]), "t": elapsed},
                "is_success": bool(info["is_success"][row]),
                "outcome": info["outcome"][row],
                "attitude": float(info["attitude"][row]),
            }
        self._return[rows] = 0.0
        self._length[rows] = 0

    def snapshot(self) -> dict[str, Any]:
        """State of the N episodes, as plain values and arrays; their goals must be of a split."""
        return {**self.env.snapshot(), "return": self._return.copy(), "length": self._length.copy()}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Continue from a snapshot of as many episodes of the same task, with the same bits."""
        self.env.restore(snapshot)
        self._return, self._length = snapshot["return"].copy(), snapshot["length"].copy()

    def close(self) -> None:
        """Free what pictures needed."""
        self.env.close()

    def get_images(self) -> Sequence[NDArray[np.uint8] | None]:
        """Pictures (H, W, 3), one an environment, where render_mode is rgb_array."""
        pictures = self.env.render()
        return [None] * self.num_envs if pictures is None else list(pictures)

    # stable-baselines3 asks single environments; all rows here share one object.

    def get_attr(self, attr_name: str, indices: Indices = None) -> list[Any]:
        """The vector environment's attribute for each requested row."""
        value = getattr(self.env, attr_name)
        return [value for _ in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Indices = None) -> None:
        """Set an attribute of the vector environment; only for all rows together."""
        self._require_all(indices)
        setattr(self.env, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Indices = None, **kwargs: Any) -> list[Any]:
        """Call a method of the vector environment once, for all rows together; its result, once a row."""
        self._require_all(indices)
        value = getattr(self.env, method_name)(*args, **kwargs)
        return [value for _ in range(self.num_envs)]

    def env_is_wrapped(self, wrapper_class: type[gym.Wrapper], indices: Indices = None) -> list[bool]:
        """False for every row: rows of a native vector environment have no wrappers."""
        return [False for _ in self._get_indices(indices)]

    def _require_all(self, indices: Indices) -> None:
        if sorted(self._get_indices(indices)) != list(range(self.num_envs)):
            raise ConfigurationError("rows of a native vector environment cannot be addressed one by one")


def _unchanged(observation: NDArray) -> NDArray:
    return observation
