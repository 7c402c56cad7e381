"""Grapples on bodies that move freely: their pose and twist as functions of time."""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from space_envs.checks import finite_array, numbers
from space_envs.dynamics.rigid_body import point_motion, tumble
from space_envs.dynamics.rotations import Array, conjugate, multiply, rotate
from space_envs.errors import ConfigurationError

_ANGLE = 0.05  # rad, by which a body rotates at most in a step of the integration
_IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


class PoseTwist(NamedTuple):
    """Pose and twist of grapples or bodies in an inertial frame.

    Attributes:
        position: (..., 3) m. quaternion: (..., 4) w x y z, body to frame.
        linear_velocity, angular_velocity: (..., 3) m/s and rad/s in the frame's axes.
    """

    position: Array
    quaternion: Array
    linear_velocity: Array
    angular_velocity: Array

    @property
    def twist(self) -> Array:
        """Twists (..., 6) [v; w], m/s and rad/s."""
        return np.concatenate([self.linear_velocity, self.angular_velocity], axis=-1)


@dataclass(frozen=True, eq=False)
class Grapple:
    """A grapple, or a batch (...) of them, fixed to a rigid body on which no force or torque acts.

    The frame is any inertial one. The body's axes are its principal axes.

    Attributes:
        centre: (..., 3) of the body's centre of mass at t = 0, m.
        attitude: (..., 4) w x y z, body to frame at t = 0.
        linear_velocity: (..., 3) of the centre of mass, m/s.
        angular_velocity: (..., 3) of the body at t = 0, rad/s in the frame's axes.
        inertia: (3,) principal moments; only their ratios matter.
        offset: (..., 3) of the grapple from the centre of mass, m in the body's axes.
        orientation: (..., 4) w x y z, grapple to body.
    """

    centre: Array
    attitude: Array
    linear_velocity: Array
    angular_velocity: Array
    inertia: Array
    offset: Array
    orientation: Array

    @classmethod
    def at_rest(cls, position: ArrayLike, quaternion: ArrayLike) -> Self:
        """Grapples at rest at positions (..., 3) m with attitudes (..., 4) w x y z, grapple to frame."""
        still = np.zeros(np.shape(position))
        pose = np.asarray(position, dtype=np.float64), np.asarray(quaternion, dtype=np.float64)
        return cls(*pose, still, still, np.ones(3), still, _IDENTITY)

    @classmethod
    def on_body(cls, body: PoseTwist, inertia: Array, position: Array, quaternion: Array) -> Self:
        """Grapples at a pose at t = 0 that move with a body of which pose and twist at t = 0 are known.

        Args:
            body: of its centre of mass and principal axes. inertia: (3,) principal moments.
            position: (..., 3) m. quaternion: (..., 4) w x y z, grapple to frame.
        """
        back = conjugate(body.quaternion)
        offset = rotate(back, position - body.position)
        return cls(*body, inertia, offset, multiply(back, quaternion))

    @cached_property
    def moves(self) -> bool:
        """Whether any of the grapples moves."""
        return bool(np.any(self.linear_velocity) or np.any(self.angular_velocity))

    def at(self, times: ArrayLike) -> PoseTwist:
        """Pose and twist (..., T, ·) at times (T,) s, monotonic, of any sign; (..., ·) at a single time."""
        times = np.asarray(times, dtype=np.float64)
        along = np.atleast_1d(times)
        place, attitude, spin = self._bodies(along)
        offset, orientation = (each[..., None, :] for each in (self.offset, self.orientation))
        position, velocity = point_motion(place, attitude, spin, offset)
        velocity = velocity + self.linear_velocity[..., None, :]
        found = position, multiply(attitude, orientation), velocity, spin
        shape = np.broadcast_shapes(*(each.shape[:-1] for each in found))
        found = (np.broadcast_to(each, (*shape, each.shape[-1])) for each in found)
        return PoseTwist(*(each if times.ndim else each[..., 0, :] for each in found))

    def _bodies(self, times: Array) -> tuple[Array, Array, Array]:
        """Centres (..., T, 3), attitudes (..., T, 4) and angular velocities (..., T, 3) of the bodies."""
        place = self.centre[..., None, :] + self.linear_velocity[..., None, :] * times[:, None]
        if not np.any(self.angular_velocity):
            return place, self.attitude[..., None, :], self.angular_velocity[..., None, :]
        speed = np.sqrt((self.angular_velocity * self.angular_velocity).sum(axis=-1)).max()
        attitude, spin = tumble(self.attitude, self.angular_velocity, self.inertia, times, _ANGLE / speed)
        return place, attitude, spin

    def after(self, time: float) -> Self:
        """The same motion from a time on, s: its t = 0 is that time."""
        if not self.moves:
            return self
        centre, attitude, spin = (each[..., 0, :] for each in self._bodies(np.array([float(time)])))
        return replace(self, centre=centre, attitude=attitude, angular_velocity=spin)

    def in_frame(self, position: Array, quaternion: Array) -> Self:
        """The same motion in a frame at rest.

        Args:
            position: (..., 3) m of its origin. quaternion: (..., 4) w x y z, from the new frame to this one.
        """
        back = conjugate(quaternion)
        return replace(
            self,
            centre=rotate(back, self.centre - position),
            attitude=multiply(back, self.attitude),
            linear_velocity=rotate(back, self.linear_velocity),
            angular_velocity=rotate(back, self.angular_velocity),
        )

    def row(self, index: int) -> Self:
        """One grapple of a batch (N,)."""
        shape = np.broadcast_shapes(*(getattr(self, name).shape[:-1] for name in _BATCHED))
        values = {name: getattr(self, name) for name in _BATCHED}
        rows = {
            name: np.broadcast_to(value, (*shape, value.shape[-1]))[index] for name, value in values.items()
        }
        return replace(self, **rows)

    def checked(self, *batch: int) -> Self:
        """Return a copy with float64 arrays and unit quaternions, of a batch of a size; of one by default.

        Raises:
            ConfigurationError: if a shape is wrong, a number is not finite, a quaternion is zero or a moment
                of inertia is not positive.
        """
        inertia = finite_array("inertia of a grapple's body", self.inertia, (3,))
        if not (inertia > 0.0).all():
            raise ConfigurationError(f"moments of inertia must be positive, got {inertia.tolist()}")
        vectors = {
            name: _rows(name, getattr(self, name), (*batch, 3))
            for name in ("centre", "linear_velocity", "angular_velocity", "offset")
        }
        turns = {name: _unit(name, getattr(self, name), (*batch, 4)) for name in ("attitude", "orientation")}
        return replace(self, inertia=inertia, **vectors, **turns)


_BATCHED = tuple(field.name for field in fields(Grapple) if field.name != "inertia")


def _rows(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Finite numbers of a shape, where one row may stand for all; ConfigurationError for anything else."""
    found = numbers(value)
    if found is not None and found.shape == shape[-1:]:
        value = np.broadcast_to(found, shape)
    return finite_array(f"{name} of a grapple", value, shape)


def _unit(name: str, value: Any, shape: tuple[int, ...]) -> Array:
    """Unit quaternions of a shape; ConfigurationError for another shape, NaN or zero."""
    quaternion = _rows(name, value, shape)
    length = np.array([np.linalg.norm(row) for row in quaternion.reshape(-1, 4)])
    if not (length > 0.0).all():
        raise ConfigurationError(f"{name} of a grapple must not be zero, got {value!r}")
    return quaternion / length.reshape(*shape[:-1], 1)
