"""Optimal motions over the goals of the train split, from which new ones are found quickly.

`python -m agents.demonstrations.optimal` makes the shipped files anew. Each goal is solved from several
starts; then solutions are handed to the goals beside, which often lie in the basin of a cheaper one.
"""

from dataclasses import dataclass
from functools import lru_cache
from importlib.resources import as_file, files
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from agents.planners.single_arm.problem import Reach
from promp.storage import load_arrays, save_arrays
from space_envs.dynamics.rotations import Array, angle_between
from space_envs.errors import ConfigurationError

NAMES = ("position", "quaternion", "coordinates", "cost", "attempts")


@dataclass(frozen=True, eq=False)
class Library:
    """Stored motions, all of one start and duration.

    Attributes:
        position, quaternion: (L, 3) m and (L, 4), goals in the base's first frame.
        coordinates: (L, n, m) of the motions (agents/planners/single_arm/weights/weight_space.py).
        cost: (L,) eq. 20 times dt, m^2/s. attempts: (L,) starts that were tried.
    """

    position: Array
    quaternion: Array
    coordinates: Array
    cost: Array
    attempts: Array

    def nearest(self, reach: Reach, count: int) -> Array:
        """Coordinates (count, n, m) of the motions whose goals are nearest, a metre counting as a radian."""
        return self.coordinates[self.order(reach.position, reach.quaternion)[:count]]

    def order(self, position: Array, quaternion: Array) -> NDArray[np.intp]:
        """Indices (L,) by distance of the goals from a pose."""
        away = self.position - position
        angle = angle_between(self.quaternion, np.broadcast_to(quaternion, self.quaternion.shape))
        return np.argsort((away * away).sum(axis=1) + angle**2, kind="stable")

    def rows(self, chosen: NDArray[np.bool_]) -> "Library":
        """The motions of a mask (L,)."""
        return Library(*[getattr(self, name)[chosen] for name in NAMES])

    def save(self, path: str | Path) -> None:
        """Write an npz without pickles; the same library gives the same bytes."""
        save_arrays(path, {name: np.asarray(getattr(self, name)) for name in NAMES})

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote; errors as in promp.storage."""
        stored = load_arrays(path, NAMES)
        return cls(**{name: np.asarray(stored[name], dtype=np.float64) for name in NAMES})


def library_name(keep_attitude: bool, limited: bool) -> str:
    """File of a shipped library."""
    return f"library_{'kept' if keep_attitude else 'free'}_{'limited' if limited else 'wide'}.npz"


@lru_cache(maxsize=4)
def shipped_library(keep_attitude: bool, limited: bool = True) -> Library:
    """A library of the single arm, from its home at rest in 10 s.

    Args:
        keep_attitude: whether its motions end with the base's first attitude. limited: whether they keep the
            model's limits, or none.

    Raises:
        ConfigurationError: if the file is not there.
    """
    name = library_name(keep_attitude, limited)
    with as_file(files("agents") / "data" / name) as path:
        if not path.exists():
            raise ConfigurationError(f"{name} is missing; python -m agents.demonstrations.optimal makes it")
        return Library.load(path)
