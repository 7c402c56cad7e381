"""Libraries of motions made in rounds, in parallel and resumable: each goal looks at its neighbours."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray
from tqdm import tqdm

from agents.planners.common.robot_files import refuse_other_robot, write_origin
from agents.planners.single_arm.library import NAMES, Library
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, positive_integer
from space_envs.robots.robot import Robot
from space_envs.system.provenance import commit, machine, versions
from space_envs.system.reading import read_object
from space_envs.system.threads import on_one_thread

MOST_JOBS = 4096

Motion = tuple[Array, float, float]
"""Coordinates (n, m), cost m^2/s (infinite without a motion to the goal) and number of starts tried."""

Solver = Callable[[Array, Array, int, Library | None, int], Motion]
"""Position (3,) m and quaternion (4,) of a goal, its number, the library before and the round -> motion."""


@dataclass(frozen=True, eq=False)
class RoundsRecipe:
    """Settings of a library, and how one of its motions is found.

    Attributes:
        robot: with one arm. name: of the library's file. settings: JSON values that determine the motions.
        solver: makes a solver; every process does so once a chunk. command: that makes the library.
        rounds: after the first one. chunk: goals a file of partial results.
    """

    robot: Robot
    name: str
    settings: Mapping[str, Any]
    solver: Callable[[], Solver]
    command: str
    rounds: int
    chunk: int


def make_library(
    output: str | Path,
    recipe: RoundsRecipe,
    goals: tuple[Array, Array],
    origin: Mapping[str, Any],
    jobs: int = 1,
    progress: bool = False,
) -> Library:
    """Make a library in the folder `output`; existing parts of the same recipe are reused.

    The result does not depend on the number of jobs nor on interruptions.

    Args:
        goals: positions (L, 3) m and quaternions (L, 4). origin: further values of the file next to it.

    Raises:
        ConfigurationError: if jobs is not positive, or parts are of another robot, recipe or other goals.
        StorageError: if a part is damaged.
    """
    positive_integer("jobs", jobs, MOST_JOBS)
    folder = Path(output) / Path(recipe.name).stem
    _begin(folder, recipe)
    total = len(goals[0]) * (recipe.rounds + 1)
    with tqdm(total=total, unit="goal", desc=folder.name, disable=not progress) as bar:
        library = _round(folder, recipe, goals, 0, None, jobs, bar)
        for number in range(1, recipe.rounds + 1):
            library = _round(folder, recipe, goals, number, library, jobs, bar)
    solved = library.rows(np.isfinite(library.cost))
    solved = replace(solved, coordinates=solved.coordinates.astype(np.float32))
    path = Path(output) / recipe.name
    solved.save(path)
    made = {"command": recipe.command, "motions": len(solved.cost), "commit": commit()}
    made |= {"versions": versions(), "machine": machine()}
    write_origin(path, recipe.robot, {**recipe.settings, **origin, **made})
    return solved


def _begin(folder: Path, recipe: RoundsRecipe) -> None:
    """Note the recipe in a folder of parts; ConfigurationError if the parts there are of another one."""
    path, expected = folder / "recipe.json", dict(recipe.settings)
    if not path.exists():
        write_origin(path, recipe.robot, expected)
        return
    found = read_object(path)
    refuse_other_robot(str(folder), found.pop("robot", None), recipe.robot)
    if found != expected:
        raise ConfigurationError(f"{folder} holds parts of another recipe; take another folder")


def _round(
    folder: Path,
    recipe: RoundsRecipe,
    goals: tuple[Array, Array],
    number: int,
    before: Library | None,
    jobs: int,
    bar: tqdm,
) -> Library:
    """The library after a round, from that of the previous round; existing parts are reused.

    Raises:
        ConfigurationError: if a part is of other goals.
    """
    size = len(goals[0])
    parts = {
        folder / f"{number}-{first:05d}.npz": np.arange(first, min(first + recipe.chunk, size))
        for first in range(0, size, recipe.chunk)
    }
    missing = [path for path in parts if not path.exists()]
    bar.update(size - sum(len(parts[path]) for path in missing))
    work = (delayed(_part)(path, recipe, goals, parts[path], before, number) for path in missing)
    for finished in Parallel(n_jobs=jobs, return_as="generator_unordered")(work):
        bar.update(finished)
    made = _merged([Library.load(path) for path in parts])
    if not np.array_equal(made.position, goals[0]):
        raise ConfigurationError(f"{folder} holds other goals; take another folder")
    return made


def _merged(parts: Sequence[Library]) -> Library:
    return Library(*[np.concatenate([getattr(p, name) for p in parts]) for name in NAMES])


def _part(
    path: Path,
    recipe: RoundsRecipe,
    goals: tuple[Array, Array],
    numbers: NDArray[np.intp],
    before: Library | None,
    number: int,
) -> int:
    """Write one file of a round; returns the number of its goals."""
    on_one_thread()  # several threads of BLAS give other bits
    solver, (position, quaternion) = recipe.solver(), (x[numbers] for x in goals)
    motions = [
        solver(place, attitude, int(goal), before, number)
        for goal, place, attitude in zip(numbers, position, quaternion, strict=True)
    ]
    coordinates, cost, attempts = (np.array(column) for column in zip(*motions, strict=True))
    Library(position, quaternion, coordinates, cost, attempts).save(path)
    return len(numbers)
