"""Paths of least cost or of the shortest duration near others: polished, and checked against the limits."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.reactionless.clearances import clearance_fault
from agents.planners.single_arm.reactionless.limits import PathLimits
from agents.planners.single_arm.reactionless.objectives import (
    COST_UNIT,
    Objective,
    least_disturbance,
    shortest_duration,
)
from agents.planners.single_arm.reactionless.paths import FUNCTIONS, PathSpace, Samples
from agents.planners.single_arm.reactionless.search import minimise, to_goal
from space_envs.dynamics.rotations import Array

METHOD = "promp_reactionless"
NEWTON = 30  # iterations to the goal at most
ITERATIONS = 12  # of the search for the least cost
POWERS = 4.0, 4.0, 6.0, 8.0, 12.0  # of searches for a shorter duration, each at the duration of the best
SHORTENING_ITERATIONS = 8  # of each of them
SHARES = 0.9, 0.82  # of the limits that a search allows at its nodes, and the next one if it was too much
FEASIBLE_ITERATIONS = 25  # of the search for a path that is a plan at all
FEASIBLE_UNIT = 100.0 * COST_UNIT  # m^2/s, of costs in it
FEASIBLE_SHARE = 0.85  # of the limits at its nodes
DISTANT = 100.0  # s, duration of starts that are not worth it
NEARLY = 1.1  # times the duration, of its results that are shortened
HOPELESS = 1e4  # s, duration of paths that are not worth a search
POLISHED = 1e-6  # m and rad, pose error of a plan
POLISHING = 10  # iterations at most
SPARE = 1.003  # times the shortest duration at the samples, for what lies between them


class Candidate(NamedTuple):
    """A path with its pose error polished, and the shortest duration that it can have, s."""

    weights: Array
    path: Samples
    shortest: float
    failure: Failure | None  # because of which it is no plan at any duration

    def keeps(self, duration: float) -> bool:
        """Whether it keeps all limits at a duration in s."""
        return self.failure is None and self.shortest <= duration

    @property
    def touches(self) -> bool:
        """Whether it comes too close to an obstacle."""
        return self.failure is not None and self.failure.cause is Cause.CLEARANCE

    def cost(self, duration: float) -> float:
        """Eq. 20 times dt up to the goal, m^2/s, at a duration of the path in s: of displacement alone."""
        moved = self.path.drift[: self.path.end + 1]
        return float((moved**2).sum()) / (len(self.path.drift) - 1) / duration


class PathImprover:
    """Improves paths within the limits of a robot; it looks at clearances where a path comes too close."""

    def __init__(self, limits: PathLimits) -> None:
        self._limits, self._free = limits, replace(limits, clearances=())

    def promise(self, space: PathSpace, duration: float) -> Objective:
        """The objective of `least_cost`, by which starts can be compared."""
        return least_disturbance(space, self._free, duration, SHARES[0])

    def least_cost(self, space: PathSpace, weights: Array, duration: float) -> Candidate:
        """The path of least cost near weights (n, K) at a duration in s, or one that is nearly as short."""
        found = self.cheaper(space, weights, duration)
        return found if found.keeps(duration) else self.shorter(space, found.weights, duration)

    def cheaper(self, space: PathSpace, weights: Array, duration: float) -> Candidate:
        """The same, without an effort for a path that is too long."""
        weights = to_goal(space, weights, NEWTON)
        for limits in (self._free, self._limits):
            for share in SHARES:
                found = self._cheaper(space, weights, duration, limits, share)
                if found.keeps(duration) or found.touches:
                    break
                weights = found.weights
            if not found.touches:
                break
        return found

    def shorter(self, space: PathSpace, weights: Array, duration: float) -> Candidate:
        """The same, from a path that is shortened first."""
        short = self.shortest(space, weights, duration)
        if not short.keeps(duration):
            return short
        found = self._cheaper(space, short.weights, duration, self._limits, SHARES[-1])
        return found if found.keeps(duration) else short

    def feasible(self, space: PathSpace, weights: Array, duration: float) -> Candidate:
        """A path within all limits near weights, at a cost that is reduced once there is one."""
        found = self.polished(space, to_goal(space, weights, NEWTON))
        if not found.shortest < DISTANT:
            return found
        objective = least_disturbance(space, self._limits, duration, FEASIBLE_SHARE, FEASIBLE_UNIT)
        found = self.polished(space, minimise(space, found.weights, objective, FEASIBLE_ITERATIONS).weights)
        if not found.keeps(duration) and found.shortest < NEARLY * duration:
            found = self._shortened(space, found.weights, duration, self._limits)
        if not found.keeps(duration):
            return found
        cheaper = self._cheaper(space, found.weights, duration, self._limits, FEASIBLE_SHARE)
        return cheaper if cheaper.keeps(duration) else found

    def shortest(self, space: PathSpace, weights: Array, enough: float = 0.0) -> Candidate:
        """The path with the shortest duration near weights (n, K), or one that is short enough, s."""
        found = self._shortened(space, to_goal(space, weights, NEWTON), enough, self._free)
        return self._shortened(space, found.weights, enough, self._limits) if found.touches else found

    def _cheaper(
        self, space: PathSpace, weights: Array, duration: float, limits: PathLimits, share: float
    ) -> Candidate:
        """The path of least cost near weights within a share of the limits."""
        objective = least_disturbance(space, limits, duration, share)
        return self.polished(space, minimise(space, weights, objective, ITERATIONS).weights)

    def _shortened(self, space: PathSpace, weights: Array, enough: float, limits: PathLimits) -> Candidate:
        """The path with the shortest duration near weights, or one that is short enough."""
        best = self.polished(space, weights)
        for power in POWERS:
            if not best.shortest < HOPELESS:
                break
            objective = shortest_duration(space, limits, best.shortest, power)
            found = minimise(space, best.weights, objective, SHORTENING_ITERATIONS)
            candidate = self.polished(space, found.weights)
            if best.failure is not None or candidate.keeps(best.shortest):
                best = candidate
            if best.keeps(enough):
                break
        return best

    def polished(self, space: PathSpace, weights: Array) -> Candidate:
        """Weights whose finely rolled out path ends at the goal."""
        path, inverse = space.samples(weights), None
        for _ in range(POLISHING):
            if np.abs(path.miss).max() < POLISHED:
                break
            if inverse is None:
                by = space.sensitive(weights)[1]
                if not by.usable:
                    break
                inverse = by.miss.T @ np.linalg.inv(by.miss @ by.miss.T)
            weights = weights - (inverse @ path.miss).reshape(FUNCTIONS, space.n).T
            path = space.samples(weights)
        shortest = SPARE * max(self._limits.duration(space, path).values())
        return Candidate(weights, path, shortest, self._fault(path))

    def _fault(self, path: Samples) -> Failure | None:
        """Failure of a path that is no plan at any duration."""
        if not (miss := float(np.nan_to_num(np.abs(path.miss), nan=np.inf).max())) < POLISHED:
            return Failure(METHOD, Cause.SOLVER, f"the search left {miss:.2g} m or rad to the goal", miss)
        if (beyond := self._limits.beyond(path)) > 0.0:
            reason = f"the path found leaves a joint's range by {beyond:.3f} rad"
            return Failure(METHOD, Cause.JOINT_LIMIT, reason, beyond)
        if (fault := clearance_fault(path, self._limits.clearances)) is not None:
            cause, reason, missing = fault
            return Failure(METHOD, cause, reason, missing)
        return None
