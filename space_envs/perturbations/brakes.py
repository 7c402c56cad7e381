"""Locked joints: a brake holds a joint, and its drive, which knows it, gives no torque."""

import numpy as np
from numpy.typing import NDArray

from space_envs.drives import Drive
from space_envs.dynamics.rotations import Array

BRAKE_INERTIA = 1e7  # kg m^2 that a brake adds to its joint's own inertia, and to nothing else


class BrakedDrive(Drive):
    """Joint drives of N robots, some of whose joints are locked by brakes.

    Attributes:
        locked: (N, n) bool; the simulation has `BRAKE_INERTIA` in these joints.
    """

    locked: NDArray[np.bool_]

    def begin(self) -> None:
        """Update to the state at the start of a control period."""
        super().begin()
        self._brakes = np.zeros_like(self._mass)
        joints = np.arange(self._b, self._mass.shape[1])
        self._brakes[:, joints, joints] = BRAKE_INERTIA * self.locked

    def accelerate(self, acceleration: Array) -> Array:
        """Torques (N, n) for joint accelerations (N, n), zero in locked joints."""
        self._mass -= self._brakes
        torque = super().accelerate(np.where(self.locked, 0.0, acceleration))
        self._mass += self._brakes
        return np.where(self.locked, 0.0, torque)

    def protect(self, torque: Array) -> Array:
        """Commanded torques (N, n) that respect rate and position limits, zero in locked joints."""
        return super().protect(np.where(self.locked, 0.0, torque))
