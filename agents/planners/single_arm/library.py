"""Libraries of optimal motions of one robot over the goals of the train split, to start from.

`python -m agents.demonstrations.optimal` and `python -m agents.demonstrations.reactionless` make them. Each
goal is solved from several starts, and then again from the solutions of neighbouring goals, which often lead
to a better optimum.
"""

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.robot_files import robot_file, robot_options
from agents.planners.single_arm.problem import Reach
from promp.storage import load_arrays, save_arrays
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError
from space_envs.robots.robot import Robot
from space_envs.tasks.goals.kinds import goal_angle

REACTIONLESS = "library_reactionless.npz"  # name of a library of motions that never rotate the base
NAMES = ("position", "quaternion", "coordinates", "cost", "attempts")


@dataclass(frozen=True, eq=False)
class Library:
    """Stored motions with the same start and duration.

    Attributes:
        position, quaternion: (L, 3) m and (L, 4), goals in the initial base frame.
        coordinates: (L, n, m) of the motions in weight space, or amplitudes of reactionless ones.
        cost: (L,) eq. 20 times dt, m^2/s. attempts: (L,) starts that were tried.
    """

    position: Array
    quaternion: Array
    coordinates: Array
    cost: Array
    attempts: Array

    def nearest(self, reach: Reach, count: int) -> Array:
        """Coordinates (count, n, m) of the motions with the nearest goals; a metre counts as a radian."""
        return self.coordinates[self.order(reach)[:count]]

    def order(self, reach: Reach) -> NDArray[np.intp]:
        """Indices (L,) by distance of the goals from that of a problem, as far as it asks for a pose."""
        offset = self.position - reach.end.position
        angle = goal_angle(reach.kind, self.quaternion, reach.end.quaternion)
        return np.argsort((offset * offset).sum(axis=1) + angle**2, kind="stable")

    def rows(self, chosen: NDArray[np.bool_]) -> "Library":
        """Return the motions of a mask (L,)."""
        return Library(*[getattr(self, name)[chosen] for name in NAMES])

    def save(self, path: str | Path) -> None:
        """Write an npz file without pickles; equal libraries give equal bytes."""
        save_arrays(path, {name: np.asarray(getattr(self, name)) for name in NAMES})

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a file of `save`; errors as in promp.storage."""
        stored = load_arrays(path, NAMES)
        return cls(**{name: np.asarray(stored[name], dtype=np.float64) for name in NAMES})


def library_name(keep_attitude: bool, limited: bool) -> str:
    """File name of a library."""
    return f"library_{'kept' if keep_attitude else 'free'}_{'limited' if limited else 'wide'}.npz"


def library_command(robot: Robot, keep_attitude: bool, limited: bool = True) -> str:
    """Command that makes a library of a robot."""
    attitude, limits = "constrained" if keep_attitude else "unconstrained", "limited" if limited else "wide"
    options = f"{robot_options(robot)} --attitude {attitude} --limits {limits}"
    return f"python -m agents.demonstrations.optimal {options}"


def reactionless_command(robot: Robot) -> str:
    """Command that makes the library of a robot's motions that never rotate the base."""
    return f"python -m agents.demonstrations.reactionless {robot_options(robot)}"


def find_library(robot: Robot, keep_attitude: bool, limited: bool = True) -> Library | None:
    """A robot's library of motions from home at rest, if it was made.

    Args:
        keep_attitude: whether its motions end with the initial base attitude. limited: whether they keep the
            limits of the robot.

    Raises:
        ConfigurationError: if what is there was made for another robot. StorageError: if it is damaged.
    """
    return _found(robot, library_name(keep_attitude, limited))


def find_reactionless_library(robot: Robot) -> Library | None:
    """A robot's library of motions from home that never rotate the base, if it was made; errors as above."""
    return _found(robot, REACTIONLESS)


def _found(robot: Robot, name: str) -> Library | None:
    path = robot_file(robot, name)
    return None if path is None else _loaded(path, path.stat().st_mtime_ns)


def library_of(robot: Robot, keep_attitude: bool, limited: bool = True) -> Library:
    """A robot's library, arguments and errors as of `find_library`.

    Raises:
        ConfigurationError: also if there is none, naming the command that makes it.
    """
    found = find_library(robot, keep_attitude, limited)
    if found is None:
        command = library_command(robot, keep_attitude, limited)
        raise ConfigurationError(f"there is no library of the robot {robot.name!r}; `{command}` makes it")
    return found


@lru_cache(maxsize=8)
def _loaded(path: Path, changed: int) -> Library:
    return Library.load(path)
