"""Datasets: whole episodes, each repeated from its actions before it is stored, as arrays in one npz file."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError
from space_envs.evaluation.datasets.trajectory import Trajectory
from space_envs.system.files import write_arrays
from space_envs.system.reading import parse_json, read_arrays

SCHEMA_VERSION = 1

# Type and number of axes of every array in the file.
_ARRAYS: dict[str, tuple[str, int]] = {
    "observations": ("float64", 2),
    "actions": ("float32", 2),
    "rewards": ("float64", 1),
    "terminations": ("bool", 1),
    "truncations": ("bool", 1),
    "step_start": ("int64", 1),
    "observation_start": ("int64", 1),
    "episode": ("int64", 1),
    "index": ("int64", 1),
    "seed": ("int64", 1),
    "captured": ("bool", 1),
    "outcome": ("str", 1),
}


@dataclass(frozen=True, eq=False)
class Dataset:
    """K episodes, S steps in all, one after the other. Building one checks it.

    The steps of episode k are step_start[k] ... step_start[k + 1] - 1. Its observations, one more than its
    steps, are observation_start[k] ... observation_start[k + 1] - 1.

    Attributes:
        about: env_id, robot, robot_digest, policy, control_mode, difficulty, split, goal.
        observations: (S + K, size). actions: (S, m) float32. rewards: (S,).
        terminations, truncations: (S,) bool. step_start, observation_start: (K + 1,).
        episode, index, seed: (K,) as of `Trajectory`. captured: (K,) bool. outcome: (K,) strings.
    """

    about: Mapping[str, str]
    observations: Array
    actions: NDArray[np.float32]
    rewards: Array
    terminations: NDArray[np.bool_]
    truncations: NDArray[np.bool_]
    step_start: NDArray[np.int64]
    observation_start: NDArray[np.int64]
    episode: NDArray[np.int64]
    index: NDArray[np.int64]
    seed: NDArray[np.int64]
    captured: NDArray[np.bool_]
    outcome: NDArray[np.str_]

    def __post_init__(self) -> None:
        for name, (kind, axes) in _ARRAYS.items():
            array = getattr(self, name)
            if array.ndim != axes or (array.dtype.kind != "U" if kind == "str" else array.dtype != kind):
                raise ConfigurationError(
                    f"dataset: {name} must be {kind} with {axes} axes, got {array.dtype} {array.shape}"
                )
        episodes, steps = len(self.index), len(self.rewards)
        sizes = {
            "actions terminations truncations": steps,
            "step_start observation_start": episodes + 1,
            "episode seed captured outcome": episodes,
            "observations": steps + episodes,
        }
        for names, size in sizes.items():
            for name in names.split():
                if len(getattr(self, name)) != size:
                    raise ConfigurationError(
                        f"dataset: {name} must have length {size} with {episodes} episodes of {steps} steps, "
                        f"got {len(getattr(self, name))}"
                    )
        lengths = np.diff(self.step_start)
        ends = self.step_start[[0, -1]].tolist(), self.observation_start[[0, -1]].tolist()
        if (
            ends != ([0, steps], [0, steps + episodes])
            or (lengths < 1).any()
            or (np.diff(self.observation_start) != lengths + 1).any()
        ):
            raise ConfigurationError("dataset: step_start and observation_start do not divide the arrays")
        last = np.zeros(steps, dtype=bool)
        last[self.step_start[1:] - 1] = True
        if ((self.terminations | self.truncations) != last).any():
            raise ConfigurationError("dataset: each episode must end once, in its last step")
        if (self.captured != (self.outcome == "captured")).any():
            raise ConfigurationError("dataset: captured and outcome disagree")
        if not (np.isfinite(self.observations).all() and np.isfinite(self.rewards).all()):
            raise ConfigurationError("dataset: observations or rewards hold NaN or infinity")
        if not (np.abs(self.actions) <= 1.0).all():
            raise ConfigurationError("dataset: actions must lie in [-1, 1]")

    def __len__(self) -> int:
        """Number of episodes K."""
        return len(self.index)

    @property
    def lengths(self) -> NDArray[np.int64]:
        """Number of steps (K,) of each episode."""
        return np.diff(self.step_start)

    def trajectory(self, k: int) -> Trajectory:
        """The k-th episode, as views.

        Raises:
            ConfigurationError: if there is none.
        """
        if not 0 <= k < len(self):
            raise ConfigurationError(f"dataset: there are {len(self)} episodes, from 0 on; got {k}")
        steps = slice(self.step_start[k], self.step_start[k + 1])
        return Trajectory(
            episode=int(self.episode[k]),
            index=int(self.index[k]),
            seed=int(self.seed[k]),
            outcome=str(self.outcome[k]),
            observations=self.observations[self.observation_start[k] : self.observation_start[k + 1]],
            actions=self.actions[steps],
            rewards=self.rewards[steps],
            terminations=self.terminations[steps],
            truncations=self.truncations[steps],
        )

    @classmethod
    def of(cls, about: Mapping[str, str], trajectories: Sequence[Trajectory]) -> Self:
        """Dataset of trajectories, one after the other.

        Raises:
            ConfigurationError: if there are none, or one is not a whole episode.
        """
        if not trajectories:
            raise ConfigurationError("dataset: there are no episodes")
        joined: dict[str, Any] = {
            name: np.concatenate([getattr(one, name) for one in trajectories])
            for name in ("observations", "actions", "rewards", "terminations", "truncations")
        }
        named: dict[str, Any] = {
            name: np.array([getattr(one, name) for one in trajectories])
            for name in ("episode", "index", "seed", "captured", "outcome")
        }
        starts: dict[str, Any] = {
            "step_start": _starts([len(one.rewards) for one in trajectories]),
            "observation_start": _starts([len(one.observations) for one in trajectories]),
        }
        return cls(about=dict(about), **joined, **named, **starts)

    def save(self, path: str | Path) -> None:
        """Write an npz file, whole or not at all; equal datasets give equal bytes."""
        arrays: dict[str, Any] = {name: getattr(self, name) for name in _ARRAYS}
        about = np.array(json.dumps(dict(self.about), sort_keys=True))
        header = {"schema": np.int64(SCHEMA_VERSION), "about": about}
        write_arrays(path, header | arrays, compressed=True)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote; never unpickles anything.

        Raises:
            ConfigurationError: naming the file, if it is no dataset or one of another schema.
        """
        try:
            arrays = read_arrays(path)
            schema = int(arrays.pop("schema"))
            if schema != SCHEMA_VERSION:
                raise ConfigurationError(f"schema {schema}, this version reads {SCHEMA_VERSION}")
            about = parse_json(str(arrays.pop("about")))
            if not isinstance(about, dict) or not all(isinstance(text, str) for text in about.values()):
                raise ConfigurationError(f"about must be an object of texts, got {about!r}")
            if set(arrays) != set(_ARRAYS):
                raise ConfigurationError(f"holds {sorted(arrays)}, expected {sorted(_ARRAYS)}")
            return cls(about=about, **arrays)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigurationError(f"{path}: not a dataset: {error}") from error


def _starts(lengths: Sequence[int]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(lengths)]).astype(np.int64)
