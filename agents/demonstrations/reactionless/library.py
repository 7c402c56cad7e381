"""A library of reactionless motions: each goal is solved at random, then from its neighbours."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from joblib import Parallel, delayed
from tqdm import tqdm

from agents.demonstrations.optimal.library import COUNTS, goals
from agents.planners.common.robot_files import robot_options, write_origin
from agents.planners.single_arm.library import REACTIONLESS, Library
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.reactionless.improvement import PathImprover
from agents.planners.single_arm.reactionless.paths import PathSpace
from agents.planners.single_arm.reactionless.planner import random_starts, space_of
from agents.policies.single_arm.reactionless.problem import latest_arrival, path_limits
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import positive_integer
from space_envs.policy import PolicyContext
from space_envs.robots.robot import Robot
from space_envs.system.provenance import commit, machine, versions
from space_envs.system.threads import on_one_thread

ENV = "SpaceCapture/SingleArm-v0"
STARTS = 3  # at random, of each goal
ROUNDS = 2  # in which the motions of neighbouring goals are tried
NEIGHBOURS = 5  # of a round
CHUNK = 10  # goals of a job
LATE = 1.0  # m^2/s, cost of a motion per second that it takes longer than the task gives


class _Best(NamedTuple):
    """The best motion of a goal so far: its weights (n, K), its cost and what led to it."""

    weights: Array
    cost: float
    attempts: int


def generate(
    output: str | Path,
    robot: Robot,
    counts: Mapping[str, int] = COUNTS,
    seed: int = 0,
    jobs: int = 1,
    progress: bool = False,
) -> Library:
    """Make the library of a robot in the folder `output`; it does not depend on the number of jobs.

    Raises:
        ConfigurationError: if jobs is not positive or a number of goals is not valid.
    """
    positive_integer("jobs", jobs, 4096)
    position, quaternion = goals(robot, counts)
    total = len(position)
    rows = [np.arange(first, min(first + CHUNK, total)) for first in range(0, total, CHUNK)]
    with tqdm(total=total * (ROUNDS + 1), unit="goal", disable=not progress) as bar:

        def round_from(before: Library | None) -> Library:
            work = [delayed(_part)(robot, position[k], quaternion[k], k, before, seed) for k in rows]
            found: list[_Best] = []
            parts: Any = Parallel(n_jobs=jobs, return_as="generator")(work)
            for part in parts:
                found += part
                bar.update(len(part))
            return _library(position, quaternion, found)

        library = round_from(None)
        for _ in range(ROUNDS):
            library = round_from(library)
    usable = library.rows(np.isfinite(library.cost))
    path = Path(output) / REACTIONLESS
    path.parent.mkdir(parents=True, exist_ok=True)
    usable.save(path)
    origin = {
        "command": f"python -m agents.demonstrations.reactionless {robot_options(robot)}",
        "seed": seed,
        "train goals": dict(counts),
        "motions": len(usable.cost),
        "commit": commit(),
        "versions": versions(),
        "machine": machine(),
    }
    write_origin(path, robot, origin)
    return usable


def _library(position: Array, quaternion: Array, found: list[_Best]) -> Library:
    weights, cost, attempts = (np.array(column) for column in zip(*found, strict=True))
    return Library(position, quaternion, weights.astype(np.float32), cost, attempts)


def _part(
    robot: Robot, position: Array, quaternion: Array, numbers: Array, before: Library | None, seed: int
) -> list[_Best]:
    """Best motions of some goals after a round, from the library before it."""
    on_one_thread()  # several threads of BLAS give other bits
    context = PolicyContext.from_env(CaptureVectorEnv(ENV, 1, robot=robot))
    improver, duration = PathImprover(path_limits(context)), latest_arrival(context)
    found = []
    for number, goal_position, goal_quaternion in zip(numbers, position, quaternion, strict=True):
        goal = Grapple.at_rest(goal_position, goal_quaternion)
        reach = Reach(context.arm.home, goal, duration).checked(context.arm)
        if before is None:
            rng = np.random.default_rng([seed, int(number)])
            best = _Best(np.zeros((context.joints, 0)), np.inf, 0)
            starts = list(random_starts(rng, context.joints, STARTS))
        else:
            best = _Best(before.coordinates[number], float(before.cost[number]), int(before.attempts[number]))
            near = before.order(reach)
            near = near[(near != number) & np.isfinite(before.cost[near])][:NEIGHBOURS]
            starts = [*before.coordinates[near].astype(np.float64)]
        for start in starts:
            best = _better(improver, space_of(context.arm, reach), duration, start, best)
        found.append(best)
    return found


def _better(improver: PathImprover, space: PathSpace, duration: float, start: Array, best: _Best) -> _Best:
    """The best motion so far or the one near a start."""
    found = improver.least_cost(space, start, duration)
    late = max(0.0, found.shortest - duration)
    cost = np.inf if found.failure is not None else found.cost(duration + late) + LATE * late
    if cost < best.cost:
        return _Best(found.weights, cost, best.attempts + 1)
    weights = best.weights if best.weights.size else np.zeros_like(found.weights)
    return _Best(weights, best.cost, best.attempts + 1)
