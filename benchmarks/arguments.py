"""Types of the benchmarks' arguments; invalid values are refused before anything runs."""

import argparse
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from space_envs.errors import ConfigurationError, positive_integer, unknown_name
from space_envs.registration import ENTRIES, make_task
from space_envs.tasks.common import SPLITS
from space_envs.tasks.goals.kinds import GOAL_KINDS

MOST = 10_000


def whole(text: str) -> int:
    """Type of an argument that is a whole number from 1 to `MOST`."""
    try:
        return positive_integer("it", int(text), MOST)
    except ValueError:
        message = f"must be a whole number from 1 to {MOST:,}, got {text!r}"
        raise argparse.ArgumentTypeError(message) from None


def seed(text: str) -> int:
    """Type of an argument that is a seed."""
    if not text.isdecimal() or int(text) >= 2**32:
        raise argparse.ArgumentTypeError(f"must be a whole number from 0 to 2^32 - 1, got {text!r}")
    return int(text)


def split(text: str) -> str:
    """Type of an argument that names a split."""
    return _named("split", text, SPLITS)


def env_id(text: str) -> str:
    """Type of an argument that names an environment."""
    return _named("environment id", text, tuple(ENTRIES))


def goal_kind(text: str) -> str:
    """Type of an argument that names a kind of goal."""
    return _named("kind of goal", text, GOAL_KINDS)


def executable(text: str) -> Path:
    """Type of an argument that names a program, by a path or as the shell finds it."""
    found = shutil.which(text)
    if found is None:
        raise argparse.ArgumentTypeError(f"must be a program that can be run, got {text!r}")
    return Path(found)


def check_goals(env_id: str, split: str, goals: int, robot: Mapping[str, Any] | None = None) -> None:
    """Refuse more goals than a split has.

    Args:
        robot: keywords of the task that choose it.

    Raises:
        ConfigurationError: with the number of goals in the split, or as in `make_task`.
    """
    size = make_task(env_id, robot or {}).split_size(split)
    if goals > size:
        raise ConfigurationError(
            f"split {split!r} has {size} goals, so --goals must be at most {size}, got {goals}"
        )


def _named(kind: str, text: str, valid: tuple[str, ...]) -> str:
    if text not in valid:
        raise argparse.ArgumentTypeError(str(unknown_name(kind, text, valid)))
    return text
