"""Limits of a robot on paths: the duration that they ask for, and how near a path comes to them."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.plans import Limits
from agents.planners.single_arm.reactionless.clearances import Clearance
from agents.planners.single_arm.reactionless.paths import PathSpace, Samples, Sensitivities
from space_envs.dynamics.rotations import Array

Indices = NDArray[np.intp]

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

    def shares(self, path: Samples, duration: float) -> Array:
        """Rates and accelerations (M + 1, 2 n) at a duration in s as shares of their limits."""
        rate = np.abs(path.slope) / (duration * self._fastest(path)[0])
        if self.limits.acceleration is None:
            return rate
        return np.concatenate([rate, np.abs(path.curve) / (duration**2 * self.limits.acceleration)], axis=1)

    def share_slopes(
        self, path: Samples, by: Sensitivities, duration: float, time: Indices, place: Indices
    ) -> Array:
        """Derivatives (k, m) of some of them, given by their places among the shares."""
        n = path.angle.shape[1]
        rates, joint = place < n, place % n
        fastest, falls = self._fastest(path)
        at, fast = (time[rates], joint[rates]), fastest[time[rates], joint[rates]]
        rate = np.abs(path.slope[at]) / (duration * fast)
        by_rate = (np.sign(path.slope[at]) / (duration * fast))[:, None] * by.slope[at]
        by_rate -= (rate * falls[at] / fast)[:, None] * by.angle[at]
        out = np.empty((len(time), by.slope.shape[2]))
        out[rates] = by_rate
        if not rates.all():
            at = time[~rates], joint[~rates]
            scale = np.broadcast_to(duration**2 * self.limits.acceleration, path.curve.shape)[at]
            out[~rates] = (np.sign(path.curve[at]) / scale)[:, None] * by.curve[at]
        return out

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
