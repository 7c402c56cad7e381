"""Poses of frames in others, with rotation matrices, for robots as they are put together."""

from typing import NamedTuple, Self

import numpy as np

from space_envs.dynamics.rotations import Array, exponential, from_matrix, to_matrix
from space_envs.robots.robot import IDENTITY, ORIGIN, Quaternion, Vector3

_DIGITS = 12  # behind the point, of m and of quaternions


class Pose(NamedTuple):
    """A frame in another.

    Attributes:
        position: (3,) m, of its origin.
        rotation: (3, 3) its axes as columns.
    """

    position: Array
    rotation: Array

    @classmethod
    def of(cls, position: Vector3 | Array = ORIGIN, orientation: Quaternion | Array = IDENTITY) -> Self:
        """The pose with a position and a unit quaternion."""
        return cls(np.asarray(position, dtype=float), to_matrix(np.asarray(orientation, dtype=float)))

    @classmethod
    def about(cls, axis: Vector3 | Array, angle: float) -> Self:
        """A rotation about a unit axis through the origin, rad."""
        return cls(np.zeros(3), to_matrix(exponential(np.asarray(axis, dtype=float) * angle)))

    def __matmul__(self, inner: "Pose") -> "Pose":  # type: ignore[override]
        """The pose of a frame that is given in this one."""
        return Pose(self.point(inner.position), self.rotation @ inner.rotation)

    def point(self, points: Vector3 | Array) -> Array:
        """Points (..., 3) of this frame in the outer one."""
        return self.position + np.asarray(points) @ self.rotation.T

    @property
    def inverse(self) -> "Pose":
        """The outer frame in this one."""
        return Pose(-self.rotation.T @ self.position, self.rotation.T)

    @property
    def vector(self) -> Vector3:
        """Position as plain numbers."""
        return vector(self.position)

    @property
    def quaternion(self) -> Quaternion:
        """Orientation as plain numbers, w x y z."""
        w, x, y, z = (_rounded(value) for value in from_matrix(self.rotation))
        return (w, x, y, z)


def vector(values: Array | Vector3) -> Vector3:
    """Three plain numbers without the rounding errors of one machine, which would change a robot's digest."""
    x, y, z = map(_rounded, values)
    return (x, y, z)


def _rounded(value: float) -> float:
    return round(float(value), _DIGITS) + 0.0
