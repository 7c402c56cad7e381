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
from agents.planners.single_arm.weights.bounds import Bounds, lower_and_upper
from agents.planners.single_arm.weights.end_rates import matching_rates
from agents.planners.single_arm.weights.ranking import ranked
from agents.planners.single_arm.weights.sqp import GOAL_TOLERANCE, Ending, Rows, SqpResult, minimise
from agents.planners.single_arm.weights.weight_space import WeightSpace
from promp import GaussianBasis
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, to_matrix
from space_envs.errors import positive_integer

METHOD = "promp_optimal"
CANDIDATES = 24  # stored motions whose predicted costs are compared
LIMITED_CANDIDATES = 12  # the same within limits for a pose with the attitude free, where optima are alike
IMPROVED = 1  # candidates that are improved; the others follow where none of them leads to the goal
MOST_CANDIDATES = 10_000
RACED, RACE = 4, 4  # candidates without limits that are compared again after so many iterations
RACE_PENALTY = 3e-3  # m^2/s per m or rad, of the terminal errors that are left then
MOST_IMPROVED = 5  # candidates that are improved where none of them leads to the goal
BARE = 9  # candidates that are then improved without nonlinear inequalities first
MAX_IMPROVED = 2  # candidates that are improved where costs are high
RETRY_COST_RATIO = 1.3  # of a cost to the least predicted cost, above which a second candidate is improved
VIOLATION_TOLERANCE = 1e-2  # fraction of a torque, or m, of a solution in sum over the motion
PERTURBED = (
    6  # initial guesses around the attitude-unconstrained motion, where no stored one leads to the goal
)
FURTHER = 6  # initial guesses around a motion that violates further inequalities, with growing perturbations
MORE_PERTURBED = 24  # others without a library, farther and farther, until one leads to the goal
PERTURBATION = 0.1  # in coordinates (root of the integral of a joint's squared rate, per function)
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
            improved, by predicted cost; the others follow where none of these leads to the goal.
        further: inequalities of a space of motions that are imposed where a plan without them violates
            them; None for none.
    """

    def __init__(
        self,
        robot: FloatingRobot,
        limits: Limits = Limits(),
        library: Library | None = None,
        basis: GaussianBasis = GaussianBasis(),
        candidates: int | None = None,
        improved: int = IMPROVED,
        further: Callable[[WeightSpace], tuple[Rows, ...]] | None = None,
    ) -> None:
        self._robot, self._limits, self._library, self._basis = robot, limits.checked(robot), library, basis
        self._candidates = candidates
        if candidates is not None:
            positive_integer("candidates", candidates, MOST_CANDIDATES)
        self._improved = positive_integer("improved", improved, MOST_CANDIDATES)
        self._further = further

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
        space, bounds, rows = self.setting(reach)
        found = self._from_library(space, bounds, rows, reach, thorough)
        best = _best(found)
        # Guesses around another motion lead past spheres, but hardly ever to a goal that stored ones miss.
        perturb = not reach.keep_attitude or reach.spheres is not None
        if best is None and (not found or (thorough and perturb)):
            found += self._from_rest(space, bounds, rows, reach.keep_attitude)
            best = _best(found)
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

    def _matched(self, reach: Reach, space: WeightSpace, y: Array) -> Solved | Failure:
        """The motion that ends as fast as the goal, from one to the same pose that ends at another rate.

        The rates at the end depend on the last configuration, which hardly depends on them: few rounds do.
        """
        rate = np.zeros(self._robot.n_joints)
        for _ in range(MATCHING_ROUNDS):
            before, rate = rate, matching_rates(self._robot, reach, space, y)
            space = self._space(reach, rate)
            bounds, rows = self._inequalities(space, reach)
            found = minimise(space, bounds, y, reach.keep_attitude, rows)
            if _best([found]) is None:
                return _failure([found], reach.duration)
            y = found.y
            if np.abs(rate - before).max() < RATE_TOLERANCE:
                return Solved(space, found)
        reason = f"joint rates at the end change by {np.abs(rate - before).max():.3g} rad/s in the last round"
        return Failure(METHOD, Cause.SOLVER, reason)

    def setting(self, reach: Reach) -> tuple[WeightSpace, Bounds, tuple[Rows, ...]]:
        """Return the motions that end at rest, bounds and nonlinear inequalities of a checked problem."""
        space = self._space(reach, np.zeros(self._robot.n_joints))
        return space, *self._inequalities(space, reach)

    def _space(self, reach: Reach, end_rate: Array) -> WeightSpace:
        """Motions that end with given joint rates (n,), rad/s."""
        return WeightSpace(
            self._robot,
            self._basis,
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
        problem: tuple[WeightSpace, Bounds, tuple[Rows, ...]],
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
        columns, t = space.weights(solution.y).T, space.duration
        return ReachPlan(
            METHOD,
            phase * t,
            self._basis.value(phase) @ columns,
            self._basis.derivative(phase) @ columns / t,
            self._basis.second_derivative(phase) @ columns / t**2,
            float(space.dense_cost(solution.y[None])[0]),
            notes=f"{solution.iterations} iterations",
        )

    def _from_library(
        self,
        space: WeightSpace,
        bounds: Bounds,
        rows: tuple[Rows, ...],
        reach: Reach,
        thorough: bool,
    ) -> list[SqpResult]:
        """Solutions from the stored motions with the least predicted costs."""
        if self._library is None:
            return []
        keep = reach.keep_attitude
        alike = bounds.any and reach.kind == "pose" and not keep
        candidates = self._candidates or (LIMITED_CANDIDATES if alike else CANDIDATES)
        guesses, predicted = ranked(space, bounds, self._library.nearest(reach, candidates), keep)
        if not bounds.any:
            guesses = np.concatenate([_raced(space, bounds, guesses[:RACED], keep), guesses[RACED:]])
        found: list[SqpResult] = []
        most = max(MOST_IMPROVED if thorough else MAX_IMPROVED, self._improved)
        for number, guess in enumerate(guesses[:most]):
            if number >= self._improved and (best := _best(found)) is not None:
                if number >= MAX_IMPROVED or best.cost <= RETRY_COST_RATIO * predicted:
                    break
            found.append(minimise(space, bounds, guess, keep, rows))
        for guess in guesses[:BARE] if rows and thorough else ():
            if _best(found) is not None:
                break
            # Nonlinear inequalities are imposed after the goal has been reached without them.
            bare = minimise(space, bounds, guess, keep)
            if bare.goal_error < GOAL_TOLERANCE:
                found.append(minimise(space, bounds, bare.y, keep, rows))
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
            if _best(found) is not None:
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


def _raced(space: WeightSpace, bounds: Bounds, guesses: Array, keep_attitude: bool) -> Array:
    """Coordinates (S, n, m) after a few iterations, the most promising first.

    Without limits motions run so far from their initial guesses that predictions of one step mislead.
    """
    ends = [minimise(space, bounds, guess, keep_attitude, iterations=RACE) for guess in guesses]
    ends.sort(key=lambda end: end.cost + RACE_PENALTY * end.goal_error)
    return np.stack([end.y for end in ends])


def _improved(
    space: WeightSpace, bounds: Bounds, rows: tuple[Rows, ...], keep_attitude: bool, best: SqpResult
) -> SqpResult:
    """A solution with additional rows, from one without them or around it; that one where none is found."""
    rng = np.random.default_rng(0)
    for number in range(FURTHER):
        shift = PERTURBATION * number * rng.standard_normal(best.y.shape)
        found = minimise(space, bounds, best.y + shift, keep_attitude, rows)
        if _best([found]) is not None:
            return found
    return best


def _best(found: Sequence[SqpResult]) -> SqpResult | None:
    """Solution of least cost that reaches its goal."""
    usable = [
        one for one in found if one.goal_error < 10.0 * GOAL_TOLERANCE and one.violation < VIOLATION_TOLERANCE
    ]
    return min(usable, key=lambda solution: solution.cost, default=None)


def _failure(found: Sequence[SqpResult], duration: float) -> Failure:
    nearest = min(found, key=lambda solution: solution.goal_error)
    if not np.isfinite(nearest.goal_error):
        return Failure(METHOD, Cause.INFEASIBLE, f"the limits leave no motion of {duration:.3g} s")
    if nearest.ending is Ending.INFEASIBLE or nearest.goal_error < 10.0 * GOAL_TOLERANCE:
        reason = f"no step keeps the limits; {nearest.goal_error:.3g} m or rad were left"
        return Failure(METHOD, Cause.INFEASIBLE, reason)
    reason = f"of {len(found)} starts the best left {nearest.goal_error:.3g} m or rad ({nearest.ending})"
    return Failure(METHOD, Cause.SOLVER, reason)
