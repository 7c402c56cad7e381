"""Control modes: from actions in [-1, 1] to joint torques, batched.

Every mode computes joint torques, which are internal to the robot and do not change its total momentum.
"""

import copy
from collections.abc import Callable
from typing import Any, Protocol

import mujoco
import numpy as np
from numpy.typing import NDArray

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

    def __init__(self, drive: Drive, fields: tuple[str, ...] = ()) -> None:
        self.drive = drive
        simulation, model = drive.simulation, copy.copy(drive.simulation.model)
        off = mujoco.mjtDisableBit  # which take time; there are no constraints
        model.opt.disableflags |= int(off.mjDSBL_SENSOR) | int(off.mjDSBL_CONSTRAINT)
        self.simulation = Simulation(model, simulation.n, simulation.batch.nthread, fields)

    def update(self) -> None:
        """Predict from the present state of the drive's simulation."""
        now, ahead = self.drive.simulation, self.simulation
        ahead.base_attitude[:] = now.base_attitude
        np.add(now.joint_position, self.drive.control_period * now.joint_velocity, out=ahead.joint_position)
        ahead.batch.forward(stage=STAGE_POS)

    def base_map(self) -> Array:
        """Base velocity (N, b, n) per joint rate, zero momentum; linear in inertial, angular in base axes."""
        return -np.linalg.solve(*self.simulation.base_inertias())


class EndEffectorJacobians:
    """Jacobians of end-effectors, with the bits of `mujoco.mj_jac`, which would repeat the kinematics.

    A unit rate of a degree of freedom moves the bodies that it carries as in `cdof`: [angular; linear]
    velocity, about the robot's centre of mass.

    Args:
        simulation: with the `fields`.
    """

    fields = "cdof", "site_xpos", "subtree_com"
    # The cross product of `cdof` and an arm: components of its two products' factors.
    _rotation, _arm = np.array([1, 2, 0, 2, 0, 1]), np.array([2, 0, 1, 1, 2, 0])

    def __init__(self, simulation: Any) -> None:
        self._simulation, model = simulation, simulation.model
        size = simulation.n_base + simulation.n_joints
        names = [model.site(site).name for site in range(model.nsite)]
        self._sites = np.array([i for i, name in enumerate(names) if name.startswith("end_effector")])
        self.count = len(self._sites)
        bodies = model.site_bodyid[self._sites].tolist()
        self._root = int(model.body_rootid[bodies[0]])
        self._carried = np.zeros((self.count, 1, size))
        for carried, body in zip(self._carried, bodies, strict=True):
            while body:
                carried += model.dof_bodyid[:size] == body
                body = int(model.body_parentid[body])

    def current(self) -> Array:
        """(N, k, 6, b + n) of k end-effectors, [linear; angular] in inertial axes."""
        simulation = self._simulation
        axes = np.ascontiguousarray(simulation.cdof[:, : self._carried.shape[-1]].swapaxes(1, 2))[:, None]
        arms = simulation.site_xpos.take(self._sites, axis=1) - simulation.subtree_com[:, self._root, None]
        products = axes.take(self._rotation, axis=2) * arms.take(self._arm, axis=2)[..., None]
        jacobian = np.empty((*arms.shape[:2], 6, axes.shape[-1]))
        np.subtract(products[:, :, :3], products[:, :, 3:], out=jacobian[:, :, :3])
        jacobian[:, :, :3] += axes[:, :, 3:]
        jacobian[:, :, 3:] = axes[:, :, :3]
        jacobian *= self._carried
        return jacobian


class EndEffectorVelocity:
    """Twists [v; w] of the end-effectors, one after the other, by the damped generalised Jacobian.

    m/s and rad/s in inertial axes; in the plane a twist is [vx, vy, wz].
    """

    def __init__(self, drive: Drive) -> None:
        self.drive = drive
        self._ahead = Lookahead(drive, EndEffectorJacobians.fields)
        self._jacobians = EndEffectorJacobians(self._ahead.simulation)
        self._rows = [0, 1, 5] if drive.simulation.planar else slice(None)
        self.scale = np.tile(np.repeat(END_EFFECTOR_SPEED, 3)[self._rows], self._jacobians.count)
        self.size = len(self.scale)
        self._damping = DAMPING**2 * np.eye(self.size)
        self._laws = drive.laws_of(drive.rate_limit, self.scale, regularisation=DAMPING**2)

    def torques(self, action: Array) -> Array:
        ahead = self._ahead
        ahead.update()
        jacobian = self._jacobians.current()[:, :, self._rows].reshape(len(action), self.size, -1)
        if self._laws.compiled:
            return self.drive.track(self._laws.end_effectors(ahead.simulation.base_rows(), jacobian, action))
        return self.drive.track(self._rates(jacobian, action))

    def _rates(self, jacobian: Array, action: Array) -> Array:
        """Joint rates (N, n) for actions (N, m) and Jacobians (N, m, b + n), in numpy."""
        ahead, b = self._ahead, self.drive.simulation.n_base
        generalized = jacobian[:, :, b:] + jacobian[:, :, :b] @ ahead.base_map()
        square = generalized @ generalized.swapaxes(1, 2) + self._damping
        command = np.linalg.solve(square, (action * self.scale)[..., None])
        rate = (generalized.swapaxes(1, 2) @ command)[..., 0]
        excess = (np.abs(rate) / self.drive.rate_limit).max(axis=1, keepdims=True)
        return rate / np.maximum(excess, 1.0)


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
        self._away = AWAY * drive.rate_limit
        self._laws = drive.laws_of(self._away, self.scale, ATTITUDE_GAIN, _REGULARISATION)

    def torques(self, action: Array) -> Array:
        self._ahead.update()
        acceleration, away = self._compiled(action) if self._laws.compiled else self._in_numpy(action)
        torque = self.drive.accelerate(acceleration)
        if away.any():
            braked = self.drive.track(np.zeros_like(torque))
            torque = np.where(away[:, None], braked, torque)
        return torque

    def _compiled(self, action: Array) -> tuple[Array, NDArray[np.bool_]]:
        drive, simulation = self.drive, self.drive.simulation
        state = self._ahead.simulation.base_rows(), simulation.base_attitude, simulation.joint_velocity
        return self._laws.reactionless(*state, action, drive.low, drive.high, drive.late)

    def _in_numpy(self, action: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Joint accelerations (N, n), and which motions (N,) are too far from the null space."""
        simulation = self.drive.simulation
        low, high = self.drive.low, self.drive.high
        rotation_map = self._ahead.base_map()[:, simulation.angular]  # (N, 3 or 1, n), base axes
        attitude = simulation.base_attitude
        if simulation.planar:
            base_rate = -ATTITUDE_GAIN * attitude
        else:
            # For small angles twice the vector part is the rotation vector, in base axes too.
            base_rate = np.copysign(2.0 * ATTITUDE_GAIN, -attitude[:, :1]) * attitude[:, 1:]

        def projected(rate: Array, adjustable: NDArray[np.bool_] | None = None) -> Array:
            return reactionless_projection(rotation_map, rate, base_rate, adjustable, _REGULARISATION)

        command = np.minimum(np.maximum(action * self.scale, low), high)
        rate = projected(command)
        adjustable = (rate >= low) & (rate <= high)
        rate = projected(np.minimum(np.maximum(rate, low), high), adjustable)
        # Rates that still exceed a limit are all scaled together, which stays in the null space.
        shares = np.maximum(rate / np.maximum(high, 1e-9), rate / np.minimum(low, -1e-9))
        rate = rate / np.maximum(shares.max(axis=1, keepdims=True), 1.0)
        # A joint too fast to stop in time: the whole arm brakes, since its motion is reactionless too.
        now = simulation.joint_velocity
        if self.drive.late.any():
            rate = np.where(self.drive.late.any(axis=1, keepdims=True), 0.0, rate)
        # The acceleration limit slows the change from the present motion, made reactionless, to the new one.
        present = projected(now)
        change = (rate - present) / self.drive.control_period
        largest = (np.abs(change) / self.drive.acceleration_limit).max(axis=1, keepdims=True)
        correction = (present - now) / self.drive.control_period
        excess = np.maximum(present - high, low - present)
        away = np.asarray((excess > self._away).any(axis=1))
        return correction + change / np.maximum(largest, 1.0), away


MODES: dict[str, Callable[[Drive], ControlMode]] = {
    "joint_velocity": JointVelocity,
    "joint_torque": JointTorque,
    "end_effector_velocity": EndEffectorVelocity,
    "reactionless": Reactionless,
}
