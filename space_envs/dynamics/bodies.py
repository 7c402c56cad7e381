"""Momentum and kinetic energy of every body from recorded states, to verify a simulation."""

from dataclasses import dataclass

import numpy as np

from space_envs.dynamics.floating import FloatingRobot
from space_envs.dynamics.rotations import Array, conjugate, cross, rotate, to_matrix


@dataclass(frozen=True)
class BodyMotion:
    """Momenta and energies of the base and the links, for states of any batch shape (...).

    Attributes:
        linear: (..., n + 1, 3) linear momentum of each body, inertial axes, N s.
        angular: (..., n + 1, 3) angular momentum of each body about the inertial origin, N m s.
        base_spin: (..., 3) angular momentum of the base about its own centre of mass, inertial axes, N m s.
        kinetic_energy: (...,) of the whole robot with its rotors, J.
    """

    linear: Array
    angular: Array
    base_spin: Array
    kinetic_energy: Array

    @property
    def total(self) -> Array:
        """Total momentum (..., 6) [p; L about the inertial origin]."""
        return np.concatenate([self.linear.sum(axis=-2), self.angular.sum(axis=-2)], axis=-1)


def body_motion(
    robot: FloatingRobot,
    qpos: Array,
    qvel: Array,
    factor: Array | None = None,
    inertia: Array | None = None,
) -> BodyMotion:
    """Momenta of all bodies.

    Args:
        qpos: (..., 7 + n) base position m, base quaternion, joint angles rad.
        qvel: (..., 6 + n) base velocity in inertial axes m/s, base angular velocity in base axes rad/s, joint
            rates rad/s (MuJoCo's convention for a free joint).
        factor: (..., n + 1) on the bodies' masses and inertias; None is 1.
        inertia: (..., n + 1, 3, 3) at factor 1, about the centre of mass, in the body's axes, kg m^2; None is
            the robot's.
    """
    position, quaternion, q = qpos[..., :3], qpos[..., 3:7], qpos[..., 7:]
    spin, rates = qvel[..., 3:6], qvel[..., 6:]
    velocity = rotate(conjugate(quaternion), qvel[..., :3])
    k = robot.kinematics(q)
    # All quantities in base axes first; row 0 is the base.
    rotation = np.concatenate([np.broadcast_to(np.eye(3), (*q.shape[:-1], 1, 3, 3)), k.rotation], axis=-3)
    com = np.concatenate([np.broadcast_to(robot.com[0], (*q.shape[:-1], 1, 3)), k.com], axis=-2)
    joint_omega = k.axis * rates[..., None]  # angular velocity that each joint adds to the links it carries
    moving = -cross(joint_omega, k.position)
    carried = robot.carries.T  # links by joints
    omega = (
        np.concatenate([np.zeros((*q.shape[:-1], 1, 3)), carried @ joint_omega], axis=-2) + spin[..., None, :]
    )
    at_origin = np.concatenate([np.zeros((*q.shape[:-1], 1, 3)), carried @ moving], axis=-2)
    speed = at_origin + velocity[..., None, :] + cross(omega, com)
    inertia = rotation @ (robot.inertia if inertia is None else inertia) @ rotation.swapaxes(-1, -2)
    scale = np.ones((*q.shape[:-1], len(robot.mass), 1))
    if factor is not None:
        scale[..., 0] = factor
    own = scale * (inertia @ omega[..., None])[..., 0]
    linear = scale * robot.mass[:, None] * speed
    energy = 0.5 * (linear * speed).sum(axis=(-1, -2)) + 0.5 * (own * omega).sum(axis=(-1, -2))
    energy = energy + 0.5 * (robot.rotor_inertia * rates**2).sum(axis=-1)
    attitude = to_matrix(quaternion)[..., None, :, :]
    inertial_com = position[..., None, :] + (attitude @ com[..., None])[..., 0]
    inertial_linear = (attitude @ linear[..., None])[..., 0]
    inertial_own = (attitude @ own[..., None])[..., 0]
    return BodyMotion(
        linear=inertial_linear,
        angular=inertial_own + cross(inertial_com, inertial_linear),
        base_spin=inertial_own[..., 0, :],
        kinetic_energy=energy,
    )


def momentum_drifts(motion: BodyMotion) -> tuple[Array, Array]:
    """Largest change (...,) of the total linear (N s) and angular (N m s) momentum since the start of a
    trajectory of states (..., T, .)."""
    change = motion.total - motion.total[..., :1, :]
    linear, angular = (np.linalg.norm(part, axis=-1) for part in (change[..., :3], change[..., 3:]))
    return linear.max(axis=-1), angular.max(axis=-1)


def momentum_drift(motion: BodyMotion) -> tuple[Array, Array]:
    """Drift of total momentum over time, absolute and relative.

    Args:
        motion: of states (..., T, .) along a trajectory.

    Returns:
        drift (...,): largest change of total linear (N s) or angular (N m s) momentum since the start.
        ratio (...,): the drift divided by the largest momentum of its kind of any single body, or by 1 N s or
        1 N m s, whichever is larger.
    """
    drifts, ratios = momentum_drifts(motion), []
    for drift, each in zip(drifts, (motion.linear, motion.angular), strict=True):
        carried = np.linalg.norm(each, axis=-1).max(axis=(-1, -2))
        ratios.append(drift / np.maximum(carried, 1.0))
    return np.maximum(*drifts), np.maximum(*ratios)
