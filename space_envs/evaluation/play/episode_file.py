"""The file format of episodes: npz without pickles, with 32-bit floats."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.play.episodes import ARRAYS, EpisodeBatch
from space_envs.robots.description.plain import robot_from_plain, to_plain, without_missing_meshes
from space_envs.robots.robot import Robot
from space_envs.system.files import write_arrays
from space_envs.system.reading import parse_json, read_arrays

_GOAL = "goal_"  # begins the names of the goals' arrays
_TYPES = {"f": np.float32, "i": np.int64, "U": np.str_}


def compact(episodes: EpisodeBatch) -> EpisodeBatch:
    """Copy of episodes as a file holds them: 32-bit floats, and the arrays of a file alone."""
    arrays: dict[str, Any] = {
        name: getattr(episodes, name).astype(_TYPES[kind]) for name, (kind, _) in ARRAYS.items()
    }
    return EpisodeBatch(
        entry=episodes.entry, robot=episodes.robot, period=episodes.period, goal=episodes.goal, **arrays
    )


def to_arrays(episodes: EpisodeBatch) -> dict[str, NDArray[Any]]:
    """Arrays of a file, by name; equal episodes give equal arrays."""
    stored = compact(episodes)
    entry = {**asdict(stored.entry), "task": stored.entry.task.to_plain()}
    about = json.dumps({**entry, "model": to_plain(stored.robot)})
    header = {"about": np.array(about), "period": np.array(stored.period)}
    goal = {f"{_GOAL}{name}": value for name, value in stored.goal.items()}
    return header | {name: getattr(stored, name) for name in ARRAYS} | goal


def from_arrays(arrays: Mapping[str, NDArray[Any]]) -> EpisodeBatch:
    """Episodes from the arrays of a file.

    Raises:
        ConfigurationError, ValueError, KeyError, TypeError: if there are others, or they do not fit.
    """
    given: dict[str, Any] = dict(arrays)
    about = parse_json(str(given.pop("about")))
    period = float(given.pop("period"))
    goal = {name[len(_GOAL) :]: given.pop(name) for name in arrays if name.startswith(_GOAL)}
    if set(given) != set(ARRAYS):
        raise ConfigurationError(f"holds {sorted(given)}, expected {sorted(ARRAYS)}")
    entry, robot = _read_about(about)
    return EpisodeBatch(entry=entry, robot=robot, period=period, goal=goal, **given)


def save_episodes(path: str | Path, episodes: EpisodeBatch) -> None:
    """Write an npz file, whole or not at all; equal episodes give equal bytes."""
    write_arrays(path, to_arrays(episodes), compressed=True)


def load_episodes(path: str | Path) -> EpisodeBatch:
    """Read what `save_episodes` wrote; never unpickles anything.

    Raises:
        ConfigurationError: naming the file, if it holds no episodes or is damaged.
    """
    try:
        return from_arrays(read_arrays(path))
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise ConfigurationError(f"{path}: not a file of episodes: {error}") from error


def _read_about(about: Any) -> tuple[LeaderboardEntry, Robot]:
    """Entry and robot from plain values."""
    if not isinstance(about, dict) or not isinstance(about.get("task"), dict):
        raise ConfigurationError(f"about must be an object with a task, got {about!r}")
    task, robot = EvaluatedTask(**about["task"]), robot_from_plain(about["model"])
    entry = LeaderboardEntry(task, about["policy"], about["control_mode"])
    texts = [*vars(task).values(), entry.policy, entry.control_mode]
    if not all(isinstance(text, str) for text in texts):
        raise ConfigurationError(f"about must hold texts, got {about!r}")
    if not robot.digest.startswith(task.robot_digest):
        raise ConfigurationError(f"the robot has the digest {robot.digest}, expected {task.robot_digest}...")
    return entry, without_missing_meshes(robot)
