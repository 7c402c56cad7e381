"""Search for a path to a goal: sequential quadratic programming with Gauss-Newton steps."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from agents.planners.single_arm.reactionless.objectives import PathObjective
from agents.planners.single_arm.reactionless.paths import FUNCTIONS, PathRollout, PathSpace
from agents.planners.single_arm.reactionless.program import VIOLATION, ProgramStep, StepProgram
from agents.planners.single_arm.reactionless.rows import PathRows, Places
from space_envs.dynamics.rotations import Array

REACHED = 1e-3  # m and rad, of a path in the search; plans are polished
KEPT = 1e-3  # violation of one in the search, as a share of a limit
LONGEST_MISS = 0.4  # m and rad of the goal error that one iteration takes away
LONGEST_STEP = 4.0  # rad, of all weights together
CORRECTIONS = 2  # of a Newton step to the goal
NEAR, BAND = 0.05, 0.35  # below the largest violation, within which all rows, or every other one, count
FIRST_DAMPING = 1e-2  # as a fraction of the objective's mean curvature
_LEAST_DAMPING, _MOST_DAMPING = 1e-6, 1e4  # likewise
_REFUSED, _POOR, _CORRECTED, _GOOD = 0.05, 0.25, 0.5, 0.6  # actual decrease by the predicted one


class Found(NamedTuple):
    """End of a search: weights (n, K), the objective, the largest violation, and iterations."""

    weights: Array
    objective: float
    violation: float
    iterations: int

    @property
    def kept(self) -> bool:
        """Whether the rows are kept at the samples."""
        return self.violation < KEPT


@dataclass(frozen=True, eq=False)
class PathProblem:
    """A search: the objective, and rows that a path keeps besides the goal of its space."""

    space: PathSpace
    objective: PathObjective
    rows: tuple[PathRows, ...]

    def at(self, weights: Array) -> "_Trial":
        """The path of weights (n, K)."""
        rollout = self.space.rollout(weights)
        excess = tuple(rows.excess(rollout.dense) for rows in self.rows)
        return _Trial(weights, rollout, self.objective.residual(rollout.path), excess)


@dataclass(frozen=True, eq=False)
class _Trial:
    """A path without its derivatives: residuals (r,) and the values of all rows."""

    weights: Array
    rollout: PathRollout
    residual: Array
    excess: tuple[Array, ...]

    @cached_property
    def violation(self) -> float:
        return max(0.0, *(float(values.max(initial=0.0)) for values in self.excess))

    @cached_property
    def objective(self) -> float:
        return float(self.residual @ self.residual)

    @property
    def miss(self) -> Array:
        return self.rollout.path.miss

    @property
    def feasible(self) -> bool:
        return self.violation < KEPT and bool(np.abs(self.miss).max() < REACHED)

    def merit(self, penalty: float) -> float:
        """Exact penalty function; infinite where a path is lost."""
        value = self.objective + penalty * float(np.abs(self.miss).sum()) + VIOLATION * self.violation
        return value if np.isfinite(value) else np.inf

    def places(self) -> list[Places]:
        """Places of the rows that count, of each kind."""
        found = []
        for values in self.excess:
            counts = values > self.violation - NEAR
            counts[::2] |= values[::2] > self.violation - BAND
            found.append(np.nonzero(counts))
        return found

    def chosen(self, places: list[Places]) -> Array:
        """Values (k,) of the rows at places."""
        return np.concatenate([values[at] for values, at in zip(self.excess, places, strict=True)])


class _Point:
    """A path with its objective, goal and rows linearised."""

    def __init__(self, problem: PathProblem, trial: _Trial) -> None:
        self._space, self.trial, path = problem.space, trial, trial.rollout.path
        by = problem.space.sensitivities(trial.rollout)
        self.usable = by.usable and np.isfinite(trial.merit(0.0))
        if not self.usable:
            return
        self.equations, self.slope = by.miss, problem.objective.slopes(path, by)
        self.places = trial.places()
        rows = zip(problem.rows, self.places, strict=True)
        self.rows = np.concatenate([kind.slopes(trial.rollout.dense, by, at) for kind, at in rows])
        self.excess = trial.chosen(self.places)
        self._square = 2.0 * self.slope.T @ self.slope
        self._curvature = float(np.trace(self._square)) / len(self._square) + 1e-9

    def program(self, damping: float) -> StepProgram:
        """The quadratic program of a step."""
        hessian = self._square.copy()
        hessian.flat[:: len(hessian) + 1] += (damping + 1e-9) * self._curvature
        gradient = 2.0 * (self.slope.T @ self.trial.residual)
        return StepProgram(hessian, gradient, self.equations, self.rows)

    def part(self) -> float:
        """Part of the goal error that a step takes away."""
        return min(1.0, LONGEST_MISS / max(float(np.linalg.norm(self.trial.miss)), 1e-12))

    def corrected(self, program: StepProgram, step: Array, trial: _Trial) -> ProgramStep | None:
        """The step of second order, by what a trial of the first one shows of the constraints' curvature."""
        miss = trial.miss - self.equations @ step
        return program.solve(miss, trial.chosen(self.places) - self.rows @ step)

    def predicted(self, found: ProgramStep, penalty: float) -> float:
        """Merit that a step promises."""
        residual = self.trial.residual + self.slope @ found.step
        left = (1.0 - self.part()) * float(np.abs(self.trial.miss).sum())
        return float(residual @ residual) + penalty * left + VIOLATION * found.violation


def to_goal(space: PathSpace, weights: Array, iterations: int) -> Array:
    """Weights (n, K) after Newton steps of least norm towards the goal, each with corrections of its end."""
    for _ in range(iterations):
        path, by = space.sensitive(weights)
        largest = float(np.abs(path.miss).max())
        if largest < REACHED or not by.usable:
            break
        square = by.miss @ by.miss.T
        square += 1e-4 * np.trace(square) / len(square) * min(1.0, largest) ** 2 * np.eye(len(square))
        inverse = np.linalg.solve(square, by.miss).T
        part = min(1.0, LONGEST_MISS / float(np.linalg.norm(path.miss)))
        weights = weights - _shaped(space, _short(inverse @ (part * path.miss)))
        for _ in range(CORRECTIONS):
            before, largest = largest, float(np.abs(miss := space.missed(weights)).max())
            if largest < REACHED:
                return weights
            if largest > 0.5 * before:
                break
            weights = weights - _shaped(space, inverse @ miss)
    return weights


def promise(problem: PathProblem, weights: Array) -> float:
    """The merit that one step from weights (n, K) promises."""
    point = _Point(problem, problem.at(weights))
    if not point.usable:
        return np.inf
    found = point.program(FIRST_DAMPING).solve(point.part() * point.trial.miss, point.excess)
    return np.inf if found is None else point.predicted(found, 0.0)


def minimise(problem: PathProblem, weights: Array, iterations: int, gain: float) -> Found:
    """The least objective among paths to the goal that keep the rows, from weights (n, K).

    Where none keeps them, the largest violation is made small. It ends when an iteration gains less than
    `gain` of the objective.
    """
    point, damping, penalty, number = _Point(problem, problem.at(weights)), FIRST_DAMPING, 0.0, 0
    trial = point.trial
    while number < iterations and point.usable and damping < _MOST_DAMPING:
        number += 1
        program = point.program(damping)
        found = program.solve(point.part() * trial.miss, point.excess)
        if found is None:
            damping *= 8.0
            continue
        penalty = max(penalty, 1.5 * float(np.abs(found.multiplier).max()))
        before, best, ratio = trial.merit(penalty), trial, -np.inf
        predicted = max(before - point.predicted(found, penalty), 1e-12)
        for tried in _trials(problem, point, program, found):
            if tried.merit(penalty) < best.merit(penalty):
                best, ratio = tried, (before - tried.merit(penalty)) / predicted
            if ratio > _CORRECTED:
                break
        if not ratio > _REFUSED:
            damping = 8.0 * max(damping, 1e-3)
            continue
        damping = max(0.2 * damping, _LEAST_DAMPING) if ratio > _GOOD else damping
        damping = 4.0 * damping if ratio < _POOR else damping
        trial, gained = best, before - best.merit(penalty)
        if number == iterations or (trial.feasible and gained < gain * trial.objective):
            break
        point = _Point(problem, trial)
    return Found(trial.weights, trial.objective, trial.violation, number)


def _trials(
    problem: PathProblem, point: _Point, program: StepProgram, found: ProgramStep
) -> Iterator[_Trial]:
    """Paths after a step, and after its correction unless it is too long."""
    step = _short(found.step)
    trial = problem.at(point.trial.weights + _shaped(problem.space, step))
    yield trial
    if step is not found.step or not np.isfinite(trial.merit(0.0)):
        return
    second = point.corrected(program, step, trial)
    if second is not None:
        yield problem.at(point.trial.weights + _shaped(problem.space, _short(second.step)))


def _short(step: Array) -> Array:
    """A step of at most the longest length, itself if it is not longer."""
    length = float(np.linalg.norm(step))
    return step if length <= LONGEST_STEP else step * (LONGEST_STEP / length)


def _shaped(space: PathSpace, flat: Array) -> Array:
    """Weights (n, K) of flattened ones (m,)."""
    return flat.reshape(FUNCTIONS, space.n).T
