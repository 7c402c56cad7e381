"""Problems and plans of the reactionless planners of two arms."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from agents.planners.common.plans import JointPath
from space_envs.checks import finite_array
from space_envs.dynamics.floating import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, positive


@dataclass(frozen=True, eq=False)
class Capture:
    """Bring both end-effectors to their goals at a given time, from rest.

    The frame is inertial: the base frame at t = 0, whose attitude the base keeps. Goals of a planar robot are
    in the plane z = 0.

    Attributes:
        start: (n,) joint angles at t = 0, rad.
        duration: T, s.
        position: (2, 3) of the end-effectors at T, m. velocity: (2, 3) of the end-effectors at T, m/s.
        axis: (2, 3) approach axes at T, unit vectors, or None for any.
    """

    start: Array
    duration: float
    position: Array
    velocity: Array
    axis: Array | None = None

    def checked(self, robot: FloatingRobot) -> Self:
        """Return a copy with float64 arrays and axes of unit length.

        Raises:
            ConfigurationError: if a shape is wrong, a number is not finite, the duration is not positive or
                an axis is zero.
        """
        arms = len(robot.end_effector_link)
        axis = None
        if self.axis is not None:
            axis = finite_array("axis", self.axis, (arms, 3))
            length = np.sqrt((axis * axis).sum(axis=-1, keepdims=True))
            if not (length > 0.0).all():
                raise ConfigurationError(f"axis must not be zero, got {self.axis!r}")
            axis = axis / length
        return replace(
            self,
            start=finite_array("start", self.start, (robot.n_joints,)),
            duration=positive("duration", self.duration),
            position=finite_array("position", self.position, (arms, 3)),
            velocity=finite_array("velocity", self.velocity, (arms, 3)),
            axis=axis,
        )


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
