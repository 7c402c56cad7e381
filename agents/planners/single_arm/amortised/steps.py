"""Gauss-Newton steps on motions of many problems: towards less disturbance, and onto their goals."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from agents.planners.common.plans import Limits
from agents.planners.single_arm.amortised.motions import Linearised, MotionBatch
from space_envs.dynamics.rotations import Array

LEAST_CURVATURE = 1e-9  # of the goal's equations, added where they depend on each other


@dataclass(frozen=True)
class Penalties:
    """Weights of a loss in the unit of eq. 20 times dt, m^2/s.

    Attributes:
        position: per m^2 of the end-effector at the end. rotation, attitude: per rad^2 of the end-effector
            and of the base. limits: per squared relative violation of a limit, averaged over time, summed
            over joints.
        shares: of the limits on angles (half the range), rates and accelerations, beyond which they count.
        smallness: per squared coordinate.
    """

    position: float = 30.0
    rotation: float = 10.0
    attitude: float = 300.0
    limits: float = 0.5
    shares: tuple[float, float, float] = (0.98, 0.95, 0.92)
    smallness: float = 1e-4

    @property
    def of_errors(self) -> Array:
        """Weights (9,) of the squared terminal errors."""
        return np.repeat([self.position, self.rotation, self.attitude], 3)


class LimitTerms(NamedTuple):
    """Penalty of limits of S motions: half its gradient (S, n m) and Gauss-Newton matrix (S, n, m, m)."""

    gradient: Array
    curvature: Array


def halved_limits(limits: Limits, joints: int) -> tuple[Array, Array]:
    """Middles and half widths (3, n) of the limits on angles rad, rates rad/s and accelerations rad/s^2.

    Half widths are infinite where there is no limit.
    """
    low, high = limits.angles(joints).T
    bounded = np.isfinite(low) & np.isfinite(high)
    low, high = np.where(bounded, [low, high], 0.0)
    half = [np.where(bounded, 0.5 * (high - low), np.inf)]
    for limit in (limits.rate, limits.acceleration):
        half.append(np.broadcast_to(np.inf if limit is None else limit, joints))
    return np.stack([0.5 * (low + high), np.zeros(joints), np.zeros(joints)]), np.stack(half)


class MotionLoss:
    """Loss of motions of one robot: disturbance by eq. 20, terminal errors, and limits.

    Args:
        limits: on angles, rates and accelerations; others are ignored. joints: of the robot.
    """

    def __init__(self, limits: Limits, joints: int, penalties: Penalties = Penalties()) -> None:
        centre, half = halved_limits(limits, joints)
        self.penalties = penalties
        self._centre, self._half = centre[:, None, None], half[:, None, None]
        self._share = np.reshape(penalties.shares, (3, 1, 1, 1))

    def value(self, batch: MotionBatch, y: Array) -> Array:
        """Losses (S,) of coordinates (S, n, m)."""
        cost, error = batch.effect(y)
        weighted = (self.penalties.of_errors * error * error).sum(axis=1)
        over = np.maximum(self._relative(batch, y, self._share)[0], 0.0)
        limits = self.penalties.limits * (over * over).mean(axis=2).sum(axis=(0, 2))
        return cost + weighted + limits + self.penalties.smallness * (y * y).sum(axis=(1, 2))

    def violation(self, batch: MotionBatch, y: Array) -> Array:
        """Largest ratios (S, 3) of angles, rates and accelerations to limits; angles from the middle."""
        return self._relative(batch, y, 0.0)[0].max(axis=(2, 3)).T

    def step(self, batch: MotionBatch, y: Array, at: Linearised, damping: float) -> Array:
        """Damped Gauss-Newton steps (S, n, m) from coordinates on the whole loss."""
        errors = self.penalties.of_errors
        matrix, pull = self._without_errors(batch, y, at, damping)
        weighted = at.error_by * errors[:, None]
        matrix += weighted.swapaxes(1, 2) @ at.error_by
        pull += (weighted * at.error[..., None]).sum(axis=1)
        return -np.linalg.solve(matrix, pull[..., None]).reshape(y.shape)

    def correction(self, batch: MotionBatch, y: Array, at: Linearised, damping: float) -> Array:
        """Steps (S, n, m) onto the goals, to first order, with the least loss otherwise."""
        matrix, pull = self._without_errors(batch, y, at, damping)
        right = np.concatenate([at.error_by.swapaxes(1, 2), pull[..., None]], axis=2)
        solved = np.linalg.solve(matrix, right)
        toward, back = solved[..., :-1], solved[..., -1:]
        left = at.error[..., None] - at.error_by @ back
        multiplier = np.linalg.solve(at.error_by @ toward + LEAST_CURVATURE * np.eye(left.shape[1]), left)
        return -(toward @ multiplier + back).reshape(y.shape)

    def _without_errors(
        self, batch: MotionBatch, y: Array, at: Linearised, damping: float
    ) -> tuple[Array, Array]:
        """Gauss-Newton matrices (S, n m, n m) and half gradients (S, n m) of the loss less its errors."""
        s, n, m = y.shape
        matrix = at.by.swapaxes(1, 2) @ at.by
        pull = (at.residual[:, None] @ at.by)[:, 0] + self.penalties.smallness * y.reshape(s, n * m)
        matrix.reshape(s, -1)[:, :: n * m + 1] += damping + self.penalties.smallness
        found = self._limit_terms(batch, y)
        blocks = matrix.reshape(s, n, m, n, m)
        for joint in range(n):
            blocks[:, joint, :, joint] += found.curvature[:, joint]
        return matrix, pull + found.gradient

    def _limit_terms(self, batch: MotionBatch, y: Array) -> LimitTerms:
        """Half the gradient and the curvature of the limits' penalty."""
        over, sign = self._relative(batch, y, self._share)
        over = np.maximum(over, 0.0)
        weight = self.penalties.limits / over.shape[2]
        by = batch.samples_by  # (3, S, P, m)
        scaled = weight * over * sign / self._half  # (3, S, P, n)
        gradient = (scaled.swapaxes(2, 3) @ by).sum(axis=0)
        active = weight * (over > 0.0) / self._half**2
        square = (by[..., :, None] * by[..., None, :]).reshape(*by.shape[:3], -1)
        curvature = (active.swapaxes(2, 3) @ square).sum(axis=0)
        m = by.shape[3]
        return LimitTerms(gradient.reshape(len(y), -1), curvature.reshape(*y.shape[:2], m, m))

    def _relative(self, batch: MotionBatch, y: Array, share: Array | float) -> tuple[Array, Array]:
        """Ratios to limits beyond a share, and signs, (3, S, P, n)."""
        relative = (batch.samples(y) - self._centre) / self._half
        return np.abs(relative) - share, np.sign(relative)
