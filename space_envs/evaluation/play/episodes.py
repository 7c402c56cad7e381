"""Recorded episodes, from which records, plots, replays, videos and datasets are made."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Self, TypeVar

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array, logarithm
from space_envs.errors import ConfigurationError, positive
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.registration import make_task
from space_envs.robots.robot import Robot
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import Goals

# Kind and shape of each array in terms of K episodes, T steps and nq coordinates.
ARRAYS: dict[str, tuple[str, tuple[str | int, ...]]] = {
    "scene": ("f", ("K", "T+1", "nq")),
    "base_pose": ("f", ("K", "T+1", 7)),
    "attitude": ("f", ("K", "T+1")),
    "position_error": ("f", ("K", "T+1")),
    "orientation_error": ("f", ("K", "T+1")),
    "length": ("i", ("K",)),
    "seed": ("i", ("K",)),
    "episode": ("i", ("K",)),
    "index": ("i", ("K",)),
    "outcome": ("U", ("K",)),
}
_KINDS = {"f": "real numbers", "i": "whole numbers", "U": "texts"}


@dataclass(frozen=True, eq=False, kw_only=True)
class EpisodeBatch:
    """K recorded episodes of a policy on a task, of at most T steps; an ended one repeats its last values.

    Building one checks types, shapes and values and raises ConfigurationError.

    Attributes:
        entry: policy and task. robot: of which the digest is the task's. period: s between two states.
        scene: (K, T + 1, nq) qpos of the task's `render_model`.
        base_pose: (K, T + 1, 7) position in m and quaternion of the satellite, inertial frame.
        attitude: (K, T + 1) deg from the initial attitude. position_error: (K, T + 1) m.
        orientation_error: (K, T + 1) deg.
        length: (K,) steps until the end. outcome: (K,) texts.
        seed, episode: (K,) of the evaluation, and number within it. index: (K,) goal in the split.
        goal: arrays (K, ...) by the names of the fields of the task's goals.
    """

    entry: LeaderboardEntry
    robot: Robot
    period: float
    scene: NDArray[np.floating[Any]]
    base_pose: NDArray[np.floating[Any]]
    attitude: NDArray[np.floating[Any]]
    position_error: NDArray[np.floating[Any]]
    orientation_error: NDArray[np.floating[Any]]
    length: NDArray[np.int64]
    seed: NDArray[np.int64]
    episode: NDArray[np.int64]
    index: NDArray[np.int64]
    outcome: NDArray[np.str_]
    goal: Mapping[str, NDArray[Any]]

    def __post_init__(self) -> None:
        object.__setattr__(self, "period", positive("episodes: period", self.period))
        sizes: dict[str, int] = {}
        for name, (kind, shape) in ARRAYS.items():
            object.__setattr__(self, name, _checked(name, getattr(self, name), kind, shape, sizes))
        count, states = sizes["K"], sizes["T+1"]
        if states < 1 or (self.length < 0).any() or (self.length >= states).any():
            raise ConfigurationError(
                f"episodes: length must lie in 0..{states - 1}, got {self.length.tolist()}"
            )
        for name in ("seed", "episode", "index"):
            if (getattr(self, name) < 0).any():
                raise ConfigurationError(f"episodes: {name} must not be negative")
        if len(self._rows) < count:
            raise ConfigurationError("episodes: an episode of a seed stands twice")
        for name, value in self.goal.items():
            if value.dtype.kind not in "bif" or value.shape[:1] != (count,):
                raise ConfigurationError(
                    f"episodes: goal {name} must hold numbers for {count} episodes, "
                    f"got {value.dtype} {value.shape}"
                )

    def __len__(self) -> int:
        """Number of episodes K."""
        return len(self.length)

    @cached_property
    def _rows(self) -> dict[tuple[int, int], int]:
        pairs = zip(self.seed.tolist(), self.episode.tolist(), strict=True)
        return {pair: row for row, pair in enumerate(pairs)}

    @property
    def time(self) -> Array:
        """Times (T + 1,) of the states, s."""
        return self.period * np.arange(self.scene.shape[1], dtype=np.float64)

    def row(self, seed: int, episode: int) -> int:
        """Row of an episode.

        Raises:
            ConfigurationError: if it is not here.
        """
        if (seed, episode) not in self._rows:
            raise ConfigurationError(f"episode {episode} of seed {seed} was not recorded")
        return self._rows[seed, episode]

    def take(self, rows: Sequence[int] | NDArray[np.int64]) -> Self:
        """Episodes of these rows, in their order."""
        chosen = np.asarray(rows, dtype=np.int64)
        return _mapped(self, lambda values: values[0][chosen])

    def base_displacement(self) -> tuple[Array, Array]:
        """Rotation vector (K, T + 1, 3) in deg and translation (K, T + 1, 3) in m of the satellite since the
        start, in inertial axes."""
        pose = self.base_pose.astype(np.float64)
        return np.rad2deg(logarithm(pose[..., 3:])), pose[..., :3] - pose[:, :1, :3]

    def task(self) -> CaptureTask:
        """Task that was played.

        Raises:
            ConfigurationError: if this version has no such task, or its model has other coordinates.
        """
        task = make_task(self.entry.task.env_id, self.entry.task.keywords(self.robot))
        if task.model.nq != self.scene.shape[2]:
            raise ConfigurationError(
                f"episodes: {self.entry.task.env_id} has {task.model.nq} coordinates, these have "
                f"{self.scene.shape[2]}"
            )
        return task

    @cached_property
    def goals(self) -> Goals:
        """Goals of all K episodes.

        Raises:
            ConfigurationError: as `task`, or if its goals have other fields.
        """
        kind = type(self.task().goal_block(self.entry.task.split, 0))
        names = [item.name for item in fields(kind)]
        if set(names) != set(self.goal):
            raise ConfigurationError(
                f"episodes: goals have {', '.join(names)}, these have {', '.join(self.goal)}"
            )
        return kind(**{name: self.goal[name] for name in names})


AnyEpisodes = TypeVar("AnyEpisodes", bound=EpisodeBatch)


def concatenate(parts: Sequence[AnyEpisodes]) -> AnyEpisodes:
    """Episodes of several, one after the other.

    Raises:
        ConfigurationError: if there are none, they are not of one policy on one task, or an episode stands
            twice.
    """
    if not parts:
        raise ConfigurationError("episodes: there are none to put together")
    first = parts[0]
    for part in parts[1:]:
        for name, got, wanted in (
            ("entry", part.entry, first.entry),
            ("period", part.period, first.period),
            ("scene", part.scene.shape[1:], first.scene.shape[1:]),
            ("goal", set(part.goal), set(first.goal)),
        ):
            if got != wanted:
                raise ConfigurationError(
                    f"episodes of different {name} do not go together: {wanted} and {got}"
                )
    return _mapped(first, np.concatenate, parts)


def _mapped(first: AnyEpisodes, made: Any, parts: Sequence[AnyEpisodes] | None = None) -> AnyEpisodes:
    """Episodes whose arrays are made of the list of those of each part."""
    own = [first] if parts is None else parts
    values = {item.name: [getattr(part, item.name) for part in own] for item in fields(first)}
    arrays = {name: made(each) for name, each in values.items() if isinstance(each[0], np.ndarray)}
    goal = {name: made([part.goal[name] for part in own]) for name in first.goal}
    return replace(first, goal=goal, **arrays)


def _checked(
    name: str, value: Any, kind: str, shape: tuple[str | int, ...], sizes: dict[str, int]
) -> NDArray[Any]:
    """The array, read-only, if it is of a kind and of a shape that agrees with those before it."""
    array = np.asarray(value).view()
    if array.dtype.kind != kind and not (kind == "i" and array.dtype.kind == "u"):
        raise ConfigurationError(f"episodes: {name} must hold {_KINDS[kind]}, got {array.dtype}")
    if array.ndim != len(shape):
        raise ConfigurationError(f"episodes: {name} must have shape {shape}, got {array.shape}")
    # The first array with a letter fixes it; all later ones must agree.
    expected = tuple(
        axis if isinstance(axis, int) else sizes.setdefault(axis, got)
        for axis, got in zip(shape, array.shape, strict=True)
    )
    if array.shape != expected:
        raise ConfigurationError(f"episodes: {name} must have shape {expected}, got {array.shape}")
    if kind == "f" and not (np.abs(array) <= np.finfo(np.float32).max).all():
        raise ConfigurationError(f"episodes: {name} holds NaN, infinity or numbers beyond 32 bits")
    array.setflags(write=False)
    return array
