"""ProMPs conditioned on the limits that are active in their most likely motion."""

import numpy as np

from agents.planners.common.plans import Failure
from agents.planners.single_arm.weights.bounds import Bounds
from agents.planners.single_arm.weights.quadratic import QuadraticProgram
from agents.planners.single_arm.weights.weight_space import WeightSpace
from promp import ConditioningError
from promp.nonlinear import Conditioned, NonlinearTarget, condition_nonlinear
from space_envs.dynamics.rotations import Array

ROUNDS = 24  # of linearisation, until the most likely motion within the limits has converged
SHRINKING, LEAST_FRACTION = 0.8, 0.25  # a step longer than 0.8 of the last is halved, at most twice
STEP_TOLERANCE = 1e-4  # in coordinates, of the last step
GOAL_TOLERANCE = 1e-5  # m and rad


def conditioned_on_limits(found: Conditioned, space: WeightSpace, bounds: Bounds) -> Conditioned:
    """Condition a ProMP also on the limits that are active in the most likely motion within all limits."""
    mean = space.coordinates(found.promp.mean)
    if bounds.excess(mean).max() <= 0.0:
        return found
    active, nearest = _active_bounds(found, space, bounds, mean)
    if not active:
        return found
    target = NonlinearTarget(ActiveLimits(space, bounds, active, nearest))
    try:
        return condition_nonlinear(found.prior, [*found.targets, target], space.weights(nearest))
    except ConditioningError:
        return found


def _active_bounds(
    found: Conditioned, space: WeightSpace, bounds: Bounds, y: Array
) -> tuple[set[tuple[int, int]], Array]:
    """Active bounds of the most likely motion within all bounds, and its coordinates (n, m), from y.

    Sequential quadratic programming, with steps that are shortened where they do not shrink.
    """
    expected, free = space.coordinates(found.prior.mean), space.shapes.free
    out = np.kron(np.eye(len(y)), free)
    into = np.kron(np.eye(len(y)), np.linalg.pinv(free))
    precision = np.linalg.inv(into @ found.prior.covariance @ into.T)
    program, fraction, last = QuadraticProgram(bounds), 1.0, np.inf
    for _ in range(ROUNDS):
        error, slope = found.targets[0].function(space.weights(y)[None])
        pull = precision @ (y - expected).ravel()
        solved = program.solve(precision, pull, slope[0] @ out, -error[0], y)
        if isinstance(solved, Failure):
            return set(), y
        size = float(np.abs(solved[0]).max())
        if size > SHRINKING * last:
            fraction = max(0.5 * fraction, LEAST_FRACTION)
        y, last = y + fraction * solved[0].reshape(y.shape), size
        if np.abs(error).max() <= GOAL_TOLERANCE and size <= STEP_TOLERANCE:
            break
    return program.active, y


class ActiveLimits:
    """Bounds that motions are to attain, as a linear function of the weights.

    Args:
        active: rows and joints of the bounds. y: coordinates (n, m), nearest to the side of each bound.
    """

    def __init__(self, space: WeightSpace, bounds: Bounds, active: set[tuple[int, int]], y: Array) -> None:
        matrix, low, high = bounds.linear(np.zeros_like(y), active)
        value = matrix @ y.ravel()
        self._bound = np.where(value > 0.5 * (low + high), high, low)
        inverse = np.linalg.pinv(space.shapes.free)  # (m, nb)
        self._space, self._matrix = space, matrix
        self._slope = (matrix.reshape(len(matrix), *y.shape) @ inverse).reshape(len(matrix), -1)

    def __call__(self, weights: Array) -> tuple[Array, Array]:
        """Excess (S, k) of weights (S, n, nb) over the bounds, in half widths, and its derivative."""
        y = self._space.coordinates(weights).reshape(len(weights), -1)
        slope = np.broadcast_to(self._slope, (len(weights), *self._slope.shape))
        return y @ self._matrix.T - self._bound, slope
