"""Optimal motions in the weights of a ProMP, within milliseconds, started from stored optimal motions."""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.inequalities.spheres import Spheres
from agents.planners.single_arm.inequalities.torques import Torques
from agents.planners.single_arm.interception import at_best_time
from agents.planners.single_arm.library import Library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.promp.starts import Problem, Starts, best_solution, raced
from agents.planners.single_arm.weights.bounds import Bounds, lower_and_upper
from agents.planners.single_arm.weights.end_rates import matching_rates
from agents.planners.single_arm.weights.ranking import ranked
from agents.planners.single_arm.weights.shapes import Basis, in_basis
from agents.planners.single_arm.weights.sqp import GOAL_TOLERANCE, Ending, Rows, SqpResult, minimise
from agents.planners.single_arm.weights.weight_space import WeightSpace
from promp import GaussianBasis
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, to_matrix
from space_envs.errors import positive_integer

METHOD = "promp_optimal"
CANDIDATES = 24  # stored motions whose predicted costs are compared
LIMITED_CANDIDATES = 12  # the same within limits for a pose with the attitude free, where optima are alike
IMPROVED, WIDE_IMPROVED = 1, 3  # candidates that are improved: usually, and for no more than the goal
MOST_CANDIDATES = 10_000
RACED, WIDE_RACED = 4, 12  # candidates without limits that race: with the final attitude constrained, or not
MOST_IMPROVED = 5  # candidates that are improved where none of them leads to the goal
MOST_STARTED = 12  # candidates from which iterations in stages start where none of them leads to the goal
MAX_IMPROVED = 2  # candidates that are improved where costs are high
RETRY_COST_RATIO = 1.3  # of a cost to the least predicted cost, above which a second candidate is improved
# Initial guesses around the attitude-unconstrained motion, where no stored one leads to the goal.
PERTURBED = 6
FURTHER = 6  # initial guesses around a motion that violates further inequalities, with growing perturbations
MORE_PERTURBED = 24  # others without a library, farther and farther, until one leads to the goal
PERTURBATION = 0.1  # in coordinates (root of the integral of a joint's squared rate, per function)
# Where ten functions a joint are too few.
FINER = GaussianBasis(tuple(np.linspace(-0.15, 1.15, 14).tolist()), 0.17)
REFINED = 4  # motions that are improved in it
NODES = 101  # of a plan
MATCHING_ROUNDS = 8  # of joint rates at the end, to a moving goal
RATE_TOLERANCE = 1e-4  # rad/s, of these rates


class Solved(NamedTuple):
    """A solution and the motions that it is one of."""

    space: WeightSpace
    solution: SqpResult


class OptimalPlanner:
    """Plans for one robot and set of limits.

    Args:
        robot: of one arm. limits: of plans. library: of stored motions to start from; None starts from rest,
            or around the attitude-unconstrained motion. basis: of the weights. candidates: number of stored
            motions whose predicted costs are compared; None for 12 or 24. improved: number of them that are
            improved, by predicted cost, None for 1 or 3; the others follow where none of these leads to the
            goal.
        further: inequalities of a space of motions that are imposed where a plan without them violates
            them; None for none.
        reserve: motions to start from with the attitude constrained where those of the library lead nowhere,
            such as motions without limits.
    """

    def __init__(
        self,
        robot: FloatingRobot,
        limits: Limits = Limits(),
        library: Library | None = None,
        basis: GaussianBasis = GaussianBasis(),
        candidates: int | None = None,
        improved: int | None = None,
        further: Callable[[WeightSpace], tuple[Rows, ...]] | None = None,
        reserve: Library | None = None,
    ) -> None:
        self._robot, self._limits, self._library, self._basis = robot, limits.checked(robot), library, basis
        self._candidates, self._improved = candidates, improved
        for name, value in ("candidates", candidates), ("improved", improved):
            if value is not None:
                positive_integer(name, value, MOST_CANDIDATES)
        self._further, self._reserve = further, reserve

    def plan(self, reach: Reach) -> ReachPlan | Failure:
        """Plan the motion of least cost among all optima found; with a window, as `at_best_time` chooses."""
        reach = reach.checked(self._robot)
        if reach.window is None:
            return self._planned(reach, thorough=True)
        plan = partial(self._planned, thorough=False)
        return at_best_time(plan, self._robot, self._limits, reach)

    def _planned(self, reach: Reach, thorough: bool) -> ReachPlan | Failure:
        """Plan of a checked problem with a given duration.

        Args:
            thorough: whether more is tried where the stored motions of least predicted cost lead nowhere.
        """
        if (failure := self._out_of_reach(reach)) is not None:
            return failure
        problem = space, bounds, rows = self.setting(reach)
        found = self._from_library(self._library, problem, reach, thorough)
        if thorough and reach.keep_attitude and best_solution(found) is None:
            found += self._from_library(self._reserve, problem, reach, thorough)
        best = best_solution(found)
        # Guesses around another motion lead past spheres, but hardly ever to a goal that stored ones miss.
        perturb = not reach.keep_attitude or reach.spheres is not None
        if best is None and (not found or (thorough and perturb)):
            found += self._from_rest(space, bounds, rows, reach.keep_attitude)
            best = best_solution(found)
        if best is None and thorough and reach.keep_attitude:
            best, problem = self._refined(reach, space, found)
            space, bounds, rows = problem
        if best is None:
            return _failure(found, reach.duration)
        if reach.goal.moves:
            matched = self._matched(reach, space, best.y)
            if isinstance(matched, Failure):
                return matched
            space, best = matched
            bounds, rows = self._inequalities(space, reach)
        further = () if self._further is None else self._further(space)
        if any(row.violation(best.y) > 0.0 for row in further):
            best = _improved(space, bounds, (*rows, *further), reach.keep_attitude, best)
        return self.motion(space, best)

    def _refined(
        self, reach: Reach, space: WeightSpace, found: Sequence[SqpResult]
    ) -> tuple[SqpResult | None, Problem]:
        """Best solution in a finer basis, if any, from the motions that came nearest, and its problem."""
        finer = self._space(reach, np.zeros(self._robot.n_joints), FINER)
        problem = finer, *self._inequalities(finer, reach)
        starts = Starts(problem, reach.keep_attitude, in_stages=True)
        for end in sorted(found, key=lambda end: end.goal_error)[:REFINED]:
            starts.add(finer.coordinates(in_basis(FINER, self._basis, space.weights(end.y))))
            if starts.best is not None:
                break
        starts.resume()
        return starts.best, problem

    def _matched(self, reach: Reach, space: WeightSpace, y: Array) -> Solved | Failure:
        """The motion that ends as fast as the goal, from one to the same pose that ends at another rate.

        The rates at the end depend on the last configuration, which hardly depends on them: few rounds do.
        """
        rate = np.zeros(self._robot.n_joints)
        for _ in range(MATCHING_ROUNDS):
            before, rate = rate, matching_rates(self._robot, reach, space, y)
            space = self._space(reach, rate, space.shapes.basis)
            bounds, rows = self._inequalities(space, reach)
            found = minimise(space, bounds, y, reach.keep_attitude, rows)
            if best_solution([found]) is None:
                return _failure([found], reach.duration)
            y = found.y
            if np.abs(rate - before).max() < RATE_TOLERANCE:
                return Solved(space, found)
        reason = f"joint rates at the end change by {np.abs(rate - before).max():.3g} rad/s in the last round"
        return Failure(METHOD, Cause.SOLVER, reason)

    def setting(self, reach: Reach) -> Problem:
        """Return the motions that end at rest, bounds and nonlinear inequalities of a checked problem."""
        space = self._space(reach, np.zeros(self._robot.n_joints), self._basis)
        return space, *self._inequalities(space, reach)

    def _space(self, reach: Reach, end_rate: Array, basis: Basis) -> WeightSpace:
        """Motions that end with given joint rates (n,), rad/s."""
        return WeightSpace(
            self._robot,
            basis,
            reach.start,
            np.zeros_like(reach.start) if reach.rate is None else reach.rate,
            reach.duration,
            reach.end.position,
            to_matrix(reach.end.quaternion),
            reach.c,
            end_rate=end_rate,
            kind=reach.kind,
        )

    def _inequalities(self, space: WeightSpace, reach: Reach) -> tuple[Bounds, tuple[Rows, ...]]:
        """Bounds and nonlinear inequalities of motions."""
        limits = self._limits
        rows: list[Rows] = []
        if limits.torque is not None:
            rows.append(Torques(space, limits.torque))
        if limits.coriolis is not None:
            rows.append(Torques(space, limits.coriolis, accelerating=False))
        if reach.spheres is not None and len(reach.spheres):
            rows.append(Spheres(space, self._robot, reach.spheres, reach.link_radius))
        bounds = Bounds(space.even, space.even_fixed, *lower_and_upper(self._robot, limits))
        return bounds, tuple(rows)

    def solve(
        self,
        problem: Problem,
        guess: Array,
        keep_attitude: bool,
        **options: Any,
    ) -> SqpResult:
        """Improve coordinates (n, m) within all inequalities, further ones last; options as of `minimise`."""
        space, bounds, rows = problem
        found = minimise(space, bounds, guess, keep_attitude, rows, **options)
        further = () if self._further is None else self._further(space)
        if any(row.violation(found.y) > 0.0 for row in further):
            return minimise(space, bounds, found.y, keep_attitude, (*rows, *further), **options)
        return found

    def motion(self, space: WeightSpace, solution: SqpResult) -> ReachPlan:
        """Return the plan of a solution."""
        phase = np.linspace(0.0, 1.0, NODES)
        columns, t, basis = space.weights(solution.y).T, space.duration, space.shapes.basis
        return ReachPlan(
            METHOD,
            phase * t,
            basis.value(phase) @ columns,
            basis.derivative(phase) @ columns / t,
            basis.second_derivative(phase) @ columns / t**2,
            float(space.dense_cost(solution.y[None])[0]),
            notes=f"{solution.iterations} iterations",
        )

    def _from_library(
        self, library: Library | None, problem: Problem, reach: Reach, thorough: bool
    ) -> list[SqpResult]:
        """Solutions from the stored motions with the least predicted costs."""
        if library is None:
            return []
        (space, bounds, rows), keep = problem, reach.keep_attitude
        alike = bounds.any and reach.kind == "pose" and not keep
        candidates = self._candidates or (LIMITED_CANDIDATES if alike else CANDIDATES)
        guesses, predicted = ranked(space, bounds, library.nearest(reach, candidates), keep)
        improved = self._improved or IMPROVED
        if not bounds.any:
            count = RACED if keep else WIDE_RACED
            guesses = np.concatenate([raced(problem, guesses[:count], keep), guesses[count:]])
            improved = self._improved or (IMPROVED if keep else WIDE_IMPROVED)
        found: list[SqpResult] = []
        # With the attitude free nearly every start leads to the goal.
        for in_stages in (True,) if keep else (False, True):
            starts = Starts(problem, keep, in_stages)
            most = max(improved, (MOST_STARTED if in_stages else MOST_IMPROVED) if thorough else MAX_IMPROVED)
            _run(starts, guesses[:most], improved, predicted)
            found += starts.ends
            if starts.best is not None or not (thorough and rows):
                break
        return found

    def _from_rest(
        self, space: WeightSpace, bounds: Bounds, rows: tuple[Rows, ...], keep_attitude: bool
    ) -> list[SqpResult]:
        """Solutions without stored motions.

        With the arm at rest the attitude is stationary to first order, so that attitude-constrained motions
        start around the attitude-unconstrained one.
        """
        rest = np.zeros((self._robot.n_joints, space.free))
        free = minimise(space, bounds, rest, False, rows)
        if not keep_attitude:
            return [free]
        rng = np.random.default_rng(0)
        guesses = free.y + PERTURBATION * rng.standard_normal((PERTURBED, *rest.shape))
        found = [minimise(space, bounds, guess, True, rows) for guess in guesses]
        for number in range(MORE_PERTURBED if self._library is None else 0):
            if best_solution(found) is not None:
                break
            spread = PERTURBATION * (1.0 + number / PERTURBED)
            guess = free.y + spread * rng.standard_normal(rest.shape)
            found.append(minimise(space, bounds, guess, True, rows))
        return found

    def _out_of_reach(self, reach: Reach) -> Failure | None:
        """Failure if the goal is farther than the straight arm reaches."""
        robot = self._robot
        centre = robot.centre_of_mass(robot.kinematics(reach.start))
        distance, longest = float(np.linalg.norm(reach.end.position - centre)), robot.reach()
        if distance <= longest:
            return None
        reason = f"the goal is {distance:.2f} m from the centre of mass, the arm reaches {longest:.2f} m"
        return Failure(METHOD, Cause.OUT_OF_REACH, reason)


def _run(starts: Starts, guesses: Array, improved: int, predicted: float) -> None:
    """Improve guesses in their order, at least `improved`, until enough of them have led to the goal."""
    for number, guess in enumerate(guesses, start=1):
        starts.add(guess)
        best = starts.best
        if best is None or number < improved:
            continue
        if number >= MAX_IMPROVED or best.cost <= RETRY_COST_RATIO * predicted:
            return
    starts.resume()


def _improved(
    space: WeightSpace, bounds: Bounds, rows: tuple[Rows, ...], keep_attitude: bool, best: SqpResult
) -> SqpResult:
    """A solution with additional rows, from one without them or around it; that one where none is found."""
    rng = np.random.default_rng(0)
    for number in range(FURTHER):
        shift = PERTURBATION * number * rng.standard_normal(best.y.shape)
        found = minimise(space, bounds, best.y + shift, keep_attitude, rows)
        if best_solution([found]) is not None:
            return found
    return best


def _failure(found: Sequence[SqpResult], duration: float) -> Failure:
    nearest = min(found, key=lambda solution: solution.goal_error)
    if not np.isfinite(nearest.goal_error):
        return Failure(METHOD, Cause.INFEASIBLE, f"the limits leave no motion of {duration:.3g} s")
    if nearest.ending is Ending.INFEASIBLE or nearest.goal_error < 10.0 * GOAL_TOLERANCE:
        reason = f"no step keeps the limits; {nearest.goal_error:.3g} m or rad were left"
        return Failure(METHOD, Cause.INFEASIBLE, reason)
    reason = f"of {len(found)} starts the best left {nearest.goal_error:.3g} m or rad ({nearest.ending})"
    return Failure(METHOD, Cause.SOLVER, reason)
