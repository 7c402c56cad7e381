"""A library of reactionless motions: each goal is solved at random, then from its neighbours."""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np

from agents.demonstrations.optimal.library import COUNTS, goals
from agents.demonstrations.rounds import Motion, RoundsRecipe, Solver, make_library
from agents.planners.single_arm.library import REACTIONLESS, Library, reactionless_command
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.reactionless.improvement import Effort, PathImprover
from agents.planners.single_arm.reactionless.paths import FUNCTIONS, PathSpace
from agents.planners.single_arm.reactionless.planner import random_starts, space_of
from agents.policies.single_arm.reactionless.problem import latest_arrival, path_limits
from space_envs.checks import count
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.policy import PolicyContext
from space_envs.robots.robot import Robot

ENV = "SpaceCapture/SingleArm-v0"
STARTS = 2  # at random, of each goal
ROUNDS = 2  # in which the motions of neighbouring goals are tried
NEIGHBOURS = 4  # of a round
CHUNK = 10  # goals a file of partial results
TRIED, EXHAUSTIVE = Effort(20, 1e-2, clear=False), Effort(40, 1e-3, clear=False)
LATE = 1.0  # m^2/s, cost of a motion per second that it takes longer than the task gives


def generate(
    output: str | Path,
    robot: Robot,
    counts: Mapping[str, int] = COUNTS,
    seed: int = 0,
    jobs: int = 1,
    progress: bool = False,
) -> Library:
    """Make the library of a robot in the folder `output`; existing parts of the same settings are reused.

    The result does not depend on the number of jobs nor on interruptions.

    Raises:
        ConfigurationError: if jobs is not positive, a number of goals is not valid, or parts are of another
            robot, seed or other goals.
        StorageError: if a part is damaged.
    """
    settings = {"seed": count("seed", seed, 2**63), "functions": FUNCTIONS}
    work = partial(_solver, robot, seed)
    recipe = RoundsRecipe(robot, REACTIONLESS, settings, work, reactionless_command(robot), ROUNDS, CHUNK)
    origin = {"train goals": dict(counts)}
    return make_library(output, recipe, goals(robot, counts), origin, jobs, progress)


def _solver(robot: Robot, seed: int) -> Solver:
    """Best motions of goals so far, from random starts in the first round, then from their neighbours."""
    context = PolicyContext.from_env(CaptureVectorEnv(ENV, 1, robot=robot))
    improver, duration = PathImprover(path_limits(context)), latest_arrival(context)

    def motion(
        position: Array, quaternion: Array, number: int, before: Library | None, round_number: int
    ) -> Motion:
        goal = Grapple.at_rest(position, quaternion)
        reach = Reach(context.arm.home, goal, duration).checked(context.arm)
        if before is None:
            rng = np.random.default_rng([seed, number])
            best, attempts = (np.zeros((context.joints, FUNCTIONS)), np.inf), 0.0
            starts = list(random_starts(rng, context.joints, STARTS))
        else:
            best = before.coordinates[number], float(before.cost[number])
            attempts = float(before.attempts[number])
            near = before.order(reach)
            starts = [*before.coordinates[near[(near != number) & np.isfinite(before.cost[near])]]]
            starts = starts[:NEIGHBOURS]
        space = space_of(context.arm, reach)
        for start in starts:
            best = min(best, tried(space, start, TRIED), key=lambda one: one[1])
        if round_number == ROUNDS and np.isfinite(best[1]):
            best = min(best, tried(space, best[0], EXHAUSTIVE), key=lambda one: one[1])
        return best[0], best[1], attempts + len(starts)

    def tried(space: PathSpace, start: Array, effort: Effort) -> tuple[Array, float]:
        """Weights and cost of the motion near a start."""
        found = improver.least_cost(space, start, duration, effort)
        if found.failure is not None:
            return found.weights, np.inf
        late = max(0.0, found.shortest - duration)
        return found.weights, found.cost(duration + late) + LATE * late

    return motion
