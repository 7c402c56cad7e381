"""Gauss-Newton steps on paths in the reaction null space, of many problems at once."""

import numpy as np

from agents.planners.common.plans import Limits
from agents.planners.single_arm.amortised.paths import LinearisedPaths
from agents.planners.single_arm.amortised.steps import Penalties, halved_limits
from space_envs.dynamics.rotations import Array


class PathLoss:
    """Loss of paths of one robot: disturbance by eq. 20, terminal errors, and limits.

    Args:
        limits: on angles, rates and accelerations; others are ignored. joints: of the robot.
        penalties: of which that of the attitude does not matter.
    """

    def __init__(self, limits: Limits, joints: int, penalties: Penalties = Penalties()) -> None:
        centre, self._half = halved_limits(limits, joints)
        self.penalties, self._centre = penalties, centre[:, None, None]
        self._share = np.reshape(penalties.shares, (3, 1, 1, 1))

    def value(self, at: LinearisedPaths, weights: Array) -> Array:
        """Losses (S,) of weights (S, m)."""
        penalties, over = self.penalties, self._excess(at)[0]
        cost = (at.residual**2).sum(axis=1) + (penalties.of_errors[:6] * at.error**2).sum(axis=1)
        limits = penalties.limits * (over**2).mean(axis=2).sum(axis=(0, 2))
        return cost + limits + penalties.smallness * (weights**2).sum(axis=1)

    def step(self, at: LinearisedPaths, weights: Array, damping: float) -> Array:
        """Damped Gauss-Newton steps (S, m) from weights."""
        s, m = weights.shape
        errors = np.sqrt(self.penalties.of_errors[:6])
        rows = np.concatenate([at.by, errors[:, None] * at.error_by], axis=1)
        values = np.concatenate([at.residual, errors * at.error], axis=1)
        matrix = rows.swapaxes(1, 2) @ rows
        pull = (values[:, None] @ rows)[:, 0] + self.penalties.smallness * weights
        over, sign = self._excess(at)
        root = np.sqrt(self.penalties.limits / over.shape[2])
        for kind in range(3):
            active = np.flatnonzero((over[kind] > 0.0).any(axis=(0, 2)))  # nodes, in any of the paths
            scale = root * sign[kind] * (over[kind] > 0.0) / self._half[kind]
            hinge = (scale[:, active, :, None] * at.motion_by[kind][:, active]).reshape(s, -1, m)
            pull += (root * over[kind][:, active].reshape(s, 1, -1) @ hinge)[:, 0]
            half = hinge.astype(np.float32)  # enough for a matrix that only shapes the step
            matrix += half.swapaxes(1, 2) @ half
        matrix.reshape(s, -1)[:, :: m + 1] += damping + self.penalties.smallness
        return -np.linalg.solve(matrix, pull[..., None])[..., 0]

    def _excess(self, at: LinearisedPaths) -> tuple[Array, Array]:
        """Relative violations of the shares of limits, and signs, (3, S, N + 1, n)."""
        relative = (at.motion - self._centre) / self._half[:, None, None]
        return np.maximum(np.abs(relative) - self._share, 0.0), np.sign(relative)
