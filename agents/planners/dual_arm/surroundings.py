"""Obstacles of the two arms: each other, the satellite's body and a moving target."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from scipy.interpolate import CubicHermiteSpline

from space_envs.checks import count, finite_array, flag, non_negative
from space_envs.dynamics.rigid_body import tumble
from space_envs.dynamics.rotations import Array, multiply
from space_envs.errors import ConfigurationError, positive

TargetMotion = Callable[[Array], tuple[Array, Array]]
"""Times (K,) s from the start of the plan -> centre (K, 3) m and quaternion (K, 4) of the target, inertial
frame, with the system's centre of mass at the origin at time 0."""
_GRID = 0.5  # s, between attitudes of a rotating target that are interpolated


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Obstacles of the arms and clearances from them.

    Attributes:
        radius: m, of the links.
        margin: m, least clearance of plans between surfaces.
        arms: whether the arms are obstacles to each other.
        bus: (3,) m, half sides of the satellite's box; None for no obstacle, as for planar arms, which
            rotate in a plane in front of the satellite's deck. bus_centre: (3,) m, of that box in the base
            frame.
        standing: number of links at the root of each arm that may touch the satellite.
        target: (3,) m, half sides of the target's box; None for no target.
        motion: of the target.
        gripper: m, outer part of the last link that counts by its centre line only where it grapples the
            target.
        contact: s before the end at which the gripper begins to open: the length of that part increases
            linearly from 0 to `gripper` until half of this time before the end.
    """

    radius: float = 0.05
    margin: float = 0.02
    arms: bool = True
    bus: Array | None = None
    bus_centre: Array = field(default_factory=lambda: np.zeros(3))
    standing: int = 2
    target: Array | None = None
    motion: TargetMotion | None = None
    gripper: float = 0.15
    contact: float = 4.0

    def __post_init__(self) -> None:
        positive("radius of the links", self.radius)
        for name in ("margin", "gripper", "contact"):
            non_negative(name, getattr(self, name))
        flag("arms", self.arms)
        count("standing", self.standing, 100)
        object.__setattr__(self, "bus_centre", finite_array("bus_centre", self.bus_centre, (3,)))
        for name in ("bus", "target"):
            sides = getattr(self, name)
            if sides is not None:
                sides = finite_array(f"half sides of {name}", sides, (3,))
                if not (sides > 0.0).all():
                    raise ConfigurationError(f"{name} must be three positive half sides, got {sides!r}")
                object.__setattr__(self, name, sides)
        if (self.target is None) != (self.motion is None):
            raise ConfigurationError("a target needs half sides and a motion, or neither")
        if self.motion is not None and not callable(self.motion):
            raise ConfigurationError(f"motion must be a function of times, got {self.motion!r}")

    def counted(self, length: Array, time: Array, duration: float) -> Array:
        """Fraction (K, S) of last links of `length` (S,) m that counts with its radius at times (K,) s."""
        if self.contact == 0.0:
            return np.ones((len(time), len(length)))
        open_part = np.clip(2.0 * ((time - duration) / self.contact + 1.0), 0.0, 1.0)
        return np.maximum(1.0 - open_part[:, None] * self.gripper / length, 0.0)


def tumbling_target(
    centre: Array, quaternion: Array, angular_velocity: Array, inertia: Array, at: float = 0.0
) -> TargetMotion:
    """Motion of a torque-free target whose centre is at rest.

    Args:
        centre: (3,) m. quaternion: (4,), body to inertial. angular_velocity: (3,) rad/s, inertial axes.
        inertia: (3,) principal moments. at: s, time of the given attitude and angular velocity.
    """

    def attitudes(times: Array) -> Array:
        """Attitudes at times all before or all after `at`, by Hermite interpolation of a coarse grid."""
        far = times[np.abs(times - at).argmax()] - at
        count = max(int(np.ceil(abs(far) / _GRID)), 1)
        grid = far * np.arange(count + 1) / count
        attitude, spin = tumble(np.asarray(quaternion), np.asarray(angular_velocity), inertia, grid)
        pure = np.concatenate([np.zeros((count + 1, 1)), spin], axis=1)
        slope = 0.5 * multiply(pure, attitude)
        order = slice(None) if far > 0.0 else slice(None, None, -1)
        found = CubicHermiteSpline(grid[order], attitude[order], slope[order])(times - at)
        return found / np.linalg.norm(found, axis=1, keepdims=True)

    def motion(times: Array) -> tuple[Array, Array]:
        times = np.asarray(times, dtype=np.float64)
        attitude = np.tile(np.asarray(quaternion, dtype=np.float64), (len(times), 1))
        for part in (times > at, times < at):
            if part.any():
                attitude[part] = attitudes(times[part])
        return np.broadcast_to(centre, (len(times), 3)), attitude

    return motion
