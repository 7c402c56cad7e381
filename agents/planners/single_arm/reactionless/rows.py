"""Inequalities that hold at every sample of a path: rows of a search, one class for each kind of limit."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from agents.planners.single_arm.reactionless.paths import Index, Quantity, Samples, Sensitivities
from agents.planners.single_arm.weights.functions import ArmFunctions
from space_envs.dynamics.rotations import Array

Places = tuple[Index, ...]
"""Indices (k,) of rows among the values of one kind, the sample first."""

ANGLE_MARGIN = 0.02  # rad, to the ends of joint ranges
ANGLE_SCALE = 0.3  # rad beyond its range that count as much as a rate at twice its limit
LEAST_ROOM = 1e-3  # rad, to the end of a range, that the braking law counts with


class PathRows(Protocol):
    """Inequalities of one kind along a path."""

    def excess(self, path: Samples) -> Array:
        """Values (M + 1, ...) at the samples, as shares of a scale; positive ones violate the limit."""
        ...

    def slopes(self, path: Samples, by: Sensitivities, at: Places) -> Array:
        """Derivatives (k, m) of the values at some places by the weights."""
        ...


@dataclass(frozen=True, eq=False)
class BrakingLimit:
    """Largest rates of joints, also those from which the drives brake them before the ends of their ranges.

    Attributes:
        rate: (n,) rad/s, or one for all, infinite without a limit. deceleration: (n,) rad/s^2 of the braking
            law; None without one. ranges: (n, 2) rad.
    """

    rate: Array
    deceleration: Array | None
    ranges: Array

    def fastest(self, path: Samples) -> tuple[Array, Array]:
        """Largest rates (M + 1, n), rad/s, in the direction of motion, and their slopes by the angle."""
        limit = np.full(path.angle.shape, self.rate)
        if self.deceleration is None:
            return limit, np.zeros_like(limit)
        low, high = self.ranges.T
        falling = path.slope < 0.0
        room = np.where(falling, path.angle - low, high - path.angle)
        braking = np.sqrt(2.0 * self.deceleration * np.maximum(room, LEAST_ROOM))
        falls = np.where(falling, 1.0, -1.0) * self.deceleration / braking
        return np.minimum(braking, limit), np.where(braking < limit, falls, 0.0)


@dataclass(frozen=True, eq=False)
class RateRows:
    """Rates of a path at a duration in s keep below their limits."""

    braking: BrakingLimit
    duration: float

    def excess(self, path: Samples) -> Array:
        """Values (M + 1, n) at the samples."""
        return np.abs(path.slope) / (self.duration * self.braking.fastest(path)[0]) - 1.0

    def slopes(self, path: Samples, by: Sensitivities, at: Places) -> Array:
        """Derivatives (k, m) of the values at some places."""
        fastest, falls = (values[at] for values in self.braking.fastest(path))
        rate = path.slope[at]
        slope = (np.sign(rate) / (self.duration * fastest))[:, None] * by.between("slope", at[0], at[1])
        braked = np.flatnonzero(falls)
        time, joint = (places[braked] for places in at)
        change = (np.abs(rate) * falls / (self.duration * fastest**2))[braked]
        slope[braked] -= change[:, None] * by.between("angle", time, joint)
        return slope


@dataclass(frozen=True, eq=False)
class AccelerationRows:
    """Accelerations of a path at a duration in s keep below their limits (n,), rad/s^2."""

    limit: Array
    duration: float

    def excess(self, path: Samples) -> Array:
        """Values (M + 1, n) at the samples."""
        return np.abs(path.curve) / (self.duration**2 * self.limit) - 1.0

    def slopes(self, path: Samples, by: Sensitivities, at: Places) -> Array:
        """Derivatives (k, m) of the values at some places."""
        scale = np.broadcast_to(self.duration**2 * self.limit, path.curve.shape)
        return (np.sign(path.curve) / scale)[at][:, None] * by.between("curve", at[0], at[1])


@dataclass(frozen=True, eq=False)
class TorqueRows:
    """Torques of a path at a duration in s keep below their limits (n,), N m.

    They are of second degree in rates. Without accelerations they are those that the rates alone require.
    """

    arm: ArmFunctions
    limit: Array
    duration: float
    accelerated: bool = True

    def excess(self, path: Samples) -> Array:
        """Values (M + 1, n) at the samples."""
        (torque,) = self.arm.torque(path.angle, path.slope, self._curve(path))
        return np.abs(torque) / (self.duration**2 * self.limit) - 1.0

    def slopes(self, path: Samples, by: Sensitivities, at: Places) -> Array:
        """Derivatives (k, m) of the values at some places."""
        (time, joint), n = at, path.angle.shape[1]
        if not len(time):
            return np.zeros((0, by.angle.shape[2]))
        curve = self._curve(path)
        (torque,) = self.arm.torque(path.angle, path.slope, curve)
        scale = np.broadcast_to(self.duration**2 * self.limit, torque.shape)
        weight = np.zeros((len(time), n))
        weight[np.arange(len(time)), joint] = (np.sign(torque) / scale)[at]
        (slope,) = self.arm.torque_slope(path.angle[time], path.slope[time], curve[time], weight)
        names: tuple[Quantity, ...] = ("angle", "slope", "curve") if self.accelerated else ("angle", "slope")
        moved = np.concatenate([by.between_all(name, time) for name in names], axis=1)  # (k, 3 n, m)
        return (slope[:, None, : moved.shape[1]] @ moved)[:, 0]

    def _curve(self, path: Samples) -> Array:
        return path.curve if self.accelerated else np.zeros_like(path.curve)


@dataclass(frozen=True, eq=False)
class AngleRows:
    """Angles of a path keep a margin to the ends of their ranges (n, 2), rad."""

    ranges: Array

    def excess(self, path: Samples) -> Array:
        """Values (M + 1, n) at the samples."""
        low, high = self.ranges.T
        return (np.maximum(low - path.angle, path.angle - high) + ANGLE_MARGIN) / ANGLE_SCALE

    def slopes(self, path: Samples, by: Sensitivities, at: Places) -> Array:
        """Derivatives (k, m) of the values at some places."""
        low, high = self.ranges.T
        sign = np.where(path.angle - high > low - path.angle, 1.0, -1.0)[at]
        return (sign / ANGLE_SCALE)[:, None] * by.between("angle", at[0], at[1])
