"""Observations of the dual-arm tasks for policies, in the same form for the plane and for space."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rigid_body import point_motion, tumble
from space_envs.dynamics.rotations import Array, conjugate, exponential, rotate
from space_envs.policy import PolicyContext


@dataclass(frozen=True)
class GrappleMotion:
    """Motion of the grapple points at T times, in the inertial frame.

    Attributes:
        position, velocity: (N, T, 2, 3) m and m/s. axis: (N, T, 2, 3), approach directions, or None where any
            will do. attitude: (N, T, 4) of the target.
    """

    position: Array
    velocity: Array
    axis: Array | None
    attitude: Array


class Reader:
    """Reads observations (N, size) of a dual-arm task; vectors have three components in both."""

    def __init__(self, context: PolicyContext) -> None:
        self.context = context
        self.inertia = context.model.body("target").inertia.copy()

    def field(self, observation: NDArray, name: str) -> Array:
        """A field in the layout's shape."""
        return self.context.layout.read(observation, name)

    def vectors(self, observation: NDArray, name: str) -> Array:
        """A field with one vector per arm, (N, 2, 3)."""
        values = self.field(observation, name)
        n = len(values)
        if not self.context.planar:
            return values.reshape(n, 2, 3)
        out = np.zeros((n, 2, 3))
        out[..., :2] = values.reshape(n, 2, 2)
        return out

    def vector(self, observation: NDArray, name: str) -> Array:
        """A field of one vector, (N, 3); an angular velocity in the plane is about z."""
        values = self.field(observation, name)
        if values.shape[1] == 3:
            return values
        out = np.zeros((len(values), 3))
        out[:, 2:] = values if values.shape[1] == 1 else 0.0
        if values.shape[1] == 2:
            out[:, :2] = values
        return out

    def quaternion(self, observation: NDArray, body: str) -> Array:
        """Attitude (N, 4) of `base` or `target`, body to inertial."""
        if not self.context.planar:
            return self.field(observation, f"{body}_quaternion")
        rotation = np.zeros((len(observation), 3))
        rotation[:, 2] = self.field(observation, f"{body}_angle")[:, 0]
        return exponential(rotation)

    def grapples(self, observation: NDArray, times: Array) -> GrappleMotion:
        """The grapple points, predicted for times (T,) s from now: the target rotates freely."""
        centre = self.vector(observation, "target_position")
        attitude = self.quaternion(observation, "target")
        to_target = conjugate(attitude)[:, None]
        points = rotate(to_target, self.vectors(observation, "goal_position") - centre[:, None])
        spin = self.vector(observation, "target_angular_velocity")
        attitudes, spins = tumble(attitude, spin, self.inertia, times)
        position, velocity = point_motion(
            centre[:, None, None], attitudes[:, :, None], spins[:, :, None], points[:, None]
        )
        axis = None
        if "goal_axis" in self.context.layout.slices:
            local = rotate(to_target, self.vectors(observation, "goal_axis"))
            axis = rotate(attitudes[:, :, None], local[:, None])
        return GrappleMotion(position, velocity, axis, attitudes)
