"""Limits of joint motions, joint paths, and typed failures of planners."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Self

import numpy as np

from space_envs.checks import finite_array, real_array
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, positive, shown

JOINT_LIMITS = ("rate", "acceleration", "torque", "coriolis")


@dataclass(frozen=True, eq=False)
class Limits:
    """Bounds on a plan; None leaves a quantity unbounded.

    Bounds are checked at construction: finite positive numbers, and angles from lowest to highest, where
    infinity leaves a joint unbounded. Raises ConfigurationError that names the bound.

    Attributes:
        position: (n, 2) rad, lowest and highest.
        rate: rad/s. acceleration: rad/s^2. torque: N m. Each (n,), or one number for every joint, () then.
        coriolis: N m, of the torque that the rates alone require of a joint, as the others; above it the
            drives slow the arm.
        control: rad/s, of the length of zeta, the null-space part of the end-effectors' angular velocities.
    """

    position: Array | None = None
    rate: Array | float | None = None
    acceleration: Array | float | None = None
    torque: Array | float | None = None
    coriolis: Array | float | None = None
    control: float | None = None

    def __post_init__(self) -> None:
        for name in JOINT_LIMITS:
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, _positive_array(f"limit of {name}", value))
        if self.control is not None:
            object.__setattr__(self, "control", positive("limit of control", self.control))
        if self.position is not None:
            position = real_array("limits of position", self.position, (None, 2))
            if not (position[:, 0] <= position[:, 1]).all():
                joint = int((position[:, 0] > position[:, 1]).argmax())
                raise ConfigurationError(
                    f"limits of position must run from lowest to highest, got {position[joint].tolist()} of "
                    f"joint {joint + 1}"
                )
            position.flags.writeable = False
            object.__setattr__(self, "position", position)

    def angles(self, n: int) -> Array:
        """Lowest and highest angles (n, 2) of n joints, rad; infinite without a limit."""
        return np.tile([-np.inf, np.inf], (n, 1)) if self.position is None else self.position

    def beyond_angles(self, q: Array) -> Array:
        """Distances (..., n) of joint angles (..., n) beyond their limits, rad, negative inside."""
        low, high = self.angles(q.shape[-1]).T
        return np.maximum(low - q, q - high)

    def excess(self, **values: Array) -> dict[str, float]:
        """Largest values beyond the limits, negative inside, by name; those without a limit are absent.

        Args:
            values: quantities by the names of their limits: `position` (..., n) rad, `rate`, ...
        """
        found = {}
        for name, value in values.items():
            limit = getattr(self, name)
            if limit is not None:
                beyond = self.beyond_angles(value) if name == "position" else np.abs(value) - limit
                found[name] = float(beyond.max())
        return found

    def checked(self, robot: FloatingRobot) -> Self:
        """Return the limits if they are for as many joints as a robot has.

        Raises:
            ConfigurationError: naming both numbers.
        """
        for name in ("position", *JOINT_LIMITS):
            shape = np.shape(getattr(self, name))
            if shape and shape[0] != robot.n_joints:
                raise ConfigurationError(
                    f"limits of {name} are of {shape[0]} joints, the robot has {robot.n_joints}"
                )
        return self


def in_words(limit: Array | float | None, unit: str) -> str:
    """A limit of all joints, or the least and the greatest of several, with its unit."""
    if limit is None:
        return f"any {unit}"
    least, greatest = float(np.min(limit)), float(np.max(limit))
    return f"{least:.4g} {unit}" if least == greatest else f"{least:.4g} to {greatest:.4g} {unit}"


def _positive_array(name: str, value: Any) -> Array:
    """A read-only array () or (n,) of positive finite numbers; ConfigurationError otherwise."""
    if not isinstance(value, np.ndarray | list | tuple) or np.shape(value) == ():
        numbers = np.array(positive(name, value))
    else:
        numbers = finite_array(name, value, (None,))
        if not (numbers.size and (numbers > 0.0).all()):
            raise ConfigurationError(f"{name} must be positive numbers, got {shown(value)}")
    numbers.flags.writeable = False
    return numbers


class Cause(StrEnum):
    """Reason why there is no plan."""

    SINGULAR = "singular"  # the required velocities need infinite joint rates
    OUT_OF_REACH = "out_of_reach"  # no configuration has the end-effectors at their goals
    INFEASIBLE = "infeasible"  # no motion satisfies the bounds
    JOINT_LIMIT = "joint_limit"  # the only motion of the method violates joint limits
    CLEARANCE = "clearance"  # the motion comes too close to an obstacle
    SOLVER = "solver"  # the optimiser stopped without a solution
    INACCURATE = "inaccurate"  # an independent check found errors beyond the tolerances


@dataclass(frozen=True)
class Failure:
    """A failed solve; planners, programs and solvers return it instead of a result.

    Attributes:
        method: name of the planner or solver. reason: a sentence with what failed, when and by how much.
        residual: largest remaining constraint violation, in the solver's units; infinite if unknown.
    """

    method: str
    cause: Cause
    reason: str
    residual: float = field(default=float("inf"), compare=False, repr=False)


def start_beyond_limits(method: str, start: Array, limits: Limits) -> Failure | None:
    """Failure if one of the joint angles (n,) at the start is beyond its limit."""
    beyond = limits.beyond_angles(start)
    if not beyond.max() > 0.0:
        return None
    joint = int(beyond.argmax()) + 1
    return Failure(method, Cause.JOINT_LIMIT, f"joint {joint} starts {beyond.max():.3f} rad beyond its limit")


@dataclass(frozen=True, eq=False)
class JointPath:
    """A joint motion from t = 0 to T: nodes with quintic interpolation in between.

    Attributes:
        method: name of the planner.
        time: (K,) s, increasing from 0 to T, not always evenly.
        position, rate, acceleration: (K, n) rad, rad/s, rad/s^2.
    """

    method: str
    time: Array
    position: Array
    rate: Array
    acceleration: Array

    def sample(self, times: Array) -> tuple[Array, Array, Array]:
        """Position, rate and acceleration (..., n) at `times` (...,) s, by quintic Hermite interpolation.

        Times are clipped to [0, T]. Rate and acceleration are the exact derivatives of position.
        """
        times = np.clip(np.asarray(times, dtype=np.float64), self.time[0], self.time[-1])
        index = np.clip(np.searchsorted(self.time, times, side="right") - 1, 0, len(self.time) - 2)
        h = (self.time[index + 1] - self.time[index])[..., None]
        s = (times - self.time[index])[..., None] / h
        start, end = (
            (self.position[i], h * self.rate[i], h * h * self.acceleration[i]) for i in (index, index + 1)
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
