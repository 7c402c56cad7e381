"""Reactionless motion with free paths (method d): only the ends are given, the energy is least in between.

Beyond shah2013, whose end-effector paths are fixed polynomials. Splines of the joint angles are collocated
for the reactionless constraint of eq. 4 and the least integral of eq. 15, from several starts, the motions of
methods (a) to (c) among them, first without regard to obstacles; where the best motion meets one, it is
solved again with a cost on nearness. A roll-out then makes the motion exact. Where one of (a) to (c) fulfils
everything that is asked and takes less energy still, that one is the plan.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.clearance import Gaps, Surroundings, gaps
from agents.planners.dual_arm.free_paths.check import check
from agents.planners.dual_arm.free_paths.goals import end_configurations, spread
from agents.planners.dual_arm.free_paths.model import HeldAttitude
from agents.planners.dual_arm.free_paths.nearness import parameters
from agents.planners.dual_arm.free_paths.solver import (
    ANGLE_ROOM,
    METHOD,
    FreePathSolver,
    FreePathUnsolved,
    SplineSolution,
)
from agents.planners.dual_arm.prescribed_paths.instantaneous import plan_local, plan_zeta_zero
from agents.planners.dual_arm.prescribed_paths.ocp import plan_ocp
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import positive_integer

STARTS = 4
ENDS, MORE_ENDS = 48, 200  # searches for configurations at the end; the latter where none was clear
ROOM = 0.995  # share of the limits on rates and accelerations that the splines may use
ATTEMPTS = 4  # with less room each
EXTRA = 0.015  # m, of gap beyond the margin below which nearness costs
WEIGHTS = (3e4, 1e5, 3e5, 1e6)  # of the squares of what is missing to that gap, in turn
LEEWAY = 0.01  # m, between the gap that the start or the end allows and what is required then
HOPELESS = 0.03  # m, of what is missing to the required gap, that more weight on nearness does not put right
LEAST_SPAN = 0.01  # of the duration, that nearness at a node counts for at least
NEAR_BEST = 1.05  # a clear motion that costs less than this times the least possible is not improved
DEAR = 3.0  # and one that costs more than this times it is looked for from all clear ends
EQUAL = 1e-4  # relative difference of energies below which two solutions count as one
TOLERANCES = {
    "base_rate": 1e-9,  # rad/s
    "start": 1e-9,  # rad and rad/s
    "end_position": 1e-6,  # m
    "end_velocity": 1e-6,  # m/s
    "end_axis": 1e-6,  # rad
    **dict.fromkeys(("position", "rate", "acceleration", "torque"), 1e-9),
}


def plan_free(
    robot: FloatingRobot,
    capture: Capture,
    limits: Limits = Limits(),
    around: Surroundings | None = None,
    starts: int = STARTS,
) -> CapturePlan | Failure:
    """Motion of least energy from rest to a capture, reactionless all along, within limits and clear.

    Args:
        limits: `control` does not apply. Torques are kept by lower accelerations where they would pass.
        around: what the arms keep away from; None is nothing.
        starts: number of different end configurations that are started from, besides the motions of methods
            (a) to (c).

    Raises:
        ConfigurationError: for a malformed capture, limits of another robot, or no number of starts.
    """
    positive_integer("starts", starts, MORE_ENDS)
    return _FreePathSearch(robot, capture.checked(robot), limits.checked(robot), around, starts).plan()


def along_paths(robot: FloatingRobot, capture: Capture, limits: Limits) -> list[CapturePlan]:
    """The motions of methods (a), (b) and, in the plane, (c) to a checked capture; of the limits they keep
    those on joint angles."""
    room = Limits(position=limits.position)
    plans = [plan_zeta_zero(robot, capture, room), plan_local(robot, capture, room)]
    if HeldAttitude.of(robot).dimensions == 2:
        plans.append(plan_ocp(robot, capture, room))
    return [plan for plan in plans if isinstance(plan, CapturePlan)]


def _energy(plan: CapturePlan | Failure) -> float:
    return plan.energy if isinstance(plan, CapturePlan) else np.inf


class _FreePathSearch:
    """For the best motion of one capture."""

    def __init__(
        self,
        robot: FloatingRobot,
        capture: Capture,
        limits: Limits,
        around: Surroundings | None,
        starts: int,
    ) -> None:
        self._robot, self._capture, self._limits, self._around = robot, capture, limits, around
        self._starts = starts
        self._solver = FreePathSolver(robot, capture, limits)
        self._rate, self._acceleration = (
            None if limit is None else ROOM * limit for limit in (limits.rate, limits.acceleration)
        )
        self._poses: tuple[Array, Array] | None = None  # of the target at the solver's times
        if around is not None and around.motion is not None:
            self._poses = around.motion(self._solver.times)
        self._required = 0.0  # m, least gap
        self._given: list[CapturePlan] = []  # motions along polynomial paths

    def plan(self) -> CapturePlan | Failure:
        failure = self._unfit_start()
        if failure is not None:
            return failure
        self._given = along_paths(self._robot, self._capture, self._limits)
        found = self._searched()
        known = [plan for plan in map(self._as_found, self._given) if plan is not None]
        return min([found, *known] if isinstance(found, CapturePlan) else known, key=_energy, default=found)

    def _as_found(self, given: CapturePlan) -> CapturePlan | None:
        """A motion along polynomial paths as a result of this method, if it fulfils all that is asked."""
        measured = check(self._robot, self._capture, self._limits, given)
        if any(value > TOLERANCES[name] for name, value in measured.violation.items()):
            return None
        if self._around is not None:
            q, _, _ = given.sample(self._solver.times[self._solver.dense])
            if self._gaps(self._around, q, self._solver.dense).least < self._required:
                return None
        note = f"the motion of {given.method}, which no search improved"
        return replace(given, method=METHOD, violation=measured.violation, notes=note)

    def _searched(self) -> CapturePlan | Failure:
        """The best motion of the searches, or why there is none."""
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
            self._take_room(found, excess)
        name = max(excess, key=lambda key: excess[key] / TOLERANCES[key])
        cause = Cause.INFEASIBLE if name == "torque" else Cause.INACCURATE
        return Failure(METHOD, cause, f"the motion passes what is allowed in {name} by {excess[name]:.2e}")

    def _take_room(self, plan: CapturePlan, excess: dict[str, float]) -> None:
        """Tighten the splines' limits, which the roll-out passes by little; torques follow accelerations."""
        limits = self._limits
        if "rate" in excess and self._rate is not None and limits.rate is not None:
            self._rate -= 2.0 * excess["rate"]
        if "acceleration" in excess and self._acceleration is not None:
            self._acceleration -= 2.0 * excess["acceleration"]
        if "torque" in excess and limits.torque is not None:
            share = 0.95 * limits.torque / (limits.torque + excess["torque"])
            self._acceleration = share * float(np.abs(plan.acceleration).max())

    def _unfit_start(self) -> Failure | None:
        start, limits = self._capture.start, self._limits
        if limits.position is not None:
            beyond = np.maximum(limits.position[:, 0] - start, start - limits.position[:, 1])
            if beyond.max() > 0.0:
                joint = int(beyond.argmax()) + 1
                reason = f"joint {joint} starts {beyond.max():.3f} rad beyond its limit"
                return Failure(METHOD, Cause.JOINT_LIMIT, reason)
        if self._around is not None:
            at = self._solver.dense[:1]
            first = self._gaps(self._around, start[None], at)
            if first.least < 0.0:
                return self._collision("the start is in a collision", first, at)
            self._require(self._around.margin, first.least)
        return None

    def _best(self, ends: Array) -> CapturePlan | Failure:
        """The motion of least energy that is clear; limits may be passed by little."""
        begins = [self._solver.straight(end) for end in spread(ends, self._starts)]
        begins += [self._solver.fitted(plan) for plan in self._given]
        solved = [self._solve(begin) for begin in begins]
        found: list[SplineSolution] = []
        for solution in sorted((s for s in solved if isinstance(s, SplineSolution)), key=lambda s: s.cost):
            if not found or solution.cost > (1.0 + EQUAL) * found[-1].cost:
                found.append(solution)
        if not found:
            return self._unsolved(ends, [s for s in solved if isinstance(s, FreePathUnsolved)])
        note = f"{len(found)} local optima from {len(solved)} starts"
        if self._around is None:
            return replace(self._solver.motion(found[0]), notes=note)
        return self._clear(self._around, ends, found, note)

    def _clear(
        self, around: Surroundings, ends: Array, found: list[SplineSolution], note: str
    ) -> CapturePlan | Failure:
        """The cheapest of the optima if it is clear; else the best that comes of leading those around that
        are not, or of starting from clear ends."""
        best: tuple[float, CapturePlan] | None = None
        tried: list[Gaps] = []
        begins: list[tuple[float, Array]] = []
        for solution in found:
            plan, gap = self._measured(around, solution)
            if gap.least >= self._required:
                best = solution.cost, replace(plan, notes=note)
                break
            tried.append(gap)
            begins.append((solution.cost, solution.coefficients))
        if best is None:
            clear = self._clear_ends(around, ends)
            if isinstance(clear, Failure):
                return clear
            dear = DEAR * found[0].cost
            begins += [(dear, self._solver.straight(end)) for end in spread(clear, self._starts)]
        seen: list[float] = []
        for least, begin in begins:
            if best is not None and best[0] <= max(least, NEAR_BEST * found[0].cost):
                break
            for weight in WEIGHTS:
                solution = self._solve(begin, self._nearness(around, weight))
                if isinstance(solution, FreePathUnsolved) or (best is not None and solution.cost >= best[0]):
                    break
                if any(abs(solution.cost - other) < EQUAL * other for other in seen):
                    break
                seen.append(solution.cost)
                begin = solution.coefficients
                plan, gap = self._measured(around, solution)
                if gap.least >= self._required:
                    best = solution.cost, replace(plan, notes=f"{note}, led around obstacles")
                    break
                tried.append(gap)
                if gap.least < self._required - HOPELESS:
                    break
        if best is not None:
            return best[1]
        nearest = max(tried, key=lambda gap: gap.least)
        return self._collision("no motion was found that is clear; in the best", nearest, self._solver.dense)

    def _clear_ends(self, around: Surroundings, ends: Array) -> Array | Failure:
        """End configurations (E, n) that are clear; where grappling leaves less than the margin, less is
        required from now on."""
        at = np.full(len(ends), self._solver.end)
        last = self._gaps(around, ends, at)
        if not (last.each >= self._required).any():
            more = self._ends(MORE_ENDS)
            if not isinstance(more, Failure):
                ends, at = more, np.full(len(more), self._solver.end)
                last = self._gaps(around, ends, at)
        best = last.row(int(last.each.argmax()))
        if best.least < 0.0:
            when = f"none of {len(ends)} configurations at the end is clear; in the best"
            return self._collision(when, best, at)
        self._require(self._required, best.least)
        return ends[last.each >= self._required]

    def _require(self, gap: float, possible: float) -> None:
        """Require a gap, or less where no more than `possible` can be had."""
        self._required = min(gap, max(possible - LEEWAY, 0.0))

    def _ends(self, searches: int) -> Array | Failure:
        model = self._solver.programs.model
        return end_configurations(
            self._robot, model, self._capture, self._limits, METHOD, searches, ANGLE_ROOM
        )

    def _measured(self, around: Surroundings, solution: SplineSolution) -> tuple[CapturePlan, Gaps]:
        plan = self._solver.motion(solution)
        return plan, self._gaps(around, plan.position, self._solver.dense)

    def _solve(self, begin: Array, nearness: Array | None = None) -> SplineSolution | FreePathUnsolved:
        return self._solver.solve(begin, self._rate, self._acceleration, nearness)

    def _nearness(self, around: Surroundings, weight: float) -> Array:
        """Parameters of nearness (K, 24) at the nodes of the program."""
        mesh, at = self._solver.programs.mesh, self._solver.nodes
        # Nodes stand close at the ends, where little time would make what is missing cheap.
        weights = weight * np.maximum(LEAST_SPAN / mesh.weights, 1.0)
        start, duration = self._capture.start, self._capture.duration
        times = self._solver.times[at]
        return parameters(self._robot, around, start, times, duration, self._pose(at), EXTRA, weights)

    def _gaps(self, around: Surroundings, q: Array, at: NDArray[np.int64]) -> Gaps:
        """Gaps of configurations (K, n) at some of the solver's times."""
        times, start, duration = self._solver.times[at], self._capture.start, self._capture.duration
        return gaps(self._robot, around, times, q, duration, start, self._pose(at))

    def _pose(self, at: NDArray[np.int64]) -> tuple[Array, Array] | None:
        return None if self._poses is None else (self._poses[0][at], self._poses[1][at])

    def _collision(self, when: str, gap: Gaps, at: NDArray[np.int64]) -> Failure:
        what, place = gap.worst()
        time, margin = self._solver.times[at[place]], self._required
        reason = f"{when} {what} come to {gap.least:.3f} m at t = {time:.2f} s, {margin:.3f} m are kept"
        return Failure(METHOD, Cause.CLEARANCE, reason)

    def _unsolved(self, ends: Array, statuses: list[FreePathUnsolved]) -> Failure:
        """Why there is no motion at all: limits that are too low, or the solver."""
        unlimited = self._solver.solve(self._solver.straight(ends[0]), None, None)
        if isinstance(unlimited, SplineSolution):
            fastest = float(np.abs(self._solver.motion(unlimited).rate).max())
            limits = self._limits
            reason = (
                f"no motion was found within {limits.rate} rad/s, {limits.acceleration} rad/s^2 and "
                f"{limits.torque} N m; without limits the joints would turn at up to {fastest:.3g} rad/s in "
                f"{self._capture.duration:.2f} s"
            )
            return Failure(METHOD, Cause.INFEASIBLE, reason)
        least = min(statuses, key=lambda status: status.left)
        reason = f"Ipopt ended with {least.status} from {len(statuses)} starts and left {least.left:.2e}"
        return Failure(METHOD, Cause.SOLVER, reason)
