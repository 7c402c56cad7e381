"""Limits of a robot on paths: the duration that they ask for, and how near a path comes to them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.plans import Limits
from agents.planners.single_arm.reactionless.clearances import Clearance
from agents.planners.single_arm.reactionless.paths import PathSpace, Samples, Sensitivities
from space_envs.dynamics.rotations import Array

ANGLE_MARGIN = 0.02  # rad, to the ends of joint ranges, of the search
LEAST_ROOM = 1e-3  # rad, to the end of a range, that the braking law counts with
ANGLE_SCALE = 0.1  # rad, by which an angle beyond its range counts as a rate at twice its limit does


@dataclass(frozen=True, eq=False)
class PathLimits:
    """Limits on paths at any timing.

    Attributes:
        limits: of plans. deceleration: (n,) rad/s^2, with which the drives brake joints before the ends of
            their ranges; None if they do not. clearances: that paths keep.
    """

    limits: Limits
    deceleration: Array | None = None
    clearances: tuple[Clearance, ...] = ()

    def duration(self, space: PathSpace, path: Samples) -> dict[str, float]:
        """Shortest durations, s, by the limit that asks for them; those without a limit are absent."""
        limits, found = self.limits, {}
        fastest = self._fastest(path)[0]
        found["rate"] = float((np.abs(path.slope) / fastest).max())
        if limits.acceleration is not None:
            found["acceleration"] = float(np.sqrt((np.abs(path.curve) / limits.acceleration).max()))
        still = np.zeros_like(path.curve)
        for name, curve in (("torque", path.curve), ("coriolis", still)):
            if (limit := getattr(limits, name)) is not None:
                (torque,) = space.arm.torque(path.angle, path.slope, curve)
                found[name] = float(np.sqrt((np.abs(torque) / limit).max()))
        return found

    def beyond(self, path: Samples) -> float:
        """Largest angle beyond its range, rad, negative inside."""
        return float(self.limits.beyond_angles(path.angle).max())

    def shares(
        self, path: Samples, by: Sensitivities, duration: float, least: float
    ) -> tuple[Array, Array, NDArray[np.intp]]:
        """Rates and accelerations at a duration in s as shares (k,) of their limits, those above the least.

        Returns:
            The shares, their derivatives (k, m) and their places (k,) among the samples.
        """
        fastest, falls = self._fastest(path)
        rate = np.abs(path.slope) / (duration * fastest)
        at = np.nonzero(rate > least)
        slope = (np.sign(path.slope[at]) / (duration * fastest[at]))[:, None] * by.slope[at]
        slope -= (rate[at] * falls[at] / fastest[at])[:, None] * by.angle[at]
        if self.limits.acceleration is None:
            return rate[at], slope, at[0]
        acceleration = np.abs(path.curve) / (scale := duration**2 * self.limits.acceleration)
        where = np.nonzero(acceleration > least)
        curved = (np.sign(path.curve) / scale)[where][:, None] * by.curve[where]
        shares = np.concatenate([rate[at], acceleration[where]])
        return shares, np.concatenate([slope, curved]), np.concatenate([at[0], where[0]])

    def violations(self, path: Samples, by: Sensitivities) -> tuple[Array, Array]:
        """Angles beyond their ranges and clearances missing (k,), positive ones alone, with slopes (k, m)."""
        limit = self.limits.angles(path.angle.shape[1])
        low, high = limit[:, 0] + ANGLE_MARGIN - path.angle, path.angle - limit[:, 1] + ANGLE_MARGIN
        beyond = np.maximum(low, high)
        time, joint = np.nonzero(beyond > 0.0)
        sign = np.where(high > low, 1.0, -1.0)[time, joint]
        value, slope = beyond[time, joint] / ANGLE_SCALE, sign[:, None] * by.angle[time, joint] / ANGLE_SCALE
        found = [(value, slope), *(clearance.violations(path, by) for clearance in self.clearances)]
        values, slopes = zip(*found, strict=True)
        return np.concatenate(values), np.concatenate(slopes)

    def _fastest(self, path: Samples) -> tuple[Array, Array]:
        """Largest rates (M + 1, n), rad/s, in the direction of motion, and their slopes by the angle."""
        limit = np.full(path.angle.shape, np.inf if self.limits.rate is None else self.limits.rate)
        if self.deceleration is None:
            return limit, np.zeros_like(limit)
        low, high = self.limits.angles(path.angle.shape[1]).T
        falling = path.slope < 0.0
        room = np.where(falling, path.angle - low, high - path.angle)
        braking = np.sqrt(2.0 * self.deceleration * np.maximum(room, LEAST_ROOM))
        falls = np.where(falling, 1.0, -1.0) * self.deceleration / braking
        return np.minimum(braking, limit), np.where(braking < limit, falls, 0.0)
