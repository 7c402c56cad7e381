"""Damped Newton in the weights of a ProMP: the least cost by eq. 20 for a goal, within limits."""

from dataclasses import dataclass
from enum import StrEnum
from typing import NamedTuple, Protocol

import numpy as np

from agents.planners.common.plans import Failure
from agents.planners.single_arm.weights.bounds import Bounds
from agents.planners.single_arm.weights.quadratic import QuadraticProgram
from agents.planners.single_arm.weights.weight_space import Disturbance, WeightSpace
from space_envs.dynamics.rotations import Array

ITERATIONS = 60
# Relative gain of an iteration below which it is the last, with the attitude unconstrained and constrained.
# On 80 validation goals they leave 0.03 % and 0.02 % of the cost in the median.
FREE_TOLERANCE, KEPT_TOLERANCE = 1e-3, 2e-4
GOAL_TOLERANCE = 1e-5  # m and rad, of the terminal error
FREE_VIOLATION, KEPT_VIOLATION = (
    1e-5,
    1e-3,
)  # sum over the nonlinear inequalities with which iterations may end
MAX_GOAL_STEP = 0.3  # m or rad, of the terminal error that one iteration removes
DAMPING = 1e-3  # initial, m^2/rad^2 per unit of the integral of qdot' qdot
LEAST_DAMPING, LARGEST_DAMPING = 1e-6, 1e2
LEAST_FRACTION = 0.05  # of the terminal error, below which no step is tried
NEAR_GOAL = 0.05  # m or rad, of the terminal error, below which second derivatives are used
WALL = 10.0  # weight of squared equations in the Hessian, relative to the mean size of both
CORRECTION_RATIO = 0.3  # of actual to predicted decrease, below which a second-order correction is tried
ACCEPTED_RATIO, GOOD_RATIO, POOR_RATIO = 0.05, 0.6, 0.25  # of actual to predicted decrease

LinearRows = tuple[Array, Array, Array]
"""Rows (k, n m) on a step, with lower and upper limits (k,)."""


class Rows(Protocol):
    """Nonlinear inequalities, linearised at one motion."""

    def violation(self, y: Array) -> float:
        """Sum of the violations at coordinates (n, m)."""
        ...

    def linear(self, y: Array, at: Disturbance, part: float) -> LinearRows:
        """Rows on a step from y that removes at least `part` of each violation."""
        ...


class Ending(StrEnum):
    """Reason why iterations ended."""

    CONVERGED = "converged"
    ITERATIONS = "iterations"
    INFEASIBLE = "infeasible"  # no step satisfies the bounds
    STUCK = "stuck"


@dataclass(frozen=True, eq=False)
class SqpResult:
    """Last iterate, converged or not.

    Attributes:
        y: (n, m) coordinates. cost: m^2/s. goal_error: largest component, m or rad. violation: sum over the
            nonlinear inequalities. iterations: number of them. ending: reason why they ended.
    """

    y: Array
    cost: float
    goal_error: float
    violation: float
    iterations: int
    ending: Ending


def minimise(
    space: WeightSpace,
    bounds: Bounds,
    guess: Array,
    keep_attitude: bool,
    rows: tuple[Rows, ...] = (),
    tolerance: float | None = None,
    iterations: int = ITERATIONS,
) -> SqpResult:
    """Improve coordinates (n, m) until an iteration gains less than `tolerance` of the cost.

    Without one it is FREE_TOLERANCE or KEPT_TOLERANCE.

    Each iteration minimises the linearised residual, damped, subject to the linearised goal and the bounds.
    With the attitude constrained, near the goal, the Hessian is exact: the constraint bends so much there
    that Gauss-Newton steps follow it slowly. A step that does not decrease the exact penalty function enough
    is corrected to second order, then shortened by damping.
    """
    return Descent(space, bounds, guess, keep_attitude, rows, tolerance).run(iterations)


class _Linearised(NamedTuple):
    """Terminal error with its derivative, the cost's gradient and the undamped Hessian at an iterate.

    In the Hessian the squared equations have the weight `wall`, which changes no step that satisfies them.
    """

    goal_error: Array
    equations: Array
    gradient: Array
    square: Array
    wall: float


class _Iterate(NamedTuple):
    """Coordinates (n, m) with all that is evaluated there, and the sum of the violations."""

    y: Array
    at: Disturbance
    violation: float


class Descent:
    """The iterations of `minimise` from one guess, which can be interrupted and go on."""

    def __init__(
        self,
        space: WeightSpace,
        bounds: Bounds,
        guess: Array,
        keep_attitude: bool,
        rows: tuple[Rows, ...] = (),
        tolerance: float | None = None,
    ) -> None:
        self._space, self._rows, self._keep_attitude = space, rows, keep_attitude
        usual = KEPT_TOLERANCE if keep_attitude else FREE_TOLERANCE
        self._tolerance = usual if tolerance is None else tolerance
        self._violation = KEPT_VIOLATION if keep_attitude else FREE_VIOLATION
        self._constrained = space.constrained(keep_attitude)  # components of the terminal error
        self._program, self._unit = QuadraticProgram(bounds), np.eye(space.size)
        self._damping, self._fraction, self._penalty = DAMPING, 1.0, 1e-4
        self._multipliers: Array | None = None  # of the terminal error, from the last accepted step
        self._number = 0
        none = np.zeros((0, space.size)), np.zeros(0)
        nearest = self._program.solve(self._unit, np.zeros(space.size), *none, guess)
        possible = not isinstance(nearest, Failure)
        self._ending = None if possible else Ending.INFEASIBLE
        self._here = self._at(guess + nearest[0].reshape(guess.shape) if possible else guess)

    def run(self, iterations: int) -> SqpResult:
        """Iterate until the last one, or until there were so many in all."""
        while self._ending is None and self._number < iterations:
            self._number += 1
            self._ending = self._iterate()
        return self._result()

    def _satisfied(self) -> bool:
        return self._goal_error() < GOAL_TOLERANCE and self._here.violation < self._violation

    def _result(self) -> SqpResult:
        """The last iterate; infinite errors if no motion is within the bounds."""
        if self._number == 0 and self._ending is not None:
            return SqpResult(self._here.y, np.inf, np.inf, np.inf, 0, self._ending)
        y, at, violation = self._here
        ending = Ending.ITERATIONS if self._ending is None else self._ending
        return SqpResult(y, float(at.cost[0]), self._goal_error(), violation, self._number, ending)

    def _iterate(self) -> Ending | None:
        """One iteration; the reason if it is the last."""
        linear = self._linearised()
        part, extra, found = self._step(linear)
        if isinstance(found, Failure):
            return Ending.INFEASIBLE
        step, multipliers = found
        self._penalty = max(self._penalty, 1.5 * float(np.abs(multipliers).max()))
        model = linear.gradient @ step + 0.5 * step @ linear.square @ step
        model -= 0.5 * linear.wall * part**2 * linear.goal_error @ linear.goal_error
        predicted = self._penalty * part * float(np.abs(linear.goal_error).sum()) - float(model)
        value, trial = self._merit(self._here), self._tried(step)
        gain = value - self._merit(trial)
        if gain < CORRECTION_RATIO * predicted:
            trial = self._corrected(linear, step, trial, extra)
            gain = value - self._merit(trial)
        ratio = gain / max(predicted, 1e-300)
        if ratio > ACCEPTED_RATIO:
            self._multipliers = multipliers
            return self._accept(trial, ratio, part)
        self._damping, self._fraction = 8.0 * self._damping, 0.5 * self._fraction
        return Ending.STUCK if self._damping > LARGEST_DAMPING else None

    def _linearised(self) -> _Linearised:
        (y, at, _), n = self._here, self._constrained
        residual, jacobian = at.residual[0], at.residual_slope[0]
        goal_error, equations = at.goal_error[0, :n], at.goal_slope[0, :n]
        gradient, square = 2.0 * residual @ jacobian, 2.0 * jacobian.T @ jacobian
        far = not self._keep_attitude or np.abs(goal_error).max() > NEAR_GOAL
        if far or self._multipliers is None:
            return _Linearised(goal_error, equations, gradient, square, 0.0)
        # The last multipliers are those of the terminal error's second derivatives.
        wall = WALL * float(np.trace(square) / (equations * equations).sum())
        curved = square + self._space.curvature(y, at, self._multipliers)
        convex = _convex(curved + wall * equations.T @ equations, self._damping)
        return _Linearised(goal_error, equations, gradient, convex, wall)

    def _step(self, linear: _Linearised) -> tuple[float, LinearRows | None, tuple[Array, Array] | Failure]:
        """Part of the terminal error that a step removes, the rows it obeys, and step and multipliers."""
        largest = float(np.abs(linear.goal_error).max())
        part = min(self._fraction, MAX_GOAL_STEP / max(largest, 1e-12))
        while True:
            extra = _concatenated([row.linear(self._here.y, self._here.at, part) for row in self._rows])
            found = self._solve(linear, -part * linear.goal_error, extra)
            if not isinstance(found, Failure) or part < LEAST_FRACTION:
                return part, extra, found
            part *= 0.5

    def _solve(
        self, linear: _Linearised, right: Array, extra: LinearRows | None
    ) -> tuple[Array, Array] | Failure:
        hessian = linear.square + self._damping * self._unit
        return self._program.solve(hessian, linear.gradient, linear.equations, right, self._here.y, extra)

    def _corrected(
        self, linear: _Linearised, step: Array, trial: _Iterate, extra: LinearRows | None
    ) -> _Iterate:
        """The better of a trial and its second-order correction, which adds the step's own curvature."""
        curved = linear.equations @ step - trial.at.goal_error[0, : self._constrained]
        second = self._solve(linear, curved, extra)
        if isinstance(second, Failure):
            return trial
        return min(trial, self._tried(second[0]), key=self._merit)

    def _accept(self, trial: _Iterate, ratio: float, part: float) -> Ending | None:
        before, after = float(self._here.at.cost[0]), float(trial.at.cost[0])
        self._here = trial
        self._fraction = min(2.0 * self._fraction, 1.0)
        if ratio > GOOD_RATIO:
            self._damping = max(0.25 * self._damping, LEAST_DAMPING)
        elif ratio < POOR_RATIO:
            self._damping *= 4.0
        settled = abs(before - after) < self._tolerance * before
        return Ending.CONVERGED if self._satisfied() and part == 1.0 and settled else None

    def _at(self, y: Array) -> _Iterate:
        violation = float(sum(row.violation(y) for row in self._rows))
        return _Iterate(y, self._space.disturbance(y[None]), violation)

    def _tried(self, step: Array) -> _Iterate:
        return self._at(self._here.y + step.reshape(self._here.y.shape))

    def _merit(self, iterate: _Iterate) -> float:
        """Exact penalty function."""
        error = np.abs(iterate.at.goal_error[0, : self._constrained]).sum()
        return float(iterate.at.cost[0] + self._penalty * (error + iterate.violation))

    def _goal_error(self) -> float:
        return float(np.abs(self._here.at.goal_error[0, : self._constrained]).max())


def _concatenated(parts: list[LinearRows]) -> LinearRows | None:
    if not parts:
        return None
    rows, low, high = (np.concatenate(column) for column in zip(*parts, strict=True))
    return rows, low, high


def _convex(hessian: Array, damping: float) -> Array:
    """The matrix if it is positive definite with damping, else without its negative eigenvalues."""
    try:
        np.linalg.cholesky(hessian + damping * np.eye(len(hessian)))
    except np.linalg.LinAlgError:
        values, vectors = np.linalg.eigh(hessian)
        return (vectors * np.maximum(values, 0.0)) @ vectors.T
    return hessian
