"""Search for the reactionless motion of least energy to one capture, among the optima of several programs."""

from dataclasses import dataclass, replace

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits, in_words, start_beyond_limits
from agents.planners.common.solutions import Solution, distinct, unsolved
from agents.planners.dual_arm.check import check
from agents.planners.dual_arm.clearance import Gaps
from agents.planners.dual_arm.free_paths.obstacles import Obstacles
from agents.planners.dual_arm.free_paths.solver import METHOD, FreePathSolver
from agents.planners.dual_arm.goals import end_configurations, spread
from agents.planners.dual_arm.held_attitude import HeldAttitude
from agents.planners.dual_arm.prescribed_paths.instantaneous import plan_local, plan_zeta_zero
from agents.planners.dual_arm.prescribed_paths.ocp import plan_ocp
from agents.planners.dual_arm.problem import Capture, CapturePlan
from agents.planners.dual_arm.surroundings import Surroundings
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

ENDS, MORE_ENDS = 48, 200  # searches for final configurations; the latter where none was clear
LIMIT_FRACTION = 0.995  # of the limits on rates and accelerations that the splines use
ATTEMPTS = 4  # with tighter limits each
WEIGHTS = (3e4, 1e5, 3e5, 1e6)  # of squared deficits of clearance, in turn
HOPELESS = 0.03  # m, deficit of clearance beyond which larger weights are not tried
SUFFICIENT_COST_RATIO = (
    1.05  # to the least cost without obstacles, below which a clear motion is not improved
)
RETRY_COST_RATIO = 3.0  # to the same, above which motions to clear final configurations are searched
COST_RESOLUTION = 1e-4  # relative difference of energies below which two solutions count as one
TOLERANCES = {
    "base_rate": 1e-9,  # rad/s
    "start": 1e-9,  # rad and rad/s
    "end_position": 1e-6,  # m
    "end_velocity": 1e-6,  # m/s
    "end_axis": 1e-6,  # rad
    **dict.fromkeys(("position", "rate", "acceleration", "torque"), 1e-9),
}


@dataclass
class _Clear:
    """Best clear motion so far, with its cost."""

    cost: float = np.inf
    plan: CapturePlan | None = None


class FreePathSearch:
    """Search for the best motion of one checked capture.

    Args:
        around: obstacles; None for none. starts: number of final configurations that are started from.
    """

    def __init__(
        self,
        robot: FloatingRobot,
        capture: Capture,
        limits: Limits,
        around: Surroundings | None,
        starts: int,
    ) -> None:
        self._robot, self._capture, self._limits, self._starts = robot, capture, limits, starts
        self._solver = FreePathSolver(robot, capture, limits)
        self._rate, self._acceleration = (
            None if limit is None else LIMIT_FRACTION * limit for limit in (limits.rate, limits.acceleration)
        )
        self._obstacles = None if around is None else Obstacles(robot, capture, around, self._solver)
        self._prescribed: list[CapturePlan] = []  # motions along polynomial paths

    def plan(self) -> CapturePlan | Failure:
        """Plan the best motion of the searches and of those along prescribed paths."""
        failure = self._infeasible_start()
        if failure is not None:
            return failure
        self._prescribed = prescribed_plans(self._robot, self._capture, self._limits)
        found = self._searched()
        known = [plan for plan in map(self._as_found, self._prescribed) if plan is not None]
        plans = [found, *known] if isinstance(found, CapturePlan) else known
        return min(plans, key=lambda plan: plan.energy, default=found)

    def _infeasible_start(self) -> Failure | None:
        start = self._capture.start
        failure = start_beyond_limits(METHOD, start, self._limits)
        if failure is None and self._obstacles is not None:
            at = self._solver.dense[:1]
            first = self._obstacles.gaps(start[None], at)
            if first.least < 0.0:
                return self._obstacles.collision("the start is in a collision", first, at)
            self._obstacles.require_margin(first.least)
        return failure

    def _as_found(self, plan: CapturePlan) -> CapturePlan | None:
        """A motion along polynomial paths as a plan of this method, if it satisfies all requirements."""
        measured = check(self._robot, self._capture, self._limits, plan)
        if any(value > TOLERANCES[name] for name, value in measured.violation.items()):
            return None
        if self._obstacles is not None:
            q, _, _ = plan.sample(self._solver.times[self._solver.dense])
            if self._obstacles.gaps(q, self._solver.dense).least < self._obstacles.required:
                return None
        note = f"the motion of {plan.method}, which no search improved"
        return replace(plan, method=METHOD, violation=measured.violation, notes=note)

    def _searched(self) -> CapturePlan | Failure:
        """The best motion of the searches."""
        ends = self._ends(ENDS)
        if isinstance(ends, Failure):
            return ends
        excess: dict[str, float] = {}
        for _ in range(ATTEMPTS):
            found = self._best(ends)
            if isinstance(found, Failure):
                return found
            excess = {name: v for name, v in found.violation.items() if v > TOLERANCES[name]}
            if not excess:
                return found
            if not excess.keys() <= {"rate", "acceleration", "torque"}:
                break
            self._tighten(found, excess)
        name = max(excess, key=lambda key: excess[key] / TOLERANCES[key])
        cause = Cause.INFEASIBLE if name == "torque" else Cause.INACCURATE
        return Failure(METHOD, cause, f"the motion passes what is allowed in {name} by {excess[name]:.2e}")

    def _tighten(self, plan: CapturePlan, excess: dict[str, float]) -> None:
        """Tighten the splines' limits, which the roll-out exceeds slightly; torques follow accelerations."""
        limits = self._limits
        if "rate" in excess and self._rate is not None and limits.rate is not None:
            self._rate = self._rate - 2.0 * excess["rate"]
        if "acceleration" in excess and self._acceleration is not None:
            self._acceleration = self._acceleration - 2.0 * excess["acceleration"]
        if "torque" in excess and limits.torque is not None:
            torque = float(np.min(limits.torque))
            fraction = 0.95 * torque / (torque + excess["torque"])
            usual = 1.0 if limits.acceleration is None else limits.acceleration
            self._acceleration = fraction * float(np.abs(plan.acceleration).max()) * (usual / np.max(usual))

    def _best(self, ends: Array) -> CapturePlan | Failure:
        """The motion of least energy that is clear; limits may be exceeded slightly."""
        guesses = [self._solver.straight(end) for end in spread(ends, self._starts)]
        guesses += [self._solver.fitted(plan) for plan in self._prescribed]
        solved = [self._solve(guess) for guess in guesses]
        found = distinct(solved, COST_RESOLUTION)
        if not found:
            return self._unsolved(ends, [s for s in solved if isinstance(s, Failure)])
        note = f"{len(found)} local optima from {len(solved)} starts"
        if self._obstacles is None:
            return replace(self._solver.motion(found[0]), notes=note)
        return self._clear(self._obstacles, ends, found, note)

    def _clear(
        self, obstacles: Obstacles, ends: Array, found: list[Solution], note: str
    ) -> CapturePlan | Failure:
        """The best optimum that is clear, or the best motion led around obstacles, from the others before it
        and from clear final configurations."""
        best, tried = _Clear(), list[Gaps]()
        guesses: list[tuple[float, Array]] = []
        for solution in found:
            plan, gap = self._measured(obstacles, solution)
            if gap.least >= obstacles.required:
                best = _Clear(solution.cost, replace(plan, notes=note))
                break
            tried.append(gap)
            guesses.append((solution.cost, solution.variables))
        least = found[0].cost
        if best.plan is None:
            clear = self._clear_ends(obstacles, ends)
            if isinstance(clear, Failure):
                return clear
            straight = [self._solver.straight(end) for end in spread(clear, self._starts)]
            guesses += [(RETRY_COST_RATIO * least, guess) for guess in straight]
        seen: list[float] = []
        for bound, guess in guesses:
            if best.plan is not None and best.cost <= max(bound, SUFFICIENT_COST_RATIO * least):
                break
            self._lead_around(obstacles, guess, best, tried, seen, note)
        if best.plan is not None:
            return best.plan
        nearest = max(tried, key=lambda gap: gap.least)
        when = "no motion was found that is clear; in the best"
        return obstacles.collision(when, nearest, self._solver.dense)

    def _lead_around(
        self,
        obstacles: Obstacles,
        guess: Array,
        best: _Clear,
        tried: list[Gaps],
        seen: list[float],
        note: str,
    ) -> None:
        """Solve from coefficients with increasing weights of nearness, until the motion is clear.

        Args:
            best: replaced by a better motion. tried: clearances of motions that are not clear, extended.
            seen: costs of solutions, extended; a cost that was seen before ends the attempt.
        """
        for weight in WEIGHTS:
            solution = self._solve(guess, obstacles.nearness(weight))
            if isinstance(solution, Failure) or (best.plan is not None and solution.cost >= best.cost):
                return
            if any(abs(solution.cost - other) < COST_RESOLUTION * other for other in seen):
                return
            seen.append(solution.cost)
            guess = solution.variables
            plan, gap = self._measured(obstacles, solution)
            if gap.least >= obstacles.required:
                best.cost, best.plan = solution.cost, replace(plan, notes=f"{note}, led around obstacles")
                return
            tried.append(gap)
            if gap.least < obstacles.required - HOPELESS:
                return

    def _clear_ends(self, obstacles: Obstacles, ends: Array) -> Array | Failure:
        """Final configurations (E, n) that are clear; less clearance is required from now on where grappling
        allows no more."""
        at = np.full(len(ends), self._solver.end)
        last = obstacles.gaps(ends, at)
        if not (last.each >= obstacles.required).any():
            more = self._ends(MORE_ENDS)
            if not isinstance(more, Failure):
                ends, at = more, np.full(len(more), self._solver.end)
                last = obstacles.gaps(ends, at)
        best = last.row(int(last.each.argmax()))
        if best.least < 0.0:
            when = f"none of {len(ends)} configurations at the end is clear; in the best"
            return obstacles.collision(when, best, at)
        obstacles.limit(best.least)
        return ends[last.each >= obstacles.required]

    def _ends(self, searches: int) -> Array | Failure:
        model = HeldAttitude.of(self._robot)
        return end_configurations(self._robot, model, self._capture, self._limits, METHOD, searches)

    def _measured(self, obstacles: Obstacles, solution: Solution) -> tuple[CapturePlan, Gaps]:
        plan = self._solver.motion(solution)
        return plan, obstacles.gaps(plan.position, self._solver.dense)

    def _solve(self, guess: Array, nearness: Array | None = None) -> Solution | Failure:
        return self._solver.solve(guess, self._rate, self._acceleration, nearness)

    def _unsolved(self, ends: Array, failures: list[Failure]) -> Failure:
        """Failure with its cause: limits that are too low, or the solver."""
        unlimited = self._solver.solve(self._solver.straight(ends[0]), None, None)
        if isinstance(unlimited, Solution):
            fastest = float(np.abs(self._solver.motion(unlimited).rate).max())
            limits = self._limits
            reason = (
                f"no motion was found within {in_words(limits.rate, 'rad/s')}, "
                f"{in_words(limits.acceleration, 'rad/s^2')} and {in_words(limits.torque, 'N m')}; without "
                f"limits the joints would turn at up to {fastest:.3g} rad/s in {self._capture.duration:.2f} s"
            )
            return Failure(METHOD, Cause.INFEASIBLE, reason)
        return unsolved(METHOD, failures)


def prescribed_plans(robot: FloatingRobot, capture: Capture, limits: Limits) -> list[CapturePlan]:
    """Plans of methods (a), (b) and (c) for a checked capture.

    (a) and (b) are within joint limits only, and so is (c) where there is none from rest within all limits.
    """
    angles = Limits(position=limits.position)
    optimal = plan_ocp(robot, capture, replace(limits, control=None), from_rest=True)
    if isinstance(optimal, Failure):
        optimal = plan_ocp(robot, capture, angles)
    plans = [plan_zeta_zero(robot, capture, angles), plan_local(robot, capture, angles), optimal]
    return [plan for plan in plans if isinstance(plan, CapturePlan)]
