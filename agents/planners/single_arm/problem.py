"""Problems and plans of the single arm's optimal planners."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np

from agents.planners.common.plans import JointPath
from space_envs.checks import finite_array, flag, non_negative
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, positive


@dataclass(frozen=True, eq=False)
class Reach:
    """Bring the end-effector to rest at an inertial pose at a given time, at the least cost by eq. 20.

    The frame is inertial: the base frame at t = 0. Total momentum is zero.

    Attributes:
        start: (n,) joint angles at t = 0, rad. rate: (n,) joint rates at t = 0, rad/s; None for rest.
        position: (3,) of the end-effector at T, m. quaternion: (4,) w x y z, end-effector to inertial at T.
        duration: T, s.
        keep_attitude: whether the base has its initial attitude at T; it is unconstrained otherwise.
        c: angular to linear conversion of eq. 20, m/rad.
        spheres: (K, 4) centre m and radius m of keep-out spheres, inertial frame; None for none.
        link_radius: m, of the links, which are capsules from joint to joint, in checks against spheres: (n,),
            or one for all.
    """

    start: Array
    position: Array
    quaternion: Array
    duration: float = 10.0
    rate: Array | None = None
    keep_attitude: bool = False
    c: float = 1.0
    spheres: Array | None = None
    link_radius: Array | float = 0.0

    def checked(self, robot: FloatingRobot) -> Self:
        """Return a copy with float64 arrays and a unit quaternion.

        Raises:
            ConfigurationError: if a shape is wrong, a number is not finite, the duration, c or a sphere's
                radius is not positive, the links' radius is negative, the quaternion is zero, or
                keep_attitude is no flag.
        """
        n = robot.n_joints
        quaternion = finite_array("quaternion", self.quaternion, (4,))
        if not (length := float(np.linalg.norm(quaternion))) > 0.0:
            raise ConfigurationError(f"quaternion must not be zero, got {self.quaternion!r}")
        spheres = self.spheres
        if spheres is not None:
            spheres = finite_array("spheres", spheres, (None, 4))
            if not (spheres[:, 3] > 0.0).all():
                raise ConfigurationError(f"radii of spheres must be positive, got {spheres[:, 3].tolist()}")
        return replace(
            self,
            start=finite_array("start", self.start, (n,)),
            rate=np.zeros(n) if self.rate is None else finite_array("rate", self.rate, (n,)),
            position=finite_array("position", self.position, (3,)),
            quaternion=quaternion / length,
            duration=positive("duration", self.duration),
            keep_attitude=flag("keep_attitude", self.keep_attitude),
            c=positive("c", self.c),
            spheres=spheres,
            link_radius=_radii(self.link_radius, n),
        )


def _radii(value: Array | float, n: int) -> Array:
    """Radii (n,) of links; ConfigurationError for another shape or negative numbers."""
    if np.ndim(value) == 0:
        return np.full(n, non_negative("link_radius", value))
    radii = finite_array("link_radius", value, (n,))
    if (radii < 0.0).any():
        raise ConfigurationError(f"link_radius must not be negative, got {radii.tolist()}")
    return radii


@dataclass(frozen=True, eq=False)
class ReachPlan(JointPath):
    """A joint motion that ends with the end-effector at its goal.

    Attributes:
        cost: integral of c^2 w.w + v.v over the motion, m^2/s (eq. 20 of shyam2020 times dt).
        violation: errors and violations by name, measured on a dense grid by independent code (`check.py`);
            empty before that.
        notes: how the motion was found.
    """

    cost: float
    violation: Mapping[str, float] = field(default_factory=dict)
    notes: str = ""
