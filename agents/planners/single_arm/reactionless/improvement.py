"""Paths of least cost or of the shortest duration near others: polished, and checked against the limits."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.reactionless.clearances import clearance_fault
from agents.planners.single_arm.reactionless.limits import PathLimits
from agents.planners.single_arm.reactionless.objectives import COST_UNIT, LeastDisturbance, PathObjective
from agents.planners.single_arm.reactionless.paths import FUNCTIONS, PathSpace, Samples
from agents.planners.single_arm.reactionless.search import PathProblem, minimise, to_goal
from space_envs.dynamics.rotations import Array

METHOD = "promp_reactionless"
FAR = 0.3  # m or rad to the goal, from which Newton steps come first
NEWTON = 30  # iterations to the goal at most
ASKED = 0.985  # times the duration, for which a search asks: its samples miss the peaks between them
TIGHTER = 0.997  # of what would have kept the limits between the samples as well, for the next search
SEARCHES = 4  # for one plan at most, from the last one's result
FASTER = 0.85  # times the shortest duration so far, for which a search asks next; its root once one fails
MINUTE = 0.01  # relative shortening that is not worth a search
SHORTENINGS = 30  # searches at most
FEASIBLE_UNIT = 100.0 * COST_UNIT  # m^2/s, of eq. 20 times dt where limits come first
HOPELESS = 1e4  # s, duration of paths that are not worth a search
POLISHED = 1e-6  # m and rad, pose error of a plan
POLISHING = 10  # iterations at most
SPARE = 1.003  # times the shortest duration at the samples, for what lies between them


class Effort(NamedTuple):
    """Effort of a search.

    Attributes:
        iterations: at most. gain: relative one below which an iteration is the last. nearly: violation, as a
            share of a limit, up to which a search goes on from its result. clear: whether clearances count
            from the start; otherwise once a path is found that comes too close.
    """

    iterations: int
    gain: float
    nearly: float = 0.15
    clear: bool = True


QUICK, PATIENT = Effort(10, 5e-3, nearly=0.3, clear=False), Effort(40, 3e-3)
CAREFUL, SHORTENING = Effort(20, 3e-3), Effort(8, 0.1)


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

    def problem(self, space: PathSpace, duration: float) -> PathProblem:
        """The search of `least_cost`, by which starts can be compared."""
        return self._problem(space, LeastDisturbance(space, duration), self._free, ASKED * duration)

    def least_cost(self, space: PathSpace, weights: Array, duration: float, effort: Effort) -> Candidate:
        """The path of least cost near weights (n, K) at a duration in s, or one that is nearly as short."""
        return self.least(space, LeastDisturbance(space, duration), weights, duration, effort)

    def guessed(self, space: PathSpace, weights: Array, duration: float, effort: Effort) -> Candidate:
        """A path near weights (n, K), polished alone if it then keeps the limits at a duration in s."""
        found = self.polished(space, weights)
        if found.keeps(duration) or not effort.iterations:
            return found
        return self.least_cost(space, weights, duration, effort)

    def feasible(self, space: PathSpace, weights: Array, duration: float) -> Candidate:
        """A path near weights (n, K) that keeps all limits, its cost made small once there is one."""
        objective = LeastDisturbance(space, duration, FEASIBLE_UNIT)
        found = self.least(space, objective, weights, duration, PATIENT)
        if not found.keeps(duration):
            return found
        cheaper = self.least_cost(space, found.weights, duration, CAREFUL)
        return cheaper if cheaper.keeps(duration) else found

    def least(
        self, space: PathSpace, objective: PathObjective, weights: Array, duration: float, effort: Effort
    ) -> Candidate:
        """The same for another objective."""
        limits, asked = self._limits if effort.clear else self._free, ASKED * duration
        if not np.abs(space.missed(weights)).max() < FAR:
            weights = to_goal(space, weights, NEWTON)
        for _ in range(SEARCHES):
            problem = self._problem(space, objective, limits, asked)
            search = minimise(problem, weights, effort.iterations, effort.gain)
            found = self.polished(space, search.weights)
            if found.keeps(duration) or search.violation > effort.nearly:
                break
            if search.kept and found.shortest > duration:
                asked *= TIGHTER * duration / found.shortest
            limits = self._limits if found.touches else limits
            weights = found.weights
        return found

    def shortest(self, space: PathSpace, weights: Array, enough: float = 0.0) -> Candidate:
        """The path with the shortest duration near weights (n, K), or one that is short enough, s."""
        best = self.polished(space, to_goal(space, weights, NEWTON))
        faster = FASTER
        for _ in range(SHORTENINGS):
            if best.keeps(enough) or not best.shortest < HOPELESS:
                break
            asked = max(faster * best.shortest, (1.0 - MINUTE) * enough)
            candidate = self._shorter(space, best.weights, asked)
            better = candidate.failure is None and candidate.shortest < (1.0 - MINUTE) * best.shortest
            if better or best.failure is not None:
                best = candidate
            if not better and faster > 1.0 - MINUTE:
                break
            faster = faster if better else np.sqrt(faster)
        return best

    def _shorter(self, space: PathSpace, weights: Array, duration: float) -> Candidate:
        """The path near weights that keeps the limits at a duration in s, or violates them little."""
        objective = LeastDisturbance(space, duration, FEASIBLE_UNIT)
        problem = self._problem(space, objective, self._limits, ASKED * duration)
        return self.polished(
            space, minimise(problem, weights, SHORTENING.iterations, SHORTENING.gain).weights
        )

    def _problem(
        self, space: PathSpace, objective: PathObjective, limits: PathLimits, duration: float
    ) -> PathProblem:
        return PathProblem(space, objective, limits.rows(space, duration))

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
