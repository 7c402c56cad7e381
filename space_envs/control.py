"""Control modes: from actions in [-1, 1] to joint torques, batched.

Every mode computes joint torques, which are internal to the robot and do not change its total momentum.
"""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from space_envs.drives import Drive
from space_envs.dynamics.reactionless import reactionless_projection
from space_envs.dynamics.rotations import Array
from space_envs.simulation import STAGE_POS, Simulation

CONTROL_MODES = ("joint_velocity", "joint_torque", "end_effector_velocity", "reactionless")
END_EFFECTOR_SPEED = (0.3, 0.5)  # m/s and rad/s per unit action
DAMPING = 0.02  # of the generalised Jacobian's inverse, in the units of its singular values
AWAY = 0.1  # of the rate limit; beyond it, a motion that violates limits when made reactionless is stopped
_REGULARISATION = 1e-9  # of the projection onto the reaction null space
ATTITUDE_GAIN = 0.5  # 1/s, feedback of the attitude error in mode reactionless


class ControlMode(Protocol):
    """Maps actions (N, size) in [-1, 1] to torques (N, n); `scale` is physical units per unit action."""

    size: int
    scale: Array

    def torques(self, action: Array) -> Array:
        """Joint torques (N, n), N m, for actions (N, size)."""
        ...


class JointVelocity:
    """Joint rates, rad/s, reached at the end of the control period."""

    def __init__(self, drive: Drive) -> None:
        self.drive = drive
        self.size = drive.simulation.n_joints
        self.scale = drive.rate_limit.copy()

    def torques(self, action: Array) -> Array:
        return self.drive.track(action * self.scale)


class JointTorque:
    """Joint torques, N m, held over the control period; the drives keep rates and angles within limits."""

    def __init__(self, drive: Drive) -> None:
        self.drive = drive
        drive.extrapolate = False  # torques are discontinuous between periods, so extrapolation is useless
        self.size = drive.simulation.n_joints
        self.scale = drive.torque_limit.copy()

    def torques(self, action: Array) -> Array:
        return self.drive.protect(action * self.scale)


class Lookahead:
    """Predicted robot at the end of the period, for constant joint rates.

    A commanded rate is reached there, so the maps from joint rates to the end-effector and to the base are
    evaluated there. The base has its present attitude and is placed at the origin. Masses are nominal: a
    controller does not know the actual ones.
    """

    def __init__(self, drive: Drive) -> None:
        self.drive = drive
        simulation = drive.simulation
        self.simulation = Simulation(simulation.model, simulation.n, simulation.batch.nthread)

    def update(self) -> None:
        """Predict from the present state of the drive's simulation."""
        now, ahead = self.drive.simulation, self.simulation
        ahead.base_attitude[:] = now.base_attitude
        ahead.joint_position[:] = now.joint_position + self.drive.control_period * now.joint_velocity
        ahead.batch.forward(stage=STAGE_POS)

    def base_map(self) -> Array:
        """Base velocity (N, b, n) per joint rate, zero momentum; linear in inertial, angular in base axes."""
        mass, b = self.simulation.mass_matrix(), self.simulation.n_base
        return -np.linalg.solve(mass[:, :b, :b], mass[:, :b, b:])


class EndEffectorVelocity:
    """Twists [v; w] of the end-effectors, one after the other, by the damped generalised Jacobian.

    m/s and rad/s in inertial axes; in the plane a twist is [vx, vy, wz].
    """

    def __init__(self, drive: Drive) -> None:
        self.drive = drive
        self._ahead = Lookahead(drive)
        model, planar = drive.simulation.model, drive.simulation.planar
        sites = [model.site(i) for i in range(model.nsite) if model.site(i).name.startswith("end_effector")]
        starts = [int(model.sensor(f"{site.name}_position").adr[0]) for site in sites]
        self._end_effectors = [
            (int(site.bodyid[0]), slice(start, start + 3)) for site, start in zip(sites, starts, strict=True)
        ]
        self._rows = np.array([0, 1, 5]) if planar else np.arange(6)
        twist = np.repeat(END_EFFECTOR_SPEED, 3)[self._rows]
        self.scale = np.tile(twist, len(sites))
        self.size = len(self.scale)

    def torques(self, action: Array) -> Array:
        ahead = self._ahead
        ahead.update()
        simulation = ahead.simulation
        parts = []
        for body, point in self._end_effectors:
            parts += simulation.batch.jac(body, simulation.sensors[:, point])
        rows = np.concatenate([self._rows + 6 * index for index in range(len(self._end_effectors))])
        jacobian = np.concatenate(parts, axis=1)[:, rows]
        b = simulation.n_base
        joints = slice(b, b + simulation.n_joints)
        generalized = jacobian[:, :, joints] + jacobian[:, :, :b] @ ahead.base_map()
        square = generalized @ generalized.swapaxes(1, 2) + DAMPING**2 * np.eye(self.size)
        command = np.linalg.solve(square, (action * self.scale)[..., None])
        rate = (generalized.swapaxes(1, 2) @ command)[..., 0]
        excess = (np.abs(rate) / self.drive.rate_limit).max(axis=1, keepdims=True)
        return self.drive.track(rate / np.maximum(excess, 1.0))


class Reactionless:
    """Joint rates, rad/s, projected onto the reaction null space.

    From rest the attitude error stays below 0.05 deg for any action with the nominal mass of the satellite,
    and below 0.3 deg with a mass error of 20 %. The attitude error is fed back. Joints stopped by a limit are
    excluded from the projection, since stopping them afterwards would leave the null space. Initial motion
    far from the null space is braked.
    """

    def __init__(self, drive: Drive) -> None:
        self.drive = drive
        self.size = drive.simulation.n_joints
        self.scale = drive.rate_limit.copy()
        self._ahead = Lookahead(drive)

    def torques(self, action: Array) -> Array:
        simulation = self.drive.simulation
        low, high = self.drive.low, self.drive.high
        self._ahead.update()
        rotation_map = self._ahead.base_map()[:, simulation.angular]  # (N, 3 or 1, n), base axes
        attitude = simulation.base_attitude
        if not simulation.planar:
            # For small angles twice the vector part is the rotation vector, in base axes too.
            attitude = 2.0 * attitude[:, 1:] * np.copysign(1.0, attitude[:, :1])
        base_rate = -ATTITUDE_GAIN * attitude

        def projected(rate: Array, adjustable: Array) -> Array:
            return reactionless_projection(rotation_map, rate, base_rate, adjustable, _REGULARISATION)

        command = np.minimum(np.maximum(action * self.scale, low), high)
        rate = projected(command, np.ones_like(command))
        adjustable = ((rate >= low) & (rate <= high)).astype(np.float64)
        rate = projected(np.minimum(np.maximum(rate, low), high), adjustable)
        # Rates that still exceed a limit are all scaled together, which stays in the null space.
        bound = np.where(rate > 0.0, high, -low)
        excess = (np.abs(rate) / np.maximum(bound, 1e-9)).max(axis=1, keepdims=True)
        rate = rate / np.maximum(excess, 1.0)
        # A joint too fast to stop in time: the whole arm brakes, since its motion is reactionless too.
        now = simulation.joint_velocity
        late = ((now > high) | (now < low)).any(axis=1, keepdims=True)
        rate = np.where(late, 0.0, rate)
        # The acceleration limit slows the change from the present motion, made reactionless, to the new one.
        present = projected(now, np.ones_like(now))
        change = (rate - present) / self.drive.control_period
        largest = (np.abs(change) / self.drive.acceleration_limit).max(axis=1, keepdims=True)
        correction = (present - now) / self.drive.control_period
        torque = self.drive.accelerate(correction + change / np.maximum(largest, 1.0))
        excess = np.maximum(present - high, low - present)
        away = (excess > AWAY * self.drive.rate_limit).any(axis=1, keepdims=True)
        if away.any():
            torque = np.where(away, self.drive.track(np.zeros_like(now)), torque)
        return torque


MODES: dict[str, Callable[[Drive], ControlMode]] = {
    "joint_velocity": JointVelocity,
    "joint_torque": JointTorque,
    "end_effector_velocity": EndEffectorVelocity,
    "reactionless": Reactionless,
}
