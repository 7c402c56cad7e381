"""Gauss-Newton search for a path to a goal: nonlinear least squares with the goal error as constraint."""

from typing import NamedTuple

import numpy as np
from scipy.linalg import get_lapack_funcs

from agents.planners.single_arm.reactionless.objectives import Objective
from agents.planners.single_arm.reactionless.paths import FUNCTIONS, PathSpace, Samples, Sensitivities
from space_envs.dynamics.rotations import Array

REACHED = 1e-3  # m and rad, of a path in the search; plans are polished
CLOSE = 3e-4  # likewise, of a step that needs no correction
LONGEST_MISS = 0.4  # m and rad of the goal error that one iteration takes away
LONGEST_STEP = 4.0  # rad, of all weights together
CORRECTIONS = 2  # of second order, of a step
GAIN = 1e-2  # relative decrease of the objective below which the search ends
FIRST_DAMPING = 1e-2  # as a fraction of the mean curvature
_LEAST_DAMPING, _MOST_DAMPING = 1e-4, 1e4  # likewise
(_solve_positive,) = get_lapack_funcs(("posv",), dtype=np.float64)


class Found(NamedTuple):
    """End of a search: weights (n, K), the objective, the largest goal error in m or rad, and iterations."""

    weights: Array
    objective: float
    miss: float
    iterations: int


class _Point(NamedTuple):
    weights: Array
    path: Samples
    by: Sensitivities
    residual: Array
    slope: Array

    def merit(self, penalty: float) -> float:
        return float(self.residual @ self.residual) + penalty * float(np.abs(self.path.miss).sum())


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


def predicted(space: PathSpace, weights: Array, objective: Objective) -> float:
    """The objective that one step from weights (n, K) promises."""
    point = _point(space, weights, objective)
    if not point.by.usable:
        return np.inf
    step, _, _ = _step(space, point, FIRST_DAMPING)
    residual = point.residual + point.slope @ step.T.ravel()
    return float(residual @ residual)


def minimise(
    space: PathSpace, weights: Array, objective: Objective, iterations: int, gain: float = GAIN
) -> Found:
    """The least objective among paths to the goal, from weights (n, K)."""
    point, damping, penalty = _point(space, weights, objective), FIRST_DAMPING, 0.0
    number = 0
    while number < iterations and point.by.usable:
        number += 1
        step, multiplier, correct = _step(space, point, damping)
        penalty = max(penalty, 2.0 * float(np.abs(multiplier).max()))
        trial = point.weights + step
        for _ in range(CORRECTIONS):
            if np.abs(miss := space.missed(trial)).max() < CLOSE:
                break
            trial = trial + _shaped(space, correct @ miss)
        after = _point(space, trial, objective)
        before, now = point.merit(penalty), after.merit(penalty)
        if not now < before:
            damping = min(10.0 * damping, _MOST_DAMPING)
            if damping == _MOST_DAMPING:
                break
            continue
        damping = max(0.2 * damping, _LEAST_DAMPING)
        done = np.abs(after.path.miss).max() < REACHED and before - now < gain * now
        point = after
        if done:
            break
    return Found(
        point.weights, float(point.residual @ point.residual), float(np.abs(point.path.miss).max()), number
    )


def _point(space: PathSpace, weights: Array, objective: Objective) -> _Point:
    path, by = space.sensitive(weights)
    if not by.usable:
        return _Point(weights, path, by, np.full(1, np.inf), np.zeros((1, space.size)))
    return _Point(weights, path, by, *objective(path, by))


def _step(space: PathSpace, point: _Point, damping: float) -> tuple[Array, Array, Array]:
    """Step (n, K), multipliers (r,) of the goal, and the matrix (m, r) from a miss to its correction."""
    miss, equations = point.path.miss, point.by.miss
    rows = len(miss)
    hessian = point.slope.T @ point.slope
    hessian.flat[:: space.size + 1] += damping * np.trace(hessian) / space.size + 1e-9
    right = np.column_stack([equations.T, point.slope.T @ point.residual])
    _, solved, failed = _solve_positive(hessian, right)
    if failed:  # not positive definite in the digits there are
        solved = np.linalg.solve(hessian, right)
    inner = np.linalg.inv(equations @ solved[:, :rows] + 1e-12 * np.eye(rows))
    part = min(1.0, LONGEST_MISS / max(float(np.linalg.norm(miss)), 1e-12))
    multiplier = inner @ (part * miss - equations @ solved[:, rows])
    step = _short(-(solved[:, :rows] @ multiplier) - solved[:, rows])
    return _shaped(space, step), 2.0 * multiplier, -(solved[:, :rows] @ inner)


def _short(step: Array) -> Array:
    return step * min(1.0, LONGEST_STEP / max(float(np.linalg.norm(step)), 1e-12))


def _shaped(space: PathSpace, flat: Array) -> Array:
    """Weights (n, K) of flattened ones (m,)."""
    return flat.reshape(FUNCTIONS, space.n).T
