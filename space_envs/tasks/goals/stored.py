"""Searched numbers of draws, kept in the user's cache by robot, so that a block of goals is searched once."""

import contextlib
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from space_envs.codegen.cache import LibraryError, private_folder, usable_folder
from space_envs.robots.robot import Robot
from space_envs.system.files import atomic_write
from space_envs.tasks.base import BLOCK

SHOWN_AFTER = 3.0  # s of a search


def stored_draws(robot: Robot, name: str, find: Callable[[], NDArray[np.int64]]) -> NDArray[np.int64]:
    """Numbers (BLOCK, ...) of the draws of a block of goals, from the cache or by a search, then stored.

    Args:
        robot: whose goals they are. name: of the task with its version, the difficulty, split and block.
        find: searches them.
    """
    try:
        file = private_folder(usable_folder() / "goals" / robot.digest) / f"{name}.npy"
    except (OSError, LibraryError):  # nothing can be stored
        return find()
    with contextlib.suppress(OSError, ValueError, EOFError):
        stored = np.load(file, allow_pickle=False)
        if stored.dtype == np.int64 and len(stored) == BLOCK:
            return stored
    found = find()
    with contextlib.suppress(OSError), atomic_write(file) as temporary, open(temporary, "wb") as opened:
        np.save(opened, found, allow_pickle=False)
    return found


def search_bar(robot: Robot) -> tqdm:
    """Progress of the search for the goals of a block; shown in a terminal if it takes long."""
    return tqdm(
        total=BLOCK, desc=f"goals of {robot.name}", unit="goal", delay=SHOWN_AFTER, leave=False, disable=None
    )
