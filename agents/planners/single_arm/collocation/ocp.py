"""Optimal control of the single arm (`ocp`): the reference for the costs of other planners.

A motion of least cost by eq. 20 of shyam2020 to an inertial pose of the end-effector, by direct collocation
with Ipopt from several initial guesses: in any final configuration, within all limits, with the base attitude
at the end unconstrained or equal to the initial one, and clear of spheres if there are any.

Without a bound on accelerations there is no optimum: joints would start at their full rates. The limit of the
cost then depends on the splines, so that their mesh is part of the figure: `INTERVALS` of equal length.
"""

from collections.abc import Sequence
from dataclasses import replace

import mujoco
import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits, in_words
from agents.planners.common.solutions import distinct, unsolved
from agents.planners.single_arm.check import check
from agents.planners.single_arm.collocation.feasibility import infeasible_start
from agents.planners.single_arm.collocation.solver import METHOD, ReachSolution, ReachSolver
from agents.planners.single_arm.collocation.starts import end_configurations, initial_paths
from agents.planners.single_arm.interception import at_best_time
from agents.planners.single_arm.library import Library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from space_envs.checks import count
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import positive_integer

STARTS, MAX_STARTS = 8, 1000
FURTHER = 3  # initial guesses with straight and random paths, where the first alone leads to no motion
DETOURS = 6  # further initial guesses with random paths, where spheres leave no solution
ATTEMPTS = 4  # with tighter limits each, where a motion violates them between the nodes
COST_RESOLUTION = 1e-3  # relative difference of costs below which two solutions count as one
# rad, rad/s, m and so on, as measured by check.py.
TOLERANCES = {
    "start": 1e-9,
    "end_rate": 1e-9,
    "position_error": 1e-5,
    "rotation_error": 1e-5,
    "linear_velocity_error": 1e-4,
    "angular_velocity_error": 1e-4,
    "end_attitude": 1e-5,
    **dict.fromkeys(("position", "rate", "acceleration", "torque", "coriolis", "clearance"), 1e-6),
}


def plan_ocp(
    model: mujoco.MjModel,
    robot: FloatingRobot,
    reach: Reach,
    limits: Limits = Limits(),
    *,
    library: Library | None = None,
    starts: int = STARTS,
    seed: int = 0,
) -> ReachPlan | Failure:
    """Plan the best motion from several initial guesses, as measured on a dense grid.

    Args:
        model: compiled model of the robot, with which torques are measured.
        limits: `control` does not apply.
        library: of stored motions that the weight-space planner starts from; None for none.
        starts: number of initial guesses; the first is the motion of the weight-space planner. Where 1 leads
            to no motion, `FURTHER` others follow.
        seed: of the random part of the initial guesses.

    Raises:
        ConfigurationError: for a malformed reach, limits of another robot or an invalid number of starts.
    """
    positive_integer("starts", starts, MAX_STARTS)
    count("seed", seed, 2**63)
    limits.checked(robot)

    def plan(at: Reach) -> ReachPlan | Failure:
        return _ReachSearch(model, robot, at, limits, library, seed).plan(starts)

    return at_best_time(plan, robot, limits, reach.checked(robot))


class _ReachSearch:
    """Search for the best motion of one problem."""

    def __init__(
        self,
        model: mujoco.MjModel,
        robot: FloatingRobot,
        reach: Reach,
        limits: Limits,
        library: Library | None,
        seed: int,
    ) -> None:
        self._model, self._robot, self._reach, self._limits = model, robot, reach, limits
        self._library, self._seed = library, seed
        self._solver = ReachSolver(robot, reach, limits)

    def plan(self, starts: int) -> ReachPlan | Failure:
        failure = infeasible_start(METHOD, self._robot, self._reach, self._limits)
        if failure is not None:
            return failure
        near = self._near_optimum()
        if near and starts == 1:
            plan = self._planned(near)
            if isinstance(plan, ReachPlan):
                return plan
        ends = end_configurations(
            self._solver.model, self._robot, self._reach, self._limits, METHOD, self._seed
        )
        if isinstance(ends, Failure):
            return ends
        number = FURTHER if starts == 1 else starts - len(near)
        return self._planned(near, self._paths(ends, number, self._seed), ends)

    def _planned(
        self, near: list[Array], paths: Sequence[Array] = (), ends: Array | None = None
    ) -> ReachPlan | Failure:
        """The best motion from variables near an optimum and from paths, to final configurations (E, n)."""
        guesses = near + [self._solver.variables(path) for path in paths]
        solved = [self._solver.solve(guess) for guess in guesses]
        if not _solutions(solved) and self._reach.spheres is not None and ends is not None:
            # A path through the centre of a sphere has no side to be moved to: random ones have.
            detours = self._paths(ends, 2 * DETOURS, self._seed + 1)[1::2]
            guesses += (more := [self._solver.variables(path) for path in detours])
            solved += [self._solver.solve(guess) for guess in more]
        if not _solutions(solved):
            failures = [one for one in solved if isinstance(one, Failure)]
            return self._unsolved(paths[0], failures) if paths else unsolved(METHOD, failures)
        plan = self._best(_solutions(solved), len(guesses))
        if isinstance(plan, Failure) and self._solver.torque_limited:
            # Limits on torques are added where they were violated; with them the guesses may lead elsewhere.
            again = _solutions([self._solver.solve(guess) for guess in guesses])
            return self._best(again, len(guesses)) if again else plan
        return plan

    def _paths(self, ends: Array, number: int, seed: int) -> list[Array]:
        return initial_paths(self._robot, self._reach, ends, number, seed, self._solver.abscissae)

    def _best(self, converged: list[ReachSolution], starts: int) -> ReachPlan | Failure:
        """Plan of the solution of least cost that is accurate, else the failure of the first."""
        found = distinct(converged, COST_RESOLUTION)
        failures = []
        for solution in found:
            plan = self._accurate(solution)
            if isinstance(plan, ReachPlan):
                note = f"{len(converged)} of {starts} starts converged, to {len(found)} local optima"
                return replace(plan, notes=note)
            failures.append(plan)
        return failures[0]

    def _near_optimum(self) -> list[Array]:
        """Variables of the weight-space planner's motion, often in the best basin, if it has one."""
        plan = OptimalPlanner(self._robot, self._limits, self._library).plan(self._reach)
        return [self._solver.fitted(plan)] if isinstance(plan, ReachPlan) else []

    def _accurate(self, solution: ReachSolution) -> ReachPlan | Failure:
        """The motion as measured; solved again with tighter limits where it violates them between nodes."""
        excess: dict[str, float] = {}
        for _ in range(ATTEMPTS):
            plan = self._solver.motion(solution)
            plan = check(self._model, self._robot, self._reach, self._limits, plan)
            excess = self._excess(plan)
            if not excess:
                return plan
            tighter = self._solver.tightened(solution, excess)
            if isinstance(tighter, Failure):
                name = _worst(excess)
                cause = Cause.CLEARANCE if name == "clearance" else Cause.INFEASIBLE
                reason = f"no motion was found that keeps {name}; the nearest passes it by {excess[name]:.2e}"
                return Failure(METHOD, cause, reason)
            solution = tighter
        name = _worst(excess)
        reason = f"the motion passes what is allowed in {name} by {excess[name]:.2e} between its nodes"
        return Failure(METHOD, Cause.INACCURATE, reason)

    def _excess(self, plan: ReachPlan) -> dict[str, float]:
        """Measured violations beyond their tolerances."""
        return {
            name: value
            for name, value in plan.violation.items()
            if value > TOLERANCES.get(name, np.inf) and (name != "end_attitude" or self._reach.keep_attitude)
        }

    def _unsolved(self, path: Array, failures: list[Failure]) -> Failure:
        """Failure with its cause: spheres, limits that are too low, or the solver."""
        reach, limits = self._reach, self._limits
        bare = replace(reach, spheres=None)
        if reach.spheres is not None:
            free = ReachSolver(self._robot, bare, limits)
            if isinstance(free.solve(free.variables(path)), ReachSolution):
                reason = f"no motion was found that is clear of the {len(reach.spheres)} spheres"
                return Failure(METHOD, Cause.CLEARANCE, f"{reason}, from {len(failures)} starts")
        free = ReachSolver(self._robot, bare, Limits())
        unlimited = free.solve(free.variables(path))
        if isinstance(unlimited, ReachSolution):
            motion = free.motion(unlimited)
            reason = (
                f"no motion was found within {in_words(limits.rate, 'rad/s')}, "
                f"{in_words(limits.acceleration, 'rad/s^2')}, {in_words(limits.torque, 'N m')} and the joint "
                f"limits; without them one of {reach.duration:.2f} s turns the joints at up to "
                f"{np.abs(motion.rate).max():.3g} rad/s"
            )
            return Failure(METHOD, Cause.INFEASIBLE, reason)
        return unsolved(METHOD, failures)


def _solutions(solved: list[ReachSolution | Failure]) -> list[ReachSolution]:
    return [each for each in solved if isinstance(each, ReachSolution)]


def _worst(excess: dict[str, float]) -> str:
    return max(excess, key=lambda name: excess[name] / TOLERANCES[name])
