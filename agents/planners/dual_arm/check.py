"""Independent check of plans, by numpy alone: no planner's compiled functions are used.

Everything is for a base that keeps its attitude, which is checked as well: the base rate caused by the joints
is among the results.
"""

from dataclasses import dataclass

import numpy as np

from agents.planners.common.plans import Limits
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.dynamics import FloatingRobot, Kinematics
from space_envs.dynamics.reactionless import end_effectors
from space_envs.dynamics.rotations import Array, cross


@dataclass(frozen=True, eq=False)
class Checked:
    """Errors and violations by name, and the energy C of eq. 15 of shah2013 in J s."""

    violation: dict[str, float]
    energy: float


def check(robot: FloatingRobot, capture: Capture, limits: Limits, plan: CapturePlan) -> Checked:
    """Measure a plan at its nodes and at two points between each pair of them.

    Violations: `base_rate` rad/s, `end_position` m, `end_velocity` m/s, `end_axis` rad (0 if any axis is
    allowed), `start` rad and rad/s, `position` rad, `rate` rad/s, `acceleration` rad/s^2 and `torque` N m
    beyond the limits (negative inside, absent without a limit).
    """
    time = plan.time
    half, middle = 0.5 * np.diff(time), 0.5 * (time[:-1] + time[1:])
    inner = (middle[:, None] + half[:, None] * np.array([-1.0, 1.0]) / np.sqrt(3.0)).ravel()
    q, qdot, qddot = (
        np.concatenate(parts)
        for parts in zip((plan.position, plan.rate, plan.acceleration), plan.sample(inner), strict=True)
    )
    base_rate = (robot.base_map(q)[:, 3:] @ qdot[..., None])[..., 0]
    energy, torque = held_dynamics(robot, q, qdot, qddot)
    now = end_effectors(robot, q[len(time) - 1])
    base = robot.centre_of_mass(robot.kinematics(capture.start)) - robot.centre_of_mass(
        robot.kinematics(q[len(time) - 1])
    )
    violation = {
        "base_rate": float(np.abs(base_rate).max()),
        "start": float(max(np.abs(q[0] - capture.start).max(), np.abs(qdot[0]).max())),
        "end_position": _longest(now.position + base - capture.position),
        "end_velocity": _longest(now.linear @ qdot[len(time) - 1] - capture.velocity),
        "end_axis": 0.0,
    }
    if capture.axis is not None:
        sine, cosine = cross(now.axis, capture.axis), (now.axis * capture.axis).sum(axis=-1)
        violation["end_axis"] = float(np.arctan2(np.linalg.norm(sine, axis=-1), cosine).max())
    violation |= limits.excess(position=q, rate=qdot, acceleration=qddot, torque=torque)
    integral = float(half.repeat(2) @ energy[len(time) :])
    return Checked(violation, integral)


def held_dynamics(robot: FloatingRobot, q: Array, qdot: Array, qddot: Array) -> tuple[Array, Array]:
    """Twice the kinetic energy (K,), J, and the joint torques (K, n), N m, of a base that only translates.

    The common centre of mass is at rest. In reactionless motion these are
    thetadot' M* thetadot and the torques of the free-floating robot.
    """
    k = robot.kinematics(q)
    carries, total, mass = robot.carries, robot.mass.sum(), robot.mass[1:, None]  # carries: joints by links
    hinge_rate = k.axis * qdot[..., None]
    rotation = (carries.T[..., None] * hinge_rate[:, None]).sum(axis=2)  # angular velocity of each link
    change = k.axis * qddot[..., None] + cross(rotation - hinge_rate, hinge_rate)
    spin = (carries.T[..., None] * change[:, None]).sum(axis=2)  # angular acceleration of each link
    # Velocity and acceleration of each link's centre of mass, with respect to the base.
    arm = k.com[:, :, None] - k.position[:, None]  # links by joints
    velocity = (carries.T[..., None] * cross(hinge_rate[:, None], arm)).sum(axis=2)
    velocity = velocity - (mass * velocity).sum(axis=1, keepdims=True) / total
    base_velocity = -(mass * velocity).sum(axis=1) / robot.mass[0]
    acceleration = _com_accelerations(robot, k, rotation, spin)
    acceleration = acceleration - (mass * acceleration).sum(axis=1, keepdims=True) / total
    inertia = k.rotation @ robot.inertia[1:] @ k.rotation.swapaxes(-1, -2)
    momentum = (inertia @ rotation[..., None])[..., 0]
    energy = (mass * velocity**2).sum(axis=(1, 2)) + (rotation * momentum).sum(axis=(1, 2))
    energy += robot.mass[0] * (base_velocity**2).sum(axis=1) + (robot.rotor_inertia * qdot**2).sum(axis=1)
    moment = (inertia @ spin[..., None])[..., 0] + cross(rotation, momentum)
    force = mass * acceleration
    about = moment[:, None] + cross(-arm.swapaxes(1, 2), -force[:, None])  # joints by links
    torque = (k.axis * (carries[..., None] * about).sum(axis=2)).sum(axis=-1)
    return energy, torque + robot.rotor_inertia * qddot


def _com_accelerations(robot: FloatingRobot, k: Kinematics, rotation: Array, spin: Array) -> Array:
    """Accelerations (K, n, 3) of the links' centres of mass with respect to the base, m/s^2."""
    found = np.zeros_like(rotation)
    for link in range(robot.n_joints):
        chain = [joint for joint in range(robot.n_joints) if robot.carries[joint, link]]
        points = [k.position[:, joint] for joint in chain] + [k.com[:, link]]
        for joint, here, there in zip(chain, points[:-1], points[1:], strict=True):
            arm = there - here
            found[:, link] += cross(spin[:, joint], arm) + cross(
                rotation[:, joint], cross(rotation[:, joint], arm)
            )
    return found


def _longest(vectors: Array) -> float:
    return float(np.sqrt((vectors * vectors).sum(axis=-1)).max())
