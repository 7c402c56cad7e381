"""Times of the single steps of the algorithm (V-D), one after the other in this process."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from time import perf_counter

import numpy as np

from agents.demonstrations.controller import demonstrate
from agents.demonstrations.prior import fit_prior
from agents.demonstrations.variations import DemonstratorConfig
from agents.policies.single_arm.promp import prior_of
from promp import ViaPoint
from reproduce.shyam2020.cases import GoalCase, context
from reproduce.shyam2020.sampling import SAMPLES, joint_goal, prior
from space_envs.dynamics import trajectory_cost
from space_envs.errors import PlanningError

REPEATS = 20  # of what is timed
DEMONSTRATIONS = 30  # that are generated and fitted to see how long it takes


@dataclass(frozen=True)
class StepTimes:
    """Seconds of each step by its key, one entry a repeat.

    Attributes:
        samples: number of motions drawn at once. sample_times: number of times in each.
    """

    seconds: Mapping[str, list[float]]
    samples: int
    sample_times: int


def step_times(case: GoalCase, seed: int) -> StepTimes:
    """Measure the steps on one goal.

    Raises:
        PlanningError: for a goal without a joint goal.
    """
    started = perf_counter()
    demonstrations = demonstrate(context().robot, DemonstratorConfig(), seed, 0, DEMONSTRATIONS)
    making = (perf_counter() - started) / DEMONSTRATIONS
    at, bare, arm = prior(), prior_of(context().robot), context().arm
    goal = joint_goal(case)
    if goal is None:
        raise PlanningError(f"goal {case.index} has no joint goal to time the steps with")
    rest, duration = np.zeros_like(goal), float(at.times[-1])
    ends = [ViaPoint(0.0, case.start, rest, duration), ViaPoint(1.0, goal, rest, duration)]
    conditioned = bare.condition_on(ends)
    rng = np.random.default_rng(seed)
    motion = at.motion(conditioned.sample(rng, SAMPLES))
    seconds = {
        "demonstration": [making],
        "fit": _times(lambda: fit_prior(demonstrations)),
        "goal": _times(lambda: joint_goal(case)),
        "condition": _times(lambda: bare.condition_on(ends)),
        "sample": _times(lambda: at.motion(conditioned.sample(rng, SAMPLES))),
        "cost": _times(lambda: trajectory_cost(arm, motion.position, motion.velocity, motion.dt)),
    }
    return StepTimes(seconds, SAMPLES, motion.position.shape[1])


def _times(call: Callable[[], object]) -> list[float]:
    """Seconds of `REPEATS` calls, after one that is not counted."""
    call()
    found = []
    for _ in range(REPEATS):
        started = perf_counter()
        call()
        found.append(perf_counter() - started)
    return found
