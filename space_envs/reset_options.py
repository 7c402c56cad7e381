"""What `reset(options=...)` may ask for, validated before anything moves."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from gymnasium.utils import seeding
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, unknown_name
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import Goals

COMMON_OPTIONS = ("split", "index", "joint_position", "joint_velocity", "reset_mask")


@dataclass(frozen=True)
class Start:
    """How k episodes begin.

    Attributes:
        goals: of the task, k of them, with the joint angles at the start.
        split, index: (k,) where the goals come from; `given` and -1 for a user's own.
        joint_velocity: (k, n), or None for rest.
    """

    goals: Goals
    split: NDArray[np.object_]
    index: NDArray[np.int64]
    joint_velocity: Array | None


def seeded(
    generators: Sequence[np.random.Generator], seed: Any, rows: NDArray[np.int64], n: int
) -> list[np.random.Generator]:
    """Generators of n rows: those there are, with rows (k,) seeded anew as `seed` says.

    Raises:
        ConfigurationError: if the seed is neither None, nor a number, nor n of them.
    """
    if seed is None:
        seeds: list[Any] = [None] * n
    elif isinstance(seed, int | np.integer) and not isinstance(seed, bool):
        seeds = [int(seed) + row for row in range(n)]
    elif isinstance(seed, list | tuple | np.ndarray) and len(seed) == n:
        seeds = [None if s is None else s for s in seed]
    else:
        raise ConfigurationError(f"seed must be an integer, a list of {n}, or None; got {seed!r}")
    for s in seeds:
        if s is not None and (isinstance(s, bool) or not isinstance(s, int | np.integer) or s < 0):
            raise ConfigurationError(f"a seed must be an integer of at least 0, got {s!r}")
    if not generators:
        return [seeding.np_random(None if s is None else int(s))[0] for s in seeds]
    chosen = list(generators)
    for row in rows:
        if seeds[row] is not None:
            chosen[row] = seeding.np_random(int(seeds[row]))[0]
    return chosen


def rows_to_reset(task: CaptureTask, options: Mapping[str, Any], n: int) -> NDArray[np.int64]:
    """Rows (k,) that are to be reset, of n.

    Raises:
        ConfigurationError: for an option that does not exist or a mask that is none.
    """
    if not isinstance(options, Mapping):
        raise ConfigurationError(f"options must be a dictionary, got {options!r}")
    valid = (*COMMON_OPTIONS, *task.goal_options)
    for name in options:
        if name not in valid:
            raise unknown_name("reset option", name, valid)
    mask = np.asarray(options.get("reset_mask", np.ones(n, dtype=bool)))
    if mask.shape != (n,) or mask.dtype != np.bool_:
        raise ConfigurationError(f"reset_mask must be bool of shape ({n},), got {mask.dtype} {mask.shape}")
    return np.flatnonzero(mask)


def choose_start(
    task: CaptureTask,
    options: Mapping[str, Any],
    rows: NDArray[np.int64],
    generators: Sequence[np.random.Generator],
) -> Start:
    """How rows (k,) of len(generators) begin; what the options leave open comes from each row's generator.

    Raises:
        ConfigurationError: for a value that is not valid. GoalError: for a goal that cannot be reached.
    """
    n = len(generators)
    joints, velocity = (
        _joint_option(task, options, name, rows, n) if name in options else None
        for name in ("joint_position", "joint_velocity")
    )
    if any(name in options for name in task.goal_options):
        if "split" in options or "index" in options:
            raise ConfigurationError("give either a goal or a split and index, not both")
        goals = task.given_goals(_goal_values(task, options, rows, n), joints)
        if task.collisions:
            task.check_start(goals)
        index = np.full(len(rows), -1, dtype=np.int64)
        return Start(goals, _names("given", rows), index, velocity)
    split = options.get("split", task.split)
    if "index" in options:
        index = np.asarray(options["index"])
        if index.shape not in ((), (n,)):
            raise ConfigurationError(f"index must be a number or {n} of them, got shape {index.shape}")
        index = np.broadcast_to(index, (n,))[rows]
    else:
        size = task.split_size(split)
        index = np.array([generators[row].integers(size) for row in rows], dtype=np.int64)
    goals = task.goals(split, index)
    if joints is not None:
        goals = replace(goals, joint_position=joints)
        if task.collisions:
            task.check_start(goals)
    return Start(goals, _names(split, rows), index, velocity)


def _goal_values(
    task: CaptureTask, options: Mapping[str, Any], rows: NDArray[np.int64], n: int
) -> dict[str, Array]:
    """Numbers (k, width) of every option that makes up a goal."""
    values = {}
    needed = [name for name, option in task.goal_options.items() if option.default is None]
    for name, option in task.goal_options.items():
        if name in options:
            values[name] = _row_values(options, name, option.width, rows, n)
        elif option.default is None:
            raise ConfigurationError(f"{' and '.join(needed)} must be given together; {name} is missing")
        else:
            values[name] = np.tile(np.array(option.default), (len(rows), 1))
    return values


def _names(name: str, rows: NDArray[np.int64]) -> NDArray[np.object_]:
    return np.full(len(rows), name, dtype=object)


def _joint_option(
    task: CaptureTask, options: Mapping[str, Any], name: str, rows: NDArray[np.int64], n: int
) -> Array:
    value = _row_values(options, name, task.robot.n_joints, rows, n)
    rates = task.parameters.rate_limit * np.array([[-1.0, 1.0]])
    limits = task.robot.range if name == "joint_position" else rates
    if (value < limits[:, 0]).any() or (value > limits[:, 1]).any():
        raise ConfigurationError(f"{name} outside its limits: got {value.tolist()}, limits {limits.tolist()}")
    return value


def _row_values(options: Mapping[str, Any], name: str, width: int, rows: NDArray[np.int64], n: int) -> Array:
    """The option's numbers for rows (k,): (k, width), from (width,) for all or (n, width)."""
    try:
        value = np.asarray(options[name], dtype=np.float64)
    except (TypeError, ValueError):
        raise ConfigurationError(f"{name} must be numbers, got {options[name]!r}") from None
    if value.shape not in ((width,), (n, width)):
        raise ConfigurationError(f"{name} must have shape ({width},) or ({n}, {width}), got {value.shape}")
    if not np.isfinite(value).all():
        raise ConfigurationError(f"{name} must be finite, got {value.tolist()}")
    return np.broadcast_to(value, (n, width))[rows]
