"""Libraries of optimal motions over the goals of the train split, to start from.

`python -m agents.demonstrations.optimal` generates the shipped files. Each goal is solved from several
starts, and then again from the solutions of neighbouring goals, which are often in the basin of a better
optimum.
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
    """Stored motions with the same start and duration.

    Attributes:
        position, quaternion: (L, 3) m and (L, 4), goals in the initial base frame.
        coordinates: (L, n, m) of the motions in weight space.
        cost: (L,) eq. 20 times dt, m^2/s. attempts: (L,) starts that were tried.
    """

    position: Array
    quaternion: Array
    coordinates: Array
    cost: Array
    attempts: Array

    def nearest(self, reach: Reach, count: int) -> Array:
        """Coordinates (count, n, m) of the motions with the nearest goals; a metre counts as a radian."""
        return self.coordinates[self.order(reach.position, reach.quaternion)[:count]]

    def order(self, position: Array, quaternion: Array) -> NDArray[np.intp]:
        """Indices (L,) by distance of the goals from a pose."""
        offset = self.position - position
        angle = angle_between(self.quaternion, np.broadcast_to(quaternion, self.quaternion.shape))
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
    """File name of a shipped library."""
    return f"library_{'kept' if keep_attitude else 'free'}_{'limited' if limited else 'wide'}.npz"


@lru_cache(maxsize=4)
def shipped_library(keep_attitude: bool, limited: bool = True) -> Library:
    """Load a library of the single arm: motions from home at rest in 10 s.

    Args:
        keep_attitude: whether its motions end with the initial base attitude. limited: whether they keep the
            limits of the model.

    Raises:
        ConfigurationError: if the file is not there.
    """
    name = library_name(keep_attitude, limited)
    with as_file(files("agents") / "data" / name) as path:
        if not path.exists():
            raise ConfigurationError(f"{name} is missing; python -m agents.demonstrations.optimal makes it")
        return Library.load(path)
