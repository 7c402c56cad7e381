"""A library of optimal motions, made in parallel and resumable: each goal is improved from its neighbours."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from agents.demonstrations.optimal.search import first_motion, improved_motion
from agents.demonstrations.rounds import Motion, RoundsRecipe, Solver, make_library
from agents.planners.common.plans import Limits
from agents.planners.single_arm.library import Library, library_command, library_name
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.policies.single_arm.optimal import further_rows
from agents.policies.single_arm.reaching import motion_duration
from space_envs.checks import count, flag
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import positive_integer
from space_envs.policy import PolicyContext
from space_envs.robots.robot import Robot
from space_envs.tasks.single_arm import SingleArmTask

COUNTS = {"easy": 120, "medium": 900, "hard": 180}  # goals of the train split
ENV_ID = "SpaceCapture/SingleArm-v0"  # whose train split gives the goals
ROUNDS = 5  # in which the solutions of neighbouring goals are tried
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

    @property
    def settings(self) -> dict[str, Any]:
        """All settings but the robot, as JSON values."""
        return {name: getattr(self, name) for name in ("keep_attitude", "limited", "seed")}


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
    planned = RoundsRecipe(
        recipe.robot,
        recipe.name,
        recipe.settings,
        partial(_solver, recipe),
        library_command(recipe.robot, recipe.keep_attitude, recipe.limited),
        ROUNDS,
        CHUNK,
    )
    origin = {"train goals": dict(counts)}
    return make_library(output, planned, goals(recipe.robot, counts), origin, jobs, progress)


def _solver(recipe: LibraryRecipe) -> Solver:
    """Motions of goals by the planner, from random starts in the first round, then from their neighbours."""
    context = PolicyContext.from_env(CaptureVectorEnv(ENV_ID, robot=recipe.robot))
    robot, duration = context.arm, motion_duration(recipe.robot)
    limits = robot_limits(recipe.robot) if recipe.limited else Limits()
    planner = OptimalPlanner(robot, limits, further=further_rows(context, limited=recipe.limited))

    def motion(
        position: Array, quaternion: Array, number: int, before: Library | None, round_number: int
    ) -> Motion:
        goal = Grapple.at_rest(position, quaternion)
        reach = Reach(robot.home, goal, duration, keep_attitude=recipe.keep_attitude).checked(robot)
        rng = np.random.default_rng([recipe.seed, number, round_number])
        if before is None:
            return first_motion(planner, reach, rng)
        return improved_motion(planner, reach, before, number, round_number == ROUNDS, rng)

    return motion
