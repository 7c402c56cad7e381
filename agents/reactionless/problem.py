"""What a reactionless planner is asked, what it answers, and why it may refuse."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from enum import StrEnum
from typing import Self

import numpy as np

from space_envs.dynamics.floating import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, positive


@dataclass(frozen=True, eq=False)
class Capture:
    """Bring both end-effectors to their goals at a given time, from rest.

    The frame is inertial: the base frame at t = 0, whose attitude the base keeps. A robot in the plane z = 0
    has goals in that plane.

    Attributes:
        start: (n,) joint angles at t = 0, rad.
        duration: T, s.
        position: (2, 3) of the end-effectors at T, m. velocity: (2, 3) of the end-effectors at T, m/s.
        axis: (2, 3) approach axes at T, unit vectors, or None if they are free.
    """

    start: Array
    duration: float
    position: Array
    velocity: Array
    axis: Array | None = None

    def checked(self, robot: FloatingRobot) -> Self:
        """The same as float64 arrays, axes of unit length.

        Raises:
            ConfigurationError: if a shape is wrong, a number is not finite, the duration is not positive or
                an axis is zero.
        """
        tips = len(robot.tip_link)
        axis = None
        if self.axis is not None:
            axis = _array("axis", self.axis, (tips, 3))
            length = np.sqrt((axis * axis).sum(axis=-1, keepdims=True))
            if not (length > 0.0).all():
                raise ConfigurationError(f"axis must not be zero, got {self.axis!r}")
            axis = axis / length
        return replace(
            self,
            start=_array("start", self.start, (robot.n_joints,)),
            duration=positive("duration", self.duration),
            position=_array("position", self.position, (tips, 3)),
            velocity=_array("velocity", self.velocity, (tips, 3)),
            axis=axis,
        )


@dataclass(frozen=True, eq=False)
class Limits:
    """Bounds that a plan keeps; None leaves a quantity free.

    Attributes:
        position: (n, 2) rad, lowest and highest.
        rate: rad/s. acceleration: rad/s^2. torque: N m. Each for every joint.
        control: rad/s, of the length of zeta, the null-space part of the end-effectors' angular velocities.
    """

    position: Array | None = None
    rate: float | None = None
    acceleration: float | None = None
    torque: float | None = None
    control: float | None = None


class Cause(StrEnum):
    """Why there is no plan."""

    SINGULAR = "singular"  # the velocities asked for are out of reach of finite joint rates
    OUT_OF_REACH = "out_of_reach"  # no posture has the end-effectors at their goals
    INFEASIBLE = "infeasible"  # the bounds leave no motion
    JOINT_LIMIT = "joint_limit"  # the motion is fixed by the method, and leaves the bounds
    COLLISION = "collision"  # the motion touches what it must not
    SOLVER = "solver"  # the optimiser stopped without a solution
    INACCURATE = "inaccurate"  # the motion found misses what was asked, as measured independently


@dataclass(frozen=True)
class Failure:
    """No plan, and why: `reason` is a sentence that says what, when and how much."""

    method: str
    cause: Cause
    reason: str


@dataclass(frozen=True, eq=False)
class Plan:
    """A joint motion from t = 0 to T that does not turn the base.

    Attributes:
        method: name of the planner.
        time: (K,) s, increasing, from 0 to T; not always even.
        position, rate, acceleration: (K, n) rad, rad/s, rad/s^2.
        energy: C = integral of thetadot' M* thetadot dt over the motion, J s (eq. 15).
        zeta: (K, 2) rad/s, the null-space part of the dependent angular velocities (eq. 9 of shah2013), or
            None if the method has none.
        violation: what the motion misses by name, measured densely between its nodes by code that no planner
            uses; empty until it is measured.
        notes: how it was found, where there is something to say.
    """

    method: str
    time: Array
    position: Array
    rate: Array
    acceleration: Array
    energy: float
    zeta: Array | None = None
    violation: Mapping[str, float] = field(default_factory=dict)
    notes: str = ""

    def sample(self, times: Array) -> tuple[Array, Array, Array]:
        """Position, rate and acceleration (..., n) at `times` (...,) s, by quintic Hermite interpolation.

        Times beyond the ends count as the ends. Rate and acceleration are the exact derivatives of position.
        """
        times = np.clip(np.asarray(times, dtype=np.float64), self.time[0], self.time[-1])
        left = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, len(self.time) - 2)
        h = (self.time[left + 1] - self.time[left])[..., None]
        s = (times - self.time[left])[..., None] / h
        start, end = (
            (self.position[i], h * self.rate[i], h * h * self.acceleration[i]) for i in (left, left + 1)
        )
        # Coefficients of the quintic whose value, slope and curvature are given at s = 0 and s = 1.
        jump = end[0] - start[0] - start[1] - 0.5 * start[2]
        slope = end[1] - start[1] - start[2]
        curve = end[2] - start[2]
        c3 = 10.0 * jump - 4.0 * slope + 0.5 * curve
        c4 = -15.0 * jump + 7.0 * slope - curve
        c5 = 6.0 * jump - 3.0 * slope + 0.5 * curve
        position = start[0] + s * (start[1] + s * (0.5 * start[2] + s * (c3 + s * (c4 + s * c5))))
        rate = start[1] + s * (start[2] + s * (3.0 * c3 + s * (4.0 * c4 + s * 5.0 * c5)))
        acceleration = start[2] + s * (6.0 * c3 + s * (12.0 * c4 + s * 20.0 * c5))
        return position, rate / h, acceleration / (h * h)


def _array(name: str, value: Array, shape: tuple[int, ...]) -> Array:
    try:
        array = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise ConfigurationError(f"{name} must be an array of numbers, got {value!r}") from None
    if array.shape != shape or not np.isfinite(array).all():
        raise ConfigurationError(f"{name} must be finite and of shape {shape}, got {value!r}")
    return array
