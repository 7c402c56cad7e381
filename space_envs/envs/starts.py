"""Initial states of episodes, from the validated options of `reset`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.checks import array, numbers
from space_envs.dynamics.rotations import Array
from space_envs.envs.braking import check_brakes
from space_envs.errors import ConfigurationError, GoalError, shown, unknown_name
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import Goals

COMMON_OPTIONS = ("split", "index", "joint_position", "joint_velocity", "reset_mask")


@dataclass(frozen=True)
class Start:
    """Starts of k episodes.

    Attributes:
        goals: of the task, k of them, with the joint angles at the start.
        split, index: (k,) source of the goals; `given` and -1 for a user's own.
        joint_velocity: (k, n), or None for rest.
        keys: (k, 2) numbers that decide the perturbation of each episode: one drawn from the row's generator,
            and the index plus 1. Without perturbation nothing is drawn, and they are zero.
    """

    goals: Goals
    split: NDArray[np.object_]
    index: NDArray[np.int64]
    joint_velocity: Array | None
    keys: NDArray[np.int64]


def rows_to_reset(task: CaptureTask, options: Mapping[str, Any], n: int) -> NDArray[np.int64]:
    """Rows (k,) to reset, of n.

    Raises:
        ConfigurationError: for an unknown option or an invalid mask.
    """
    if not isinstance(options, Mapping):
        raise ConfigurationError(f"options must be a dictionary, got {shown(options)}")
    valid = (*COMMON_OPTIONS, *task.goal_options)
    for name in options:
        if name not in valid:
            raise unknown_name("reset option", name, valid)
    mask = options.get("reset_mask", np.ones(n, dtype=bool))
    rows = array(mask)
    if rows is None or rows.shape != (n,) or rows.dtype != np.bool_:
        raise ConfigurationError(f"reset_mask must be bool of shape ({n},), got {shown(mask)}")
    return np.flatnonzero(rows)


def choose_start(
    task: CaptureTask,
    options: Mapping[str, Any],
    rows: NDArray[np.int64],
    generators: Sequence[np.random.Generator],
) -> Start:
    """Starts of rows (k,) of len(generators); omitted options are drawn from each row's generator.

    Raises:
        ConfigurationError: for an invalid value. GoalError: for an unreachable goal. The state of the
            generators is then unchanged.
    """
    before = [generators[row].bit_generator.state for row in rows]
    try:
        return _start(task, options, rows, generators)
    except Exception:  # a goal may have been drawn before another option is rejected
        for row, state in zip(rows, before, strict=True):
            generators[row].bit_generator.state = state
        raise


def _start(
    task: CaptureTask,
    options: Mapping[str, Any],
    rows: NDArray[np.int64],
    generators: Sequence[np.random.Generator],
) -> Start:
    n = len(generators)
    joints, velocity = (
        _joint_option(task, options, name, rows, n) if name in options else None
        for name in ("joint_position", "joint_velocity")
    )
    if any(name in options for name in task.goal_options):
        if "split" in options or "index" in options:
            raise ConfigurationError("give either a goal or a split and index, not both")
        goals = task.given_goals(_goal_values(task, options, rows, n), joints)
        check_brakes(task, goals, velocity)
        if task.collisions:
            task.check_start(goals)
        index = np.full(len(rows), -1, dtype=np.int64)
        return Start(goals, _names("given", rows), index, velocity, _keys(task, index, rows, generators))
    split = options.get("split", task.split)
    if "index" in options:
        index = array(options["index"])
        if index is None or index.shape not in ((), (n,)):
            got = shown(options["index"])
            raise ConfigurationError(f"index must be an integer or {n} of them, got {got}")
        index = np.broadcast_to(index, (n,))[rows]
    else:
        size = task.split_size(split)
        index = np.array([generators[row].integers(size) for row in rows], dtype=np.int64)
    goals = task.goals(split, index)
    if joints is not None:
        goals = replace(goals, joint_position=joints)
        if task.collisions:
            task.check_start(goals)
    if joints is not None or velocity is not None:
        check_brakes(task, goals, velocity)
    return Start(goals, _names(split, rows), index, velocity, _keys(task, index, rows, generators))


def _keys(
    task: CaptureTask,
    index: NDArray[np.int64],
    rows: NDArray[np.int64],
    generators: Sequence[np.random.Generator],
) -> NDArray[np.int64]:
    keys = np.zeros((len(rows), 2), dtype=np.int64)
    if not task.perturbation.nominal:
        keys[:, 0] = [generators[row].integers(2**62) for row in rows]
        keys[:, 1] = index + 1
    return keys


def _goal_values(
    task: CaptureTask, options: Mapping[str, Any], rows: NDArray[np.int64], n: int
) -> dict[str, Array]:
    """Values (k, width) of every option that is part of a goal."""
    values = {}
    given = next(name for name in task.goal_options if name in options)
    missing = [n for n, option in task.goal_options.items() if n not in options and option.default is None]
    if missing:
        raise ConfigurationError(f"{given} needs {' and '.join(missing)} too")
    for name, option in task.goal_options.items():
        if name in options:
            values[name] = _row_values(options, name, option.width, rows, n, option.parts)
            if (np.abs(values[name]) > option.largest).any():
                largest = float(np.abs(values[name]).max())
                raise GoalError(
                    f"{name} must lie in -{option.largest:g} to {option.largest:g}, got {largest:g}"
                )
        else:
            values[name] = np.tile(np.array(option.default), (len(rows), 1))
    return values


def _names(name: str, rows: NDArray[np.int64]) -> NDArray[np.object_]:
    return np.full(len(rows), name, dtype=object)


def _joint_option(
    task: CaptureTask, options: Mapping[str, Any], name: str, rows: NDArray[np.int64], n: int
) -> Array:
    robot = task.robot
    value = _row_values(options, name, robot.n_joints, rows, n)
    rates = robot.rate_limit[:, None] * np.array([-1.0, 1.0])
    limits = robot.joint_range if name == "joint_position" else rates
    outside = (value < limits[:, 0]) | (value > limits[:, 1])
    if outside.any():
        row, joint = np.argwhere(outside)[0]
        low, high = limits[joint]
        raise ConfigurationError(
            f"{name} outside its limits: joint {joint + 1} must lie in {low:g} to {high:g}, got "
            f"{value[row, joint]:g}"
        )
    return value


def _row_values(
    options: Mapping[str, Any], name: str, width: int, rows: NDArray[np.int64], n: int, parts: str = ""
) -> Array:
    """Values (k, width) of an option for rows (k,), from (width,) for all rows or (n, width).

    A scalar is accepted for width 1. `parts` describes the components in error messages.
    """
    given = options[name]
    value = numbers(given)
    if value is None:
        raise ConfigurationError(f"{name} must be numbers, got {shown(given)}")
    if value.shape not in ((width,), (n, width)) and not (width == 1 and value.shape == ()):
        expected = f"{'be a number or ' if width == 1 else ''}have shape ({width},) or ({n}, {width})"
        description = f", {parts}" if parts else ""
        raise ConfigurationError(f"{name} must {expected}{description}, got {value.shape}")
    if not np.isfinite(value).all():
        raise ConfigurationError(f"{name} must be finite, got {shown(value.tolist())}")
    return np.broadcast_to(value, (n, width))[rows]
