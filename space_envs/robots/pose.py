"""Poses of frames in others."""

from typing import NamedTuple, Self

import numpy as np

from space_envs.dynamics.rotations import Array, conjugate, exponential, multiply, rotate
from space_envs.robots.robot import IDENTITY, ORIGIN, Quaternion, Vector3

_DIGITS = 12  # behind the point, of m and of quaternions; the others are rounding errors of one machine


class Pose(NamedTuple):
    """Position (3,) m and orientation (4,), w x y z, of a frame in another one."""

    position: Array
    orientation: Array

    @classmethod
    def of(cls, position: Vector3 | Array = ORIGIN, orientation: Quaternion | Array = IDENTITY) -> Self:
        """The pose of these numbers."""
        return cls(np.array(position, dtype=float), np.array(orientation, dtype=float))

    @classmethod
    def about(cls, axis: Vector3 | Array, angle: float) -> Self:
        """A rotation about a unit axis through the origin, rad."""
        return cls(np.zeros(3), exponential(np.array(axis) * angle))

    def __matmul__(self, other: "Pose") -> "Pose":
        """Pose of a third frame, given in the second."""
        return Pose(self.point(other.position), multiply(self.orientation, other.orientation))

    def point(self, points: Vector3 | Array) -> Array:
        """Points (..., 3) of this frame in the outer one."""
        return self.position + rotate(self.orientation, np.asarray(points))

    @property
    def inverse(self) -> "Pose":
        """Pose of the outer frame in this one."""
        back = conjugate(self.orientation)
        return Pose(-rotate(back, self.position), back)

    @property
    def vector(self) -> Vector3:
        """Position as plain numbers, the same on every machine."""
        x, y, z = map(_rounded, self.position)
        return (x, y, z)

    @property
    def quaternion(self) -> Quaternion:
        """Orientation as plain numbers, the same on every machine, with w >= 0."""
        w, x, y, z = map(_rounded, self.orientation)
        first = next((value for value in (w, x, y, z) if value), 1.0)
        return (w, x, y, z) if first > 0.0 else (-w + 0.0, -x + 0.0, -y + 0.0, -z + 0.0)


def _rounded(value: float) -> float:
    return round(float(value), _DIGITS) + 0.0
