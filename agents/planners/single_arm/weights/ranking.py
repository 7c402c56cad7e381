"""Initial guesses in the order of the costs that one step from each predicts."""

from typing import NamedTuple

import numpy as np

from agents.planners.common.plans import Failure
from agents.planners.single_arm.weights.bounds import Bounds
from agents.planners.single_arm.weights.quadratic import QuadraticProgram
from agents.planners.single_arm.weights.weight_space import WeightSpace
from space_envs.dynamics.rotations import Array

# m^2/rad^2 per unit of the integral of the squared rate that a step adds: predictions of long steps are too
# low. Within limits 3e-3 to 1e-2 did best on 40 medium validation goals, without them 1e-3 to 3e-3.
STEP_COST = 3e-3


class Ranked(NamedTuple):
    """Coordinates (S, n, m) of initial guesses, best first, and the least predicted cost, m^2/s."""

    guesses: Array
    least: float


def ranked(space: WeightSpace, bounds: Bounds, guesses: Array, keep_attitude: bool) -> Ranked:
    """Order guesses (S, n, m) by the costs that one step within the bounds predicts.

    The costs predicted without bounds are lower: they spare the bounded step of most guesses.
    """
    cost = predicted_costs(space, guesses, keep_attitude)
    least = np.inf
    for k in np.argsort(cost, kind="stable"):
        if cost[k] >= least:
            break
        cost[k] = _bounded_cost(space, bounds, guesses[k], keep_attitude)
        least = min(least, float(cost[k]))
    return Ranked(guesses[np.argsort(cost, kind="stable")], least)


def predicted_costs(
    space: WeightSpace, guesses: Array, keep_attitude: bool, step_cost: float = STEP_COST
) -> Array:
    """Costs (S,) predicted by one Gauss-Newton step from coordinates (S, n, m) to the goal, without bounds.

    The cost of the step itself, `step_cost` times its square, is included.
    """
    constrained = space.constrained(keep_attitude)
    at = space.disturbance(guesses)
    jacobian, equations = at.residual_slope, at.goal_slope[:, :constrained]
    size = space.size
    hessian = jacobian.swapaxes(1, 2) @ jacobian
    hessian[:, np.arange(size), np.arange(size)] += step_cost
    pull = at.residual[:, None] @ jacobian
    # Multipliers of the equations first: a smaller system than with them.
    right = np.concatenate([pull, equations], axis=1).swapaxes(1, 2)
    solved = np.linalg.solve(hessian, right)
    free, by_equation = solved[..., :1], solved[..., 1:]
    missing = at.goal_error[:, :constrained, None] - equations @ free
    multipliers = np.linalg.solve(equations @ by_equation, missing)
    step = -free - by_equation @ multipliers
    remaining = at.residual + (jacobian @ step)[..., 0]
    return (remaining * remaining).sum(axis=1) + step_cost * (step * step).sum(axis=(1, 2))


def _bounded_cost(space: WeightSpace, bounds: Bounds, guess: Array, keep_attitude: bool) -> float:
    """The same of one guess (n, m) with a step within the bounds; infinite where there is none."""
    constrained = space.constrained(keep_attitude)
    at = space.disturbance(guess[None])
    jacobian, residual = at.residual_slope[0], at.residual[0]
    equations, right = at.goal_slope[0, :constrained], -at.goal_error[0, :constrained]
    hessian = jacobian.T @ jacobian + STEP_COST * np.eye(space.size)
    found = QuadraticProgram(bounds).solve(hessian, residual @ jacobian, equations, right, guess)
    if isinstance(found, Failure):
        return np.inf
    step = found[0]
    remaining = residual + jacobian @ step
    return float(remaining @ remaining + STEP_COST * step @ step)
