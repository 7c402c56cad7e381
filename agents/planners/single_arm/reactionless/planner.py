"""Captures of a pose while the satellite does not turn at any instant, planned from stored motions."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from agents.planners.common.plans import Cause, Failure, start_beyond_limits
from agents.planners.single_arm.library import Library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.reactionless.clearances import CLEARANCE, SphereKeepOut
from agents.planners.single_arm.reactionless.goals import PoseRows
from agents.planners.single_arm.reactionless.improvement import (
    METHOD,
    QUICK,
    Candidate,
    Effort,
    PathImprover,
)
from agents.planners.single_arm.reactionless.interception import Interceptor
from agents.planners.single_arm.reactionless.limits import PathLimits
from agents.planners.single_arm.reactionless.paths import FUNCTIONS, PathSpace
from agents.planners.single_arm.reactionless.search import promise
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, to_matrix
from space_envs.dynamics.spheres import link_ends, sphere_gaps
from space_envs.errors import positive_integer, unknown_name

Timing = Literal["latest", "shortest"]
TIMINGS = ("latest", "shortest")
CANDIDATES = 24  # stored motions, by distance of their goals, that are tried until one leads to a plan
MOST_STARTS = 10_000
RANKED = 4  # of them, that are tried in the order of their predicted objectives
RANDOM = 16  # starts at random, where there is no library
RANDOM_SCALES = 0.5, 1.6  # rad, standard deviation of their slowest sine; that of others falls with 1 / order
AT_REST = 0.01  # rad/s, what sensors may show of an arm at rest; the tracking takes up slower motion
# Causes of candidates' failures, from those nearest to a plan; the nearest failure is told.
NEAREST_FIRST = Cause.INFEASIBLE, Cause.CLEARANCE, Cause.JOINT_LIMIT, Cause.SOLVER


class Guess(NamedTuple):
    """Path that is tried first: weights (n, K), the effort for it, and whether others follow."""

    weights: Array
    effort: Effort
    search: bool = True


class ReactionlessPlanner:
    """Plans for one robot and its limits.

    Args:
        robot: of one arm with at least seven joints. limits: of paths. library: of stored paths to start
            from; None starts at random.
        timing: "latest" arrives after exactly the duration of a problem, with the least base disturbance by
            eq. 20, which falls with the duration; "shortest" arrives as soon as the limits allow.
        candidates: number of stored paths that are tried. random: number of starts at random, without a
            library.
    """

    def __init__(
        self,
        robot: FloatingRobot,
        limits: PathLimits,
        library: Library | None = None,
        timing: Timing = "latest",
        candidates: int = CANDIDATES,
        random: int = RANDOM,
    ) -> None:
        if timing not in TIMINGS:
            raise unknown_name("timing", timing, TIMINGS)
        self._robot, self._limits, self._library, self._timing = robot, limits, library, timing
        limits.limits.checked(robot)
        self._candidates = positive_integer("candidates", candidates, MOST_STARTS)
        self._random = positive_integer("random", random, MOST_STARTS)

    def plan(self, reach: Reach, guess: Guess | None = None) -> ReachPlan | Failure:
        """The motion from rest of a problem, whose duration is the longest one.

        A moving grapple is met at the given duration, or at the best time of a window; guesses are ignored.

        Raises:
            ConfigurationError: for a malformed problem.
        """
        reach = reach.checked(self._robot)
        if (failure := self._refusal(reach)) is not None:
            return failure
        if reach.goal.moves:
            return Interceptor(self._robot, self._limits_around(reach), self._starts).plan(reach)
        if reach.window is not None:  # the later, the less disturbance
            reach = replace(reach, duration=reach.window[1])
        space = space_of(self._robot, reach)
        failures: list[Failure] = []
        for number, found in enumerate(self._candidates_of(space, reach, guess), 1):
            if found.keeps(reach.duration):
                return self._motion(found, reach, f"candidate {number}")
            failures.append(found.failure or _too_long(found.shortest, reach.duration))
        return min(failures, key=lambda failure: (NEAREST_FIRST.index(failure.cause), failure.residual))

    def _limits_around(self, reach: Reach) -> PathLimits:
        """The limits, with clearance from the spheres of a problem."""
        if reach.spheres is None or not len(reach.spheres):
            return self._limits
        keep_out = SphereKeepOut(self._robot, reach.spheres, reach.link_radius)
        return replace(self._limits, clearances=(*self._limits.clearances, keep_out))

    def _candidates_of(self, space: PathSpace, reach: Reach, guess: Guess | None) -> Iterator[Candidate]:
        """Paths to the goal until one of them is a plan, from the quickest to find to the others."""
        improver, duration = PathImprover(self._limits_around(reach)), reach.duration
        if guess is not None:
            yield improver.guessed(space, guess.weights, duration, guess.effort)
            if not guess.search:
                return
        near = self._starts(reach)
        if self._timing == "shortest":
            yield from (improver.shortest(space, start) for start in near)
            return
        leading = near[:RANKED]
        problem = improver.problem(space, duration)
        leading.sort(key=lambda weights: promise(problem, weights))
        found: list[Candidate] = []
        for start in leading:
            found.append(improver.least_cost(space, start, duration, QUICK))
            yield found[-1]
        starts = [*(candidate.weights for candidate in found), *near[RANKED:]]
        if reach.spheres is not None and len(reach.spheres) and self._library is not None:
            starts += self._random_starts()
        yield from (improver.feasible(space, start, duration) for start in starts)

    def _starts(self, reach: Reach) -> list[Array]:
        """Weights (n, K) of stored motions, the nearest goals first, or random ones without a library."""
        if self._library is not None:
            return [*self._library.nearest(reach, self._candidates)]
        return self._random_starts()

    def _random_starts(self) -> list[Array]:
        return [*random_starts(np.random.default_rng(0), self._robot.n_joints, self._random)]

    def _motion(self, found: Candidate, reach: Reach, notes: str) -> ReachPlan:
        """The plan of a path."""
        t = found.shortest if self._timing == "shortest" else reach.duration
        phase, path = np.linspace(0.0, 1.0, len(found.path.angle)), found.path
        rates = path.slope / t, path.curve / t**2
        return ReachPlan(METHOD, phase * t, path.angle, *rates, found.cost(t), notes=notes)

    def _refusal(self, reach: Reach) -> Failure | None:
        """Failure of a problem that no path solves."""
        if reach.rate is not None and np.abs(reach.rate).max() > AT_REST:
            return Failure(METHOD, Cause.INFEASIBLE, "reactionless motions start at rest, the arm moves")
        if (beyond := start_beyond_limits(METHOD, reach.start, self._limits.limits)) is not None:
            return beyond
        if reach.goal.moves and reach.window is not None:  # where it is met is not known yet
            return None
        if (inside := _in_sphere(self._robot, reach)) is not None:
            return inside
        robot = self._robot
        centre = robot.centre_of_mass(robot.kinematics(reach.start))
        distance, longest = float(np.linalg.norm(reach.end.position - centre)), robot.reach()
        if distance <= longest:
            return None
        reason = f"the goal is {distance:.2f} m from the centre of mass, the arm reaches {longest:.2f} m"
        return Failure(METHOD, Cause.OUT_OF_REACH, reason)


def space_of(robot: FloatingRobot, reach: Reach) -> PathSpace:
    """Paths of a checked problem."""
    rows = PoseRows(robot, reach.end.position, to_matrix(reach.end.quaternion), reach.kind)
    return PathSpace(robot, reach.start, rows)


def random_starts(rng: np.random.Generator, n: int, count: int) -> Iterator[Array]:
    """Weights (n, K) at random, `count` times."""
    order = np.arange(1, FUNCTIONS + 1)
    for _ in range(count):
        yield rng.uniform(*RANDOM_SCALES) * rng.standard_normal((n, FUNCTIONS)) / order


def _in_sphere(robot: FloatingRobot, reach: Reach) -> Failure | None:
    """Failure of a problem that begins or ends too close to a sphere."""
    if reach.spheres is None or not len(reach.spheres):
        return None
    ends = link_ends(robot, reach.start, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    start = sphere_gaps(ends, reach.spheres, reach.link_radius).min(axis=0)
    last = np.stack([reach.end.position, reach.end.position])
    goal = sphere_gaps(last, reach.spheres, np.broadcast_to(reach.link_radius, robot.n_joints)[-1])[0]
    for where, gap in (("at the start a link is", start), ("at the goal the last link would be", goal)):
        if gap.min() <= CLEARANCE:
            reason = f"{where} {gap.min():.3f} m from sphere {gap.argmin() + 1}"
            return Failure(METHOD, Cause.CLEARANCE, reason)
    return None


def _too_long(shortest: float, duration: float) -> Failure:
    reason = f"the shortest motion found takes {shortest:.1f} s, there are {duration:.1f} s"
    return Failure(METHOD, Cause.INFEASIBLE, reason, shortest - duration)
