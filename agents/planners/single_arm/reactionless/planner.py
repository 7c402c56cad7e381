"""Captures of a pose while the satellite does not turn at any instant, planned from stored motions."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.library import Library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.reactionless.limits import PathLimits
from agents.planners.single_arm.reactionless.objectives import least_disturbance, shortest_duration
from agents.planners.single_arm.reactionless.paths import FUNCTIONS, PathSpace, Samples
from agents.planners.single_arm.reactionless.search import minimise, predicted, to_goal
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, to_matrix
from space_envs.errors import positive_integer, unknown_name

METHOD = "promp_reactionless"
Timing = Literal["latest", "shortest"]
TIMINGS = ("latest", "shortest")
CANDIDATES = 8  # stored motions, by distance of their goals, that are tried until one leads to a plan
MOST_STARTS = 10_000
RANKED = 3  # of them, that are tried in the order of their predicted objectives
RANDOM = 16  # starts at random, where no stored motion leads to a plan
RANDOM_SCALES = 0.5, 1.6  # rad, standard deviation of their slowest sine; that of others falls with 1 / order
NEWTON = 30  # iterations to the goal at most
ITERATIONS = 12  # of the search for the least cost
SHORTENING = 4  # searches for a shorter duration, each at the duration of the last
SHORTENING_ITERATIONS = 8  # of each of them
SHARES = 0.9, 0.82  # of the limits that a search allows at its nodes, and the next one if it was too much
POLISHED = 1e-6  # m and rad, pose error of a plan
POLISHING = 5  # iterations at most
SPARE = 1.003  # times the shortest duration of a path
AT_REST = 1e-9  # rad/s


class Candidate(NamedTuple):
    """A path with its pose error polished, and the shortest duration that it can have, s."""

    weights: Array
    path: Samples
    shortest: float
    failure: Failure | None  # because of which it is no plan at any duration

    def keeps(self, duration: float) -> bool:
        """Whether it keeps all limits at a duration in s."""
        return self.failure is None and self.shortest <= duration

    def cost(self, duration: float) -> float:
        """Eq. 20 times dt at a duration in s, m^2/s: of displacement alone, which is at rest at both ends."""
        return float((self.path.drift**2).sum()) / (len(self.path.drift) - 1) / duration


class ReactionlessPlanner:
    """Plans for one robot and its limits.

    Args:
        robot: of one arm with at least seven joints. limits: of paths. library: of stored paths to start
            from; None starts at random.
        timing: "latest" arrives after exactly the duration of a problem, with the least base disturbance by
            eq. 20, which falls with the duration; "shortest" arrives as soon as the limits allow.
        candidates: number of stored paths that are tried. random: number of starts at random, where none of
            them leads to a plan.
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
        self._free = replace(limits, gaps=None)  # from the satellite
        limits.limits.checked(robot)
        self._candidates = positive_integer("candidates", candidates, MOST_STARTS)
        self._random = positive_integer("random", random, MOST_STARTS)

    def plan(self, reach: Reach) -> ReachPlan | Failure:
        """The motion from rest of a problem, whose duration is the longest one."""
        reach = reach.checked(self._robot)
        if (failure := self._refusal(reach)) is not None:
            return failure
        space = self.space(reach)
        failures: list[Failure] = []
        for number, start in enumerate(self._starts(space, reach), 1):
            found = self.improved(space, start, reach.duration)
            if found.keeps(reach.duration):
                return self._motion(found, reach, f"start {number}")
            failures.append(found.failure or _too_long(found.shortest, reach.duration))
        return min(failures, key=lambda failure: failure.residual)

    def space(self, reach: Reach) -> PathSpace:
        """Paths of a problem."""
        return PathSpace(self._robot, reach.start, reach.position, to_matrix(reach.quaternion))

    def improved(self, space: PathSpace, weights: Array, duration: float) -> Candidate:
        """The path to the goal near weights (n, K): of least cost at a duration, or the shortest.

        The satellite is looked at only where a path comes too close to it.
        """
        found = self._improved(space, to_goal(space, weights, NEWTON), duration, self._free)
        if _touches(found):
            return self._improved(space, found.weights, duration, self._limits)
        return found

    def _improved(self, space: PathSpace, weights: Array, duration: float, limits: PathLimits) -> Candidate:
        """The same within some of the limits."""
        if self._timing == "shortest":
            return self._shortened(space, weights, 0.0, limits)
        found = self._cheaper(space, weights, duration, limits, SHARES[0])
        if not found.keeps(duration) and not _touches(found):
            found = self._cheaper(space, found.weights, duration, limits, SHARES[1])
        if found.keeps(duration) or _touches(found):
            return found
        short = self._shortened(space, found.weights, duration, limits)
        if short.keeps(duration):
            found = self._cheaper(space, short.weights, duration, limits, SHARES[1])
        return found if found.keeps(duration) else short

    def _cheaper(
        self, space: PathSpace, weights: Array, duration: float, limits: PathLimits, share: float
    ) -> Candidate:
        """The path of least cost near weights within a share of the limits."""
        objective = least_disturbance(space, limits, duration, share)
        return self._polished(space, minimise(space, weights, objective, ITERATIONS).weights)

    def _shortened(self, space: PathSpace, weights: Array, enough: float, limits: PathLimits) -> Candidate:
        """The path with the shortest duration near weights, or one that is short enough."""
        best = self._polished(space, weights)
        for _ in range(SHORTENING):
            objective = shortest_duration(space, limits, best.shortest)
            found = self._polished(
                space, minimise(space, best.weights, objective, SHORTENING_ITERATIONS).weights
            )
            if best.failure is None and (found.failure is not None or found.shortest >= best.shortest):
                return best
            best = found
            if best.keeps(enough):
                return best
        return best

    def _polished(self, space: PathSpace, weights: Array) -> Candidate:
        """Weights whose finely rolled out path ends at the goal."""
        path, inverse = space.samples(weights), None
        for _ in range(POLISHING):
            if np.abs(path.miss).max() < POLISHED:
                break
            if inverse is None:
                inverse = np.linalg.pinv(space.sensitive(weights)[1].miss)
            weights = weights - (inverse @ path.miss).reshape(FUNCTIONS, space.n).T
            path = space.samples(weights)
        shortest = SPARE * max(self._limits.duration(space, path).values())
        return Candidate(weights, path, shortest, self._fault(path))

    def _fault(self, path: Samples) -> Failure | None:
        """Failure of a path that is no plan at any duration."""
        if not (miss := float(np.abs(path.miss).max())) < POLISHED:
            return Failure(
                METHOD, Cause.SOLVER, f"the search left {miss:.2g} m or rad to the goal", 3e3 + miss
            )
        if (beyond := self._limits.beyond(path)) > 0.0:
            reason = f"the path found leaves a joint's range by {beyond:.3f} rad"
            return Failure(METHOD, Cause.JOINT_LIMIT, reason, 2e3 + beyond)
        if (close := self._limits.closeness(path)) > 0.0:
            reason = f"the path found comes {close:.3f} m too close to the satellite"
            return Failure(METHOD, Cause.CLEARANCE, reason, 1e3 + close)
        return None

    def _starts(self, space: PathSpace, reach: Reach) -> Iterator[Array]:
        """Weights (n, K) to start from: stored ones, the first few in the order of predicted objectives."""
        if self._library is not None:
            near = self._library.nearest(reach, self._candidates)
            leading = [to_goal(space, weights, NEWTON) for weights in near[:RANKED]]
            if len(leading) > 1:
                objective = least_disturbance(space, self._free, reach.duration, SHARES[0])
                leading.sort(key=lambda weights: predicted(space, weights, objective))
            yield from leading
            yield from near[RANKED:]
        rng = np.random.default_rng(0)
        yield from random_starts(rng, self._robot.n_joints, self._random)

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
        robot = self._robot
        centre = robot.centre_of_mass(robot.kinematics(reach.start))
        distance, longest = float(np.linalg.norm(reach.position - centre)), robot.reach()
        if distance <= longest:
            return None
        reason = f"the goal is {distance:.2f} m from the centre of mass, the arm reaches {longest:.2f} m"
        return Failure(METHOD, Cause.OUT_OF_REACH, reason)


def _touches(found: Candidate) -> bool:
    """Whether a path comes too close to the satellite."""
    return found.failure is not None and found.failure.cause is Cause.CLEARANCE


def random_starts(rng: np.random.Generator, n: int, count: int) -> Iterable[Array]:
    """Weights (n, K) at random, `count` times."""
    order = np.arange(1, FUNCTIONS + 1)
    for _ in range(count):
        yield rng.uniform(*RANDOM_SCALES) * rng.standard_normal((n, FUNCTIONS)) / order


def _too_long(shortest: float, duration: float) -> Failure:
    reason = f"the shortest motion found takes {shortest:.1f} s, there are {duration:.1f} s"
    return Failure(METHOD, Cause.INFEASIBLE, reason, shortest - duration)
