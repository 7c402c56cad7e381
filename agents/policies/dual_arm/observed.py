"""Observations of the dual-arm tasks for policies, in the same form for the plane and for space."""

import numpy as np
from numpy.typing import NDArray

from agents.planners.dual_arm.problem import axis_attitude
from space_envs.dynamics.grapples import Grapple, PoseTwist
from space_envs.dynamics.rotations import Array, exponential
from space_envs.policy import PolicyContext

_Z = np.array([0.0, 0.0, 1.0])


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

    @property
    def aligned(self) -> bool:
        """Whether the approach axes have to be those of the grapples."""
        return "goal_axis" in self.context.layout.slices

    def goals(self, observation: NDArray) -> Grapple:
        """Grapples (N, 2) on the observed targets, in the inertial frame; their t = 0 is now."""
        centre = self.vector(observation, "target_position")[:, None]
        attitude = self.quaternion(observation, "target")[:, None]
        spin = self.vector(observation, "target_angular_velocity")[:, None]
        axes = self.vectors(observation, "goal_axis") if self.aligned else _Z
        body = PoseTwist(centre, attitude, np.zeros(3), spin)
        position = self.vectors(observation, "goal_position")
        return Grapple.on_body(body, self.inertia, position, axis_attitude(axes))
