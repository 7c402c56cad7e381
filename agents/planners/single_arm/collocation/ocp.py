"""Optimal control of the single arm (`ocp`): the reference that other planners' costs are divided by.

A motion of least eq. 20 of shyam2020 to an inertial pose of the end-effector, by direct collocation with
Ipopt from several starts: whichever posture it ends in, within all limits, with the base's attitude at the
end free or as it was at the start, clear of balls if there are any.

Without a bound on accelerations there is no optimum: joints would start at their full rates. What the cost
then tends to depends on the splines, so that their mesh is part of the figure: `INTERVALS` equal ones.
"""

from dataclasses import replace

import mujoco
import numpy as np
from scipy.optimize import minimize_scalar

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.check import check
from agents.planners.single_arm.collocation.solver import METHOD, ReachSolution, ReachSolver, ReachUnsolved
from agents.planners.single_arm.collocation.starts import end_configurations, starting_paths
from agents.planners.single_arm.library import shipped_library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.weights.promp_optimal import Planner
from space_envs.checks import count, finite_array, non_negative
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, to_matrix
from space_envs.dynamics.spheres import link_ends, sphere_gaps
from space_envs.errors import ConfigurationError, positive_integer
from space_envs.robots.parameters import SINGLE_ARM

STARTS, MOST_STARTS = 8, 1000
AROUND = 6  # more starts by random ways where balls leave none
ATTEMPTS = 4  # with tighter limits each, where a motion passes them between the nodes
EQUAL = 1e-3  # relative difference of costs below which two solutions count as one
TIMES = 16  # durations that are tried where the duration is free
# rad, rad/s, m and so on, as agents/planners/single_arm/check.py measures them.
TOLERANCES = {
    "start": 1e-9,
    "end_rate": 1e-9,
    "position_error": 1e-5,
    "rotation_error": 1e-5,
    "end_attitude": 1e-5,
    **dict.fromkeys(("position", "rate", "acceleration", "torque", "coriolis", "clearance"), 1e-6),
}


def plan_ocp(
    model: mujoco.MjModel,
    robot: FloatingRobot,
    reach: Reach,
    limits: Limits = Limits(),
    *,
    starts: int = STARTS,
    free_time: tuple[float, float] | None = None,
    time_weight: float = 0.0,
    seed: int = 0,
) -> ReachPlan | Failure:
    """The best motion found from several starts, as measured densely, or why there is none.

    Args:
        model: compiled model of the robot, with which torques are measured.
        limits: `control` does not apply.
        starts: number of motions that are started from; the first is that of the weight-space planner.
        free_time: lowest and highest duration, s, between which it is chosen in place of reach.duration, so
            that the cost plus `time_weight` times the duration is least. From rest a slower motion along the
            same path costs less and keeps every limit: without a weight the highest duration is the answer.
        time_weight: m^2/s^2.
        seed: of the random part of the starts.

    Raises:
        ConfigurationError: for a malformed reach, limits of another robot, no number of starts or no range
            of durations.
    """
    reach, limits = reach.checked(robot), limits.checked(robot)
    positive_integer("starts", starts, MOST_STARTS)
    count("seed", seed, 2**63)
    time_weight = non_negative("time_weight", time_weight)
    if free_time is None:
        return _ReachSearch(model, robot, reach, limits, starts, seed).plan()
    low, high = finite_array("free_time", free_time, (2,)).tolist()
    if not 0.0 < low <= high:
        raise ConfigurationError(f"durations must be 0 < low <= high, got {free_time}")
    return _timed(
        _ReachSearch(model, robot, replace(reach, duration=high), limits, starts, seed), low, time_weight
    )


def _timed(search: "_ReachSearch", low: float, weight: float) -> ReachPlan | Failure:
    """The motion with the best duration between `low` and that of the search."""
    reach, high = search.reach, search.reach.duration
    longest = search.plan()
    rests = reach.rate is None or not reach.rate.any()
    if isinstance(longest, Failure) or low == high or (weight == 0.0 and rests):
        return longest
    best = longest

    def worth(duration: float) -> float:
        nonlocal best
        found = search.at(duration)
        if isinstance(found, Failure):
            return 10.0 * (longest.cost + weight * high) * (1.0 + high - duration)
        value = found.cost + weight * duration
        if value < best.cost + weight * best.time[-1]:
            best = found
        return value

    minimize_scalar(worth, bounds=(low, high), method="bounded", options={"maxiter": TIMES})
    return best


class _ReachSearch:
    """For the best motion of one reach."""

    def __init__(
        self,
        model: mujoco.MjModel,
        robot: FloatingRobot,
        reach: Reach,
        limits: Limits,
        starts: int,
        seed: int,
    ) -> None:
        self.reach = reach
        self._model, self._robot, self._limits = model, robot, limits
        self._starts, self._seed = starts, seed
        self._solver = ReachSolver(robot, reach, limits)
        self._begin = np.zeros(0)  # variables of the best solution so far

    def plan(self) -> ReachPlan | Failure:
        failure = self._unfit_start()
        if failure is not None:
            return failure
        ends = end_configurations(
            self._solver.model, self._robot, self.reach, self._limits, METHOD, self._seed
        )
        if isinstance(ends, Failure):
            return ends
        at = self._solver.abscissae
        near = self._near_optimum()
        wanted = self._starts - len(near)
        paths = starting_paths(self._robot, self.reach, ends, max(wanted, 1), self._seed, at)
        begins = near + [self._solver.variables(path) for path in paths[:wanted]]
        solved = [self._solver.solve(begin) for begin in begins]
        blocked = not any(isinstance(s, ReachSolution) for s in solved)
        if blocked and self.reach.spheres is not None:
            # A way straight through a ball has no side to give way to: random ones have.
            more = starting_paths(self._robot, self.reach, ends, 2 * AROUND, self._seed + 1, at)[1::2]
            others = [self._solver.variables(path) for path in more]
            begins += others
            solved += [self._solver.solve(begin) for begin in others]
        converged = [s for s in solved if isinstance(s, ReachSolution)]
        if not converged:
            return self._unsolved(paths[0], [s for s in solved if isinstance(s, ReachUnsolved)])
        motion = self._best(converged, len(begins))
        if isinstance(motion, Failure) and self._solver.loaded:
            # Limits on torques are added where they were passed; the starts may lead elsewhere with them.
            solved = [self._solver.solve(begin) for begin in begins]
            converged = [s for s in solved if isinstance(s, ReachSolution)]
            return self._best(converged, len(begins)) if converged else motion
        return motion

    def _best(self, converged: list[ReachSolution], starts: int) -> ReachPlan | Failure:
        """The cheapest of the solutions that is accurate, or why the cheapest is not."""
        found: list[ReachSolution] = []
        for solution in sorted(converged, key=lambda s: s.cost):
            if not found or solution.cost > (1.0 + EQUAL) * found[-1].cost:
                found.append(solution)
        failures = []
        for solution in found:
            motion = self._accurate(self._solver, solution)
            if isinstance(motion, ReachPlan):
                count = f"{len(converged)} of {starts} starts converged, to {len(found)} local optima"
                return replace(motion, notes=count)
            failures.append(motion)
        return failures[0]

    def _near_optimum(self) -> list[Array]:
        """Variables of the weight-space planner's motion, which knows the best basins, if it has one."""
        reach, limited = self.reach, self._limits.rate is not None
        library = shipped_library(reach.keep_attitude, limited)
        plan = Planner(self._robot, self._limits, library).plan(reach)
        return [self._solver.fitted(plan)] if isinstance(plan, ReachPlan) else []

    def at(self, duration: float) -> ReachPlan | Failure:
        """The motion with another duration, from the best one found so far."""
        reach = replace(self.reach, duration=duration)
        solver = ReachSolver(self._robot, reach, self._limits)
        solution = solver.solve(self._begin)
        if isinstance(solution, ReachUnsolved):
            return Failure(METHOD, Cause.INFEASIBLE, f"no motion of {duration:.2f} s: {solution.status}")
        return self._accurate(solver, solution)

    def _accurate(self, solver: ReachSolver, solution: ReachSolution) -> ReachPlan | Failure:
        """The motion as measured, solved again with tighter limits where it passes them between the nodes."""
        excess: dict[str, float] = {}
        for _ in range(ATTEMPTS):
            motion = solver.motion(solution)
            motion = check(self._model, self._robot, solver.reach, self._limits, motion)
            excess = {
                name: value
                for name, value in motion.violation.items()
                if value > TOLERANCES.get(name, np.inf)
                and (name != "end_attitude" or self.reach.keep_attitude)
            }
            if not excess:
                self._begin = solution.variables
                return motion
            tighter = solver.tightened(solution, excess)
            if isinstance(tighter, ReachUnsolved):
                name = max(excess, key=lambda key: excess[key] / TOLERANCES[key])
                cause = Cause.CLEARANCE if name == "clearance" else Cause.INFEASIBLE
                reason = f"no motion was found that keeps {name}; the nearest passes it by {excess[name]:.2e}"
                return Failure(METHOD, cause, reason)
            solution = tighter
        name = max(excess, key=lambda key: excess[key] / TOLERANCES[key])
        reason = f"the motion passes what is allowed in {name} by {excess[name]:.2e} between its nodes"
        return Failure(METHOD, Cause.INACCURATE, reason)

    def _unfit_start(self) -> Failure | None:
        reach, limits = self.reach, self._limits
        rate = np.zeros_like(reach.start) if reach.rate is None else reach.rate
        if limits.position is not None:
            beyond = np.maximum(limits.position[:, 0] - reach.start, reach.start - limits.position[:, 1])
            if beyond.max() > 0.0:
                joint = int(beyond.argmax()) + 1
                reason = f"joint {joint} starts {beyond.max():.3f} rad beyond its limit"
                return Failure(METHOD, Cause.JOINT_LIMIT, reason)
        if limits.rate is not None and np.abs(rate).max() > limits.rate:
            joint = int(np.abs(rate).argmax())
            reason = f"joint {joint + 1} starts at {rate[joint]:.3f} rad/s, {limits.rate} are allowed"
            return Failure(METHOD, Cause.INFEASIBLE, reason)
        if reach.spheres is not None and len(reach.spheres):
            still = np.array([1.0, 0.0, 0.0, 0.0])
            ends = link_ends(self._robot, reach.start, np.zeros(3), still)
            # The last link's place at the end is given with the goal.
            _, axes = self._robot.end_effector_pose(reach.start)
            last = reach.position + to_matrix(reach.quaternion) @ axes.T @ (ends[-2] - ends[-1])
            for when, points in (("the start", ends), ("the goal", np.stack([last, reach.position]))):
                gap = float(sphere_gaps(points, reach.spheres, SINGLE_ARM.link_radius).min())
                if gap < 0.0:
                    reason = f"{when} is in a collision: a link is {-gap:.3f} m deep in a ball"
                    return Failure(METHOD, Cause.CLEARANCE, reason)
        return None

    def _unsolved(self, path: Array, statuses: list[ReachUnsolved]) -> Failure:
        """Why there is no motion at all: balls, limits that are too low, or the solver."""
        reach, limits = self.reach, self._limits
        bare = replace(reach, spheres=None)
        if reach.spheres is not None:
            free = ReachSolver(self._robot, bare, limits)
            if isinstance(free.solve(free.variables(path)), ReachSolution):
                reason = f"no motion was found that is clear of the {len(reach.spheres)} spheres"
                return Failure(METHOD, Cause.CLEARANCE, f"{reason}, from {len(statuses)} starts")
        free = ReachSolver(self._robot, bare, Limits())
        unlimited = free.solve(free.variables(path))
        if isinstance(unlimited, ReachSolution):
            motion = free.motion(unlimited)
            reason = (
                f"no motion was found within {limits.rate} rad/s, {limits.acceleration} rad/s^2, "
                f"{limits.torque} N m and the joint limits; without them one of {reach.duration:.2f} s turns "
                f"the joints at up to {np.abs(motion.rate).max():.3g} rad/s"
            )
            return Failure(METHOD, Cause.INFEASIBLE, reason)
        least = min(statuses, key=lambda status: status.left)
        reason = f"Ipopt ended with {least.status} from {len(statuses)} starts and left {least.left:.2e}"
        return Failure(METHOD, Cause.SOLVER, reason)
