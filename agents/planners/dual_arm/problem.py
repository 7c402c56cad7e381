"""Problems and plans of the reactionless planners of two arms."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from agents.planners.common.plans import JointPath
from space_envs.checks import finite_array, flag
from space_envs.dynamics.floating import FloatingRobot
from space_envs.dynamics.grapples import Grapple, PoseTwist
from space_envs.dynamics.reactionless import axis_rotation
from space_envs.dynamics.rotations import Array, exponential, z_axis
from space_envs.errors import ConfigurationError, positive, shown

_Z = np.array([0.0, 0.0, 1.0])


@dataclass(frozen=True, eq=False)
class Capture:
    """Bring both end-effectors to their grapples, as fast as these, at a given time, from rest.

    The frame is inertial: the base frame at t = 0, whose attitude the base keeps. Grapples of a planar robot
    are in the plane z = 0.

    Attributes:
        start: (n,) joint angles at t = 0, rad.
        duration: T, s.
        goals: grapples (2) of the arms, as functions of time; their z axes are those of approach.
        aligned: whether the approach axes have to be those of the grapples at T; otherwise any will do.
    """

    start: Array
    duration: float
    goals: Grapple
    aligned: bool = False

    @classmethod
    def at_end(
        cls, start: Array, duration: float, position: Array, velocity: Array, axis: Array | None = None
    ) -> Self:
        """A capture of grapples that move straight.

        Args:
            position, velocity: (2, 3) at T, m and m/s. axis: (2, 3) of approach, of any length; None for any.

        Raises:
            ConfigurationError: if a shape is wrong, a number is not finite, or an axis is zero.
        """
        position = finite_array("position", position, (None, 3))
        velocity = finite_array("velocity", velocity, position.shape)
        attitude = axis_attitude(_Z if axis is None else _directions(axis, position.shape))
        body = PoseTwist(position, attitude, velocity, np.zeros(3))
        goals = Grapple.on_body(body, np.ones(3), position, attitude).after(-duration)
        return cls(start, duration, goals, axis is not None)

    @cached_property
    def _end(self) -> PoseTwist:
        return self.goals.at(self.duration)

    @property
    def position(self) -> Array:
        """Positions (2, 3) of the end-effectors at T, m."""
        return self._end.position

    @property
    def velocity(self) -> Array:
        """Velocities (2, 3) of the end-effectors at T, m/s."""
        return self._end.linear_velocity

    @property
    def axis(self) -> Array | None:
        """Approach axes (2, 3) at T, unit vectors, or None for any."""
        return z_axis(self._end.quaternion) if self.aligned else None

    def checked(self, robot: FloatingRobot) -> Self:
        """Return a copy with float64 arrays and unit quaternions.

        Raises:
            ConfigurationError: if a shape is wrong, a number is not finite, the duration is not positive, the
                goals are no valid grapples, or aligned is no flag.
        """
        if not isinstance(self.goals, Grapple):
            raise ConfigurationError(f"goals must be a Grapple, got {shown(self.goals)}")
        return replace(
            self,
            start=finite_array("start", self.start, (robot.n_joints,)),
            duration=positive("duration", self.duration),
            goals=self.goals.checked(len(robot.end_effector_link)),
            aligned=flag("aligned", self.aligned),
        )


def _directions(axis: Array, shape: tuple[int, ...]) -> Array:
    """Unit vectors of a shape along axes of any length; ConfigurationError for NaN or zero."""
    axis = finite_array("axis", axis, shape)
    length = np.sqrt((axis * axis).sum(axis=-1, keepdims=True))
    if not (length > 0.0).all():
        raise ConfigurationError(f"axis must not be zero, got {axis.tolist()}")
    return axis / length


def axis_attitude(axis: Array) -> Array:
    """Attitudes (..., 4) w x y z with z axes (..., 3), unit vectors, by the smallest rotation."""
    return exponential(axis_rotation(np.broadcast_to(_Z, axis.shape), axis))


@dataclass(frozen=True, eq=False)
class CapturePlan(JointPath):
    """A joint motion from t = 0 to T that does not rotate the base.

    Attributes:
        energy: C = integral of thetadot' M* thetadot dt over the motion, J s (eq. 15).
        zeta: (K, 2) rad/s, the null-space part of the dependent angular velocities (eq. 9 of shah2013), or
            None if the method has none.
        violation: errors and violations by name, measured on a dense grid by independent code; empty before
            that.
        notes: how the motion was found.
    """

    energy: float
    zeta: Array | None = None
    violation: Mapping[str, float] = field(default_factory=dict)
    notes: str = ""
