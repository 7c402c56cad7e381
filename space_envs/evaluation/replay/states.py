"""Recorded states: every episode of an entry as qpos over time, in npz files without pickles."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import NDArray

from space_envs.errors import ConfigurationError, positive
from space_envs.registration import make_task
from space_envs.system.files import atomic_write
from space_envs.system.reading import parse_json, read_arrays
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import Goals

if TYPE_CHECKING:  # records have states too
    from space_envs.evaluation.play.runner import Played

ABOUT = ("env_id", "difficulty", "split", "policy", "control_mode", "variant")
_GOAL = "goal_"  # begins the names of the goals' arrays
# Kind and shape in terms of K episodes, T steps and nq coordinates.
_ARRAYS: dict[str, tuple[str, tuple[str, ...]]] = {
    "scene": ("f", ("K", "T+1", "nq")),
    "attitude": ("f", ("K", "T+1")),
    "position_error": ("f", ("K", "T+1")),
    "length": ("i", ("K",)),
    "seed": ("i", ("K",)),
    "episode": ("i", ("K",)),
    "index": ("i", ("K",)),
    "outcome": ("U", ("K",)),
}
_TYPES = {"f": np.float32, "i": np.int64, "U": np.str_}


@dataclass(frozen=True, eq=False)
class States:
    """K recorded episodes of at most T steps; an episode that ended early repeats its last state.

    Building one checks names, types, shapes and values and raises ConfigurationError.

    Attributes:
        about: env_id, difficulty, split, policy, control_mode; variant of the model, empty for the usual one.
        period: s between two states.
        scene: (K, T + 1, nq) float32, qpos of the task's `render_model`.
        attitude: (K, T + 1) float32, deg. position_error: (K, T + 1) float32, m.
        length: (K,) steps until the end. seed, episode, index: (K,) as in the records.
        outcome: (K,) strings.
        goal: arrays (K, ...) by the names of the fields of the task's goals.
    """

    about: Mapping[str, str]
    period: float
    scene: NDArray[np.float32]
    attitude: NDArray[np.float32]
    position_error: NDArray[np.float32]
    length: NDArray[np.int64]
    seed: NDArray[np.int64]
    episode: NDArray[np.int64]
    index: NDArray[np.int64]
    outcome: NDArray[np.str_]
    goal: Mapping[str, NDArray[Any]]

    def __post_init__(self) -> None:
        if set(self.about) != set(ABOUT) or not all(isinstance(text, str) for text in self.about.values()):
            raise ConfigurationError(
                f"states: about must have the texts {', '.join(ABOUT)}, got {self.about}"
            )
        object.__setattr__(self, "period", positive("states: period", self.period))
        sizes: dict[str, int] = {}
        for name, (kind, shape) in _ARRAYS.items():
            object.__setattr__(self, name, _checked(name, getattr(self, name), kind, shape, sizes))
        episodes, steps = sizes["K"], sizes["T+1"]
        if steps < 1 or (self.length < 0).any() or (self.length >= steps).any():
            raise ConfigurationError(f"states: length must lie in 0..{steps - 1}, got {self.length.tolist()}")
        for name in ("seed", "episode", "index"):
            if (getattr(self, name) < 0).any():
                raise ConfigurationError(f"states: {name} must not be negative")
        if len({*self._rows}) < episodes:
            raise ConfigurationError("states: an episode of a seed stands twice")
        for name, value in self.goal.items():
            if value.dtype.kind not in "bif" or value.shape[:1] != (episodes,):
                raise ConfigurationError(
                    f"states: {_GOAL}{name} must hold numbers for {episodes} episodes, "
                    f"got {value.dtype} {value.shape}"
                )

    @cached_property
    def _rows(self) -> dict[tuple[int, int], int]:
        pairs = zip(self.seed.tolist(), self.episode.tolist(), strict=True)
        return {pair: row for row, pair in enumerate(pairs)}

    def row(self, seed: int, episode: int) -> int:
        """The row of an episode.

        Raises:
            ConfigurationError: if it is not here.
        """
        if (seed, episode) not in self._rows:
            raise ConfigurationError(f"episode {episode} of seed {seed} was not recorded")
        return self._rows[seed, episode]

    def take(self, rows: Sequence[int]) -> Self:
        """The episodes of these rows, in their order."""
        chosen = list(rows)
        arrays = {name: getattr(self, name)[chosen] for name in _ARRAYS}
        return replace(self, goal={name: value[chosen] for name, value in self.goal.items()}, **arrays)

    def task(self) -> CaptureTask:
        """What was asked.

        Raises:
            ConfigurationError: if this version has no such task, or its model has other coordinates.
        """
        words = {name: self.about[name] for name in ("difficulty", "split", "variant") if self.about[name]}
        task = make_task(self.about["env_id"], words)
        if task.model.nq != self.scene.shape[2]:
            raise ConfigurationError(
                f"states: {self.about['env_id']} has {task.model.nq} coordinates, these have "
                f"{self.scene.shape[2]}"
            )
        return task

    def goals(self) -> Goals:
        """The goals of all K episodes.

        Raises:
            ConfigurationError: as `task`, or if its goals have other fields.
        """
        kind = type(self.task().goal_block(self.about["split"], 0))
        names = [item.name for item in fields(kind)]
        if set(names) != set(self.goal):
            raise ConfigurationError(
                f"states: goals have {', '.join(names)}, these have {', '.join(self.goal)}"
            )
        return kind(**{name: self.goal[name] for name in names})

    def save(self, path: str | Path) -> None:
        """Write an npz file, whole or not at all; equal states give equal bytes."""
        arrays = {name: getattr(self, name) for name in _ARRAYS}
        arrays |= {f"{_GOAL}{name}": value for name, value in self.goal.items()}
        told = np.array(json.dumps({name: self.about[name] for name in ABOUT}))
        with atomic_write(path) as temporary, temporary.open("wb") as file:
            np.savez_compressed(file, about=told, period=np.float64(self.period), **arrays)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote. Raises ConfigurationError that names the file; never unpickles anything."""
        try:
            arrays = read_arrays(path)
            about = parse_json(str(arrays.pop("about")))
            period = float(arrays.pop("period"))
            names = [name for name in arrays if name.startswith(_GOAL)]
            goal = {name[len(_GOAL) :]: arrays.pop(name) for name in names}
            if set(arrays) != set(_ARRAYS):
                raise ConfigurationError(f"holds {sorted(arrays)}, expected {sorted(_ARRAYS)}")
            if not isinstance(about, dict):
                raise ConfigurationError(f"about must be an object, got {about!r}")
            return cls(about=about, period=period, goal=goal, **arrays)
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ConfigurationError(f"{path}: not a file of states: {error}") from error


def states_of(played: "Played", task: CaptureTask) -> States:
    """The states of all episodes that an entry played on a task."""
    rollout, records, entry = played.rollout, played.records, played.entry
    return States(
        about={
            "env_id": entry.task.env_id,
            "difficulty": entry.task.difficulty,
            "split": entry.task.split,
            "policy": entry.policy,
            "control_mode": entry.control_mode,
            "variant": played.variant or "",
        },
        period=task.control_period,
        scene=rollout.scene,
        attitude=rollout.attitude,
        position_error=rollout.position_error,
        length=rollout.length,
        seed=np.array([record.seed for record in records]),
        episode=np.array([record.episode for record in records]),
        index=rollout.index,
        outcome=np.array([record.outcome for record in records]),
        goal=dict(vars(rollout.goals)),
    )


def concatenate(parts: Sequence[States]) -> States:
    """The episodes of several, one after the other.

    Raises:
        ConfigurationError: if there are none, they are not of one entry, or an episode stands twice.
    """
    if not parts:
        raise ConfigurationError("states: there are none to put together")
    first = parts[0]
    for part in parts[1:]:
        for name, got, wanted in (
            ("about", dict(part.about), dict(first.about)),
            ("period", part.period, first.period),
            ("scene", part.scene.shape[1:], first.scene.shape[1:]),
            ("goal", set(part.goal), set(first.goal)),
        ):
            if got != wanted:
                raise ConfigurationError(f"states of different {name} do not go together: {wanted} and {got}")
    arrays = {name: np.concatenate([getattr(part, name) for part in parts]) for name in _ARRAYS}
    goal = {name: np.concatenate([part.goal[name] for part in parts]) for name in first.goal}
    return replace(first, goal=goal, **arrays)


def _checked(name: str, value: Any, kind: str, shape: tuple[str, ...], sizes: dict[str, int]) -> NDArray[Any]:
    """The array, if it is of a kind and of a shape that agrees with those before it."""
    array = np.asarray(value)
    if array.dtype.kind != kind and not (kind == "i" and array.dtype.kind == "u"):
        raise ConfigurationError(f"states: {name} must be of {np.dtype(_TYPES[kind])}, got {array.dtype}")
    with np.errstate(over="ignore"):  # what is too large becomes infinite, and is refused below
        array = array.astype(_TYPES[kind])
    if array.ndim != len(shape):
        raise ConfigurationError(f"states: {name} must have shape {shape}, got {array.shape}")
    # The first array with a letter fixes it; all later ones must agree.
    expected = tuple(sizes.setdefault(axis, got) for axis, got in zip(shape, array.shape, strict=True))
    if array.shape != expected:
        raise ConfigurationError(f"states: {name} must have shape {expected}, got {array.shape}")
    if kind == "f" and not np.isfinite(array).all():
        raise ConfigurationError(f"states: {name} holds NaN or infinity")
    array.setflags(write=False)
    return array
