"""A library of optimal motions, made in parallel and resumable: each goal is improved from its neighbours."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from joblib import Parallel, delayed
from tqdm import tqdm

from agents.demonstrations.optimal.search import first_motion, improved_motion
from agents.planners.common.plans import Limits
from agents.planners.single_arm.library import NAMES, Library, library_name
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from space_envs.checks import count, flag
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError
from space_envs.robots.parameters import SINGLE_ARM
from space_envs.system.files import write_json
from space_envs.system.provenance import commit, machine, versions
from space_envs.system.threads import on_one_thread
from space_envs.tasks.single_arm import SingleArmTask

COUNTS = {"easy": 120, "medium": 900, "hard": 180}  # goals of the train split
ROUNDS = 3  # in which the solutions of neighbouring goals are tried
CHUNK = 30  # goals a file of partial results


@dataclass(frozen=True)
class LibraryRecipe:
    """Settings that determine a library.

    Attributes:
        keep_attitude: whether the final attitude equals the initial one. limited: whether motions satisfy the
            model's limits. seed: of the initial guesses.
    """

    keep_attitude: bool
    limited: bool
    seed: int = 0

    def __post_init__(self) -> None:
        for name in ("keep_attitude", "limited"):
            flag(name, getattr(self, name))
        count("seed", self.seed, 2**63)

    @property
    def name(self) -> str:
        """Name of the library's file."""
        return library_name(self.keep_attitude, self.limited)


def model_limits() -> Limits:
    """Limits of the single arm's model, as the environment's drives have them."""
    position = SingleArmTask().mechanics.range
    return Limits(position, SINGLE_ARM.rate_limit, SINGLE_ARM.acceleration_limit, SINGLE_ARM.torque_limit)


def goals(counts: dict[str, int] = COUNTS) -> tuple[Array, Array]:
    """Positions (L, 3) m and quaternions (L, 4) of train goals."""
    position, quaternion = [], []
    for difficulty, many in counts.items():
        drawn = SingleArmTask(difficulty=difficulty).goals("train", np.arange(many))
        position.append(drawn.position)
        quaternion.append(drawn.quaternion)
    return np.concatenate(position), np.concatenate(quaternion)


def generate(
    output: str | Path,
    recipe: LibraryRecipe,
    counts: dict[str, int] = COUNTS,
    jobs: int = 1,
    progress: bool = False,
) -> Library:
    """Make a library in the folder `output`; existing parts of the same recipe are reused.

    The result does not depend on the number of jobs nor on interruptions.

    Raises:
        ConfigurationError: if jobs is not positive, or a part is of other goals.
        StorageError: if a part is damaged.
    """
    if jobs < 1:
        raise ConfigurationError(f"jobs must be at least 1, got {jobs}")
    position, quaternion = goals(counts)
    folder = Path(output) / Path(recipe.name).stem
    total = len(position) * (ROUNDS + 1)
    with tqdm(total=total, unit="goal", desc=folder.name, disable=not progress) as bar:
        library = _round(folder, recipe, position, quaternion, 0, None, jobs, bar)
        for number in range(1, ROUNDS + 1):
            library = _round(folder, recipe, position, quaternion, number, library, jobs, bar)
    solved = library.rows(np.isfinite(library.cost))
    solved = replace(solved, coordinates=solved.coordinates.astype(np.float32))
    path = Path(output) / recipe.name
    solved.save(path)
    origin = {
        "command": "python -m agents.demonstrations.optimal",
        "seed": recipe.seed,
        "train goals": counts,
        "motions": len(solved.cost),
        "commit": commit(),
        "versions": versions(),
        "machine": machine(),
    }
    write_json(path.with_suffix(".json"), origin)
    return solved


def _round(
    folder: Path,
    recipe: LibraryRecipe,
    position: Array,
    quaternion: Array,
    number: int,
    before: Library | None,
    jobs: int,
    bar: tqdm,
) -> Library:
    """The library after a round, from that of the previous round; existing parts are reused.

    Raises:
        ConfigurationError: if a part is of other goals.
    """
    size = len(position)
    parts = {
        folder / f"{number}-{first:05d}.npz": np.arange(first, min(first + CHUNK, size))
        for first in range(0, size, CHUNK)
    }
    missing = [path for path in parts if not path.exists()]
    bar.update(size - sum(len(parts[path]) for path in missing))
    work = (
        delayed(_part)(path, recipe, position[rows], quaternion[rows], rows, before, number == ROUNDS)
        for path in missing
        for rows in [parts[path]]
    )
    for finished in Parallel(n_jobs=jobs, return_as="generator_unordered")(work):
        bar.update(finished)
    made = _merged([Library.load(path) for path in parts])
    if not np.array_equal(made.position, position):
        raise ConfigurationError(f"{folder} holds other goals; take another folder")
    return made


def _merged(parts: Sequence[Library]) -> Library:
    return Library(*[np.concatenate([getattr(p, name) for p in parts]) for name in NAMES])


def _part(
    path: Path,
    recipe: LibraryRecipe,
    position: Array,
    quaternion: Array,
    numbers: Array,
    before: Library | None,
    last: bool,
) -> int:
    """Write one file of a round; returns the number of its goals."""
    on_one_thread()  # several threads of BLAS give other bits
    robot = SingleArmTask().mechanics
    planner = OptimalPlanner(robot, model_limits() if recipe.limited else Limits())
    rows = []
    for number, goal_position, goal_quaternion in zip(numbers, position, quaternion, strict=True):
        reach = Reach(robot.home, goal_position, goal_quaternion, keep_attitude=recipe.keep_attitude).checked(
            robot
        )
        if before is None:
            rows.append(first_motion(planner, reach, np.random.default_rng([recipe.seed, number])))
        else:
            rows.append(improved_motion(planner, reach, before, int(number), last))
    coordinates, cost, attempts = (np.array(column) for column in zip(*rows, strict=True))
    Library(position, quaternion, coordinates, cost, attempts).save(path)
    return len(numbers)
