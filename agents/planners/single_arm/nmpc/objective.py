"""Sum of squares that the receding-horizon controller minimises over motions."""

from collections.abc import Iterable

import numpy as np

from agents.planners.single_arm.nmpc.problem import Weights
from agents.planners.single_arm.weights.elastic import SHARE_PENALTY, SLACK
from agents.planners.single_arm.weights.quadratic import Bounds
from agents.planners.single_arm.weights.shapes import INTERVALS
from agents.planners.single_arm.weights.sqp import Rows
from agents.planners.single_arm.weights.weight_space import Disturbance, Effect, WeightSpace
from space_envs.dynamics.rotations import Array


class Objective:
    """Objective over a space of motions.

    Args:
        attitude: (3, 3) desired of the satellite, in the frame of the space.
    """

    def __init__(self, space: WeightSpace, bounds: Bounds, weights: Weights, attitude: Array) -> None:
        self._space, self._bounds = space, bounds
        self._weights, self._back = weights, attitude.T
        length = space.duration / INTERVALS
        remaining = space.duration - length * np.arange(1, INTERVALS + 1)  # s until the end
        density = weights.attitude + weights.attitude_late * np.clip(1.0 - remaining / weights.late, 0.0, 1.0)
        density = density * length
        density[-1] += weights.attitude_end
        self._scale = np.sqrt(density)
        self._unit = np.eye(space.size) * 2.0 * weights.damping

    def value(self, y: Array, at: Disturbance | Effect, inequalities: Iterable[Rows] = ()) -> float:
        """Objective at coordinates (n, m), with a penalty on violated bounds and inequalities."""
        error, rotation = at.goal_error[0, : self._space.rows], self._scale[:, None] * self._rotations(at)
        beyond = sum(row.violation(y) for row in inequalities)
        if self._bounds.any:
            beyond += max(float(self._bounds.excess(y).max()) - SLACK, 0.0)
        terminal = self._weights.goal * (error @ error)
        return float(at.cost[0] + terminal + (rotation * rotation).sum() + SHARE_PENALTY * beyond)

    def quadratic(self, at: Disturbance) -> tuple[Array, Array]:
        """Damped Gauss-Newton Hessian (n m, n m) and gradient (n m,) at one motion."""
        root = np.sqrt(self._weights.goal)
        rotation = self._scale[:, None] * self._rotations(at)
        slope = self._scale[:, None, None] * self._space.displacements(at.influence)[0, 1:, 3:]
        size = self._space.size
        rows = np.concatenate(
            [at.residual_slope[0], root * at.goal_slope[0, : self._space.rows], slope.reshape(-1, size)]
        )
        values = np.concatenate(
            [at.residual[0], root * at.goal_error[0, : self._space.rows], rotation.ravel()]
        )
        return 2.0 * rows.T @ rows + self._unit, 2.0 * values @ rows

    def _rotations(self, at: Disturbance | Effect) -> Array:
        """Rotation vectors (K, 3), rad, of the satellite from the desired attitude, after each interval."""
        rotation = at.pose[0, 1:, 3:].reshape(-1, 3, 3).swapaxes(1, 2) @ self._back
        skew = 0.5 * (rotation - rotation.swapaxes(1, 2))
        axial = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        sine = np.sqrt((axial * axial).sum(axis=1))
        angle = np.arctan2(sine, 0.5 * (np.trace(rotation, axis1=1, axis2=2) - 1.0))
        return axial * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 1e-9)[:, None]
