"""A library of optimal motions, made in parallel and resumable: each goal is improved from its neighbours."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from tqdm import tqdm

from agents.demonstrations.optimal.search import first_motion, improved_motion
from agents.planners.common.plans import Limits
from agents.planners.common.robot_files import described_robot, refuse_other_robot
from agents.planners.single_arm.library import NAMES, Library, library_command, library_name
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.policies.single_arm.optimal import further_rows
from agents.policies.single_arm.reaching import motion_duration
from space_envs.checks import count, flag
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, positive_integer
from space_envs.policy import PolicyContext
from space_envs.robots.robot import Robot
from space_envs.system.files import write_json
from space_envs.system.provenance import commit, machine, versions
from space_envs.system.reading import read_object
from space_envs.system.threads import on_one_thread
from space_envs.tasks.single_arm import SingleArmTask

COUNTS = {"easy": 120, "medium": 900, "hard": 180}  # goals of the train split
ENV_ID = "SpaceCapture/SingleArm-v0"  # whose train split gives the goals
ROUNDS = 3  # in which the solutions of neighbouring goals are tried
CHUNK = 30  # goals a file of partial results


@dataclass(frozen=True)
class LibraryRecipe:
    """Settings that determine a library.

    Attributes:
        robot: with one arm. keep_attitude: whether the final attitude equals the initial one. limited:
            whether motions satisfy the robot's limits. seed: of the initial guesses.
    """

    robot: Robot
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

    def as_dict(self) -> dict[str, Any]:
        """All settings as JSON values."""
        settings = {name: getattr(self, name) for name in ("keep_attitude", "limited", "seed")}
        return {"robot": described_robot(self.robot), **settings}


def robot_limits(robot: Robot) -> Limits:
    """Limits of a robot, as the environment's drives have them."""
    limits = robot.rate_limit, robot.acceleration_limit, robot.torque_limit
    return Limits(robot.joint_range, *limits)


def goals(robot: Robot, counts: Mapping[str, int] = COUNTS) -> tuple[Array, Array]:
    """Positions (L, 3) m and quaternions (L, 4) of train goals of a robot."""
    position, quaternion = [], []
    for difficulty, many in counts.items():
        drawn = SingleArmTask(difficulty=difficulty, robot=robot).goals("train", np.arange(many))
        position.append(drawn.position)
        quaternion.append(drawn.quaternion)
    return np.concatenate(position), np.concatenate(quaternion)


def goal_counts(total: int) -> dict[str, int]:
    """Goals of each difficulty for a library of about `total` motions, in the usual proportions.

    Raises:
        ConfigurationError: if the total is not positive.
    """
    whole = sum(COUNTS.values())
    shares = {
        name: positive_integer("goals", total, 3 * whole) * many / whole for name, many in COUNTS.items()
    }
    return {name: max(1, round(share)) for name, share in shares.items()}


def generate(
    output: str | Path,
    recipe: LibraryRecipe,
    counts: Mapping[str, int] = COUNTS,
    jobs: int = 1,
    progress: bool = False,
) -> Library:
    """Make a library in the folder `output`; existing parts of the same recipe are reused.

    The result does not depend on the number of jobs nor on interruptions.

    Raises:
        ConfigurationError: if jobs is not positive, or parts are of another robot, recipe or other goals.
        StorageError: if a part is damaged.
    """
    if jobs < 1:
        raise ConfigurationError(f"jobs must be at least 1, got {jobs}")
    folder = Path(output) / Path(recipe.name).stem
    _begin(folder, recipe)
    position, quaternion = goals(recipe.robot, counts)
    total = len(position) * (ROUNDS + 1)
    with tqdm(total=total, unit="goal", desc=folder.name, disable=not progress) as bar:
        library = _round(folder, recipe, position, quaternion, 0, None, jobs, bar)
        for number in range(1, ROUNDS + 1):
            library = _round(folder, recipe, position, quaternion, number, library, jobs, bar)
    solved = library.rows(np.isfinite(library.cost))
    solved = replace(solved, coordinates=solved.coordinates.astype(np.float32))
    path = Path(output) / recipe.name
    solved.save(path)
    origin = recipe.as_dict() | {
        "command": library_command(recipe.robot, recipe.keep_attitude, recipe.limited),
        "train goals": dict(counts),
        "motions": len(solved.cost),
        "commit": commit(),
        "versions": versions(),
        "machine": machine(),
    }
    write_json(path.with_suffix(".json"), origin)
    return solved


def _begin(folder: Path, recipe: LibraryRecipe) -> None:
    """Note the recipe in a folder of parts; ConfigurationError if the parts there are of another one."""
    path, expected = folder / "recipe.json", recipe.as_dict()
    if not path.exists():
        write_json(path, expected)
        return
    found = read_object(path)
    refuse_other_robot(str(folder), found.get("robot"), recipe.robot)
    if found != expected:
        raise ConfigurationError(f"{folder} holds parts of another recipe; take another folder")


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
    context = PolicyContext.from_env(CaptureVectorEnv(ENV_ID, robot=recipe.robot))
    robot, duration = context.arm, motion_duration(recipe.robot)
    limits = robot_limits(recipe.robot) if recipe.limited else Limits()
    planner = OptimalPlanner(robot, limits, further=further_rows(context, limited=recipe.limited))
    rows = []
    for number, goal_position, goal_quaternion in zip(numbers, position, quaternion, strict=True):
        goal = Grapple.at_rest(goal_position, goal_quaternion)
        reach = Reach(robot.home, goal, duration, keep_attitude=recipe.keep_attitude).checked(robot)
        if before is None:
            rows.append(first_motion(planner, reach, np.random.default_rng([recipe.seed, number])))
        else:
            rows.append(improved_motion(planner, reach, before, int(number), last))
    coordinates, cost, attempts = (np.array(column) for column in zip(*rows, strict=True))
    Library(position, quaternion, coordinates, cost, attempts).save(path)
    return len(numbers)
