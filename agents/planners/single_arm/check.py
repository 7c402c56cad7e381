"""What a motion of the single arm really does, by numpy and MuJoCo: no planner uses anything of this."""

from dataclasses import replace

import mujoco
import numpy as np

from agents.planners.common.plans import Limits
from agents.planners.single_arm.problem import Reach, ReachPlan
from space_envs.dynamics import FloatingRobot, attitude_cost, roll_out_base
from space_envs.dynamics.rotations import Array, angle_between, multiply, rotate
from space_envs.dynamics.rotations import from_matrix as quaternion_of
from space_envs.dynamics.spheres import link_ends, sphere_gaps
from space_envs.robots.parameters import SINGLE_ARM

SAMPLES = 1001  # of the roll-out
EVERY = 5  # torques are asked of MuJoCo at each fifth


def check(
    model: mujoco.MjModel, robot: FloatingRobot, reach: Reach, limits: Limits, motion: ReachPlan
) -> ReachPlan:
    """The motion with its cost and violations as measured on an even grid, between its nodes too.

    Violations: `start` rad and rad/s, `end_rate` rad/s, `position_error` m and `rotation_error` rad of the
    end-effector at T, `end_attitude` rad of the base at T, `peak_attitude` rad; beyond the limits (negative:
    room left; absent where there is no limit) `position` rad, `rate` rad/s, `acceleration` rad/s^2, `torque`
    and `coriolis` N m, and `clearance` m, the deepest that a link enters a sphere of reach.spheres.

    Args:
        model: compiled model of the robot, for the torques. reach: as `Reach.checked` gives it.
    """
    time = np.linspace(0.0, motion.time[-1], SAMPLES)
    q, qdot, qddot = motion.sample(time)
    twist = robot.base_twist(q, qdot)
    dt = float(time[1])
    position, quaternion = roll_out_base(robot, q, qdot, dt, twist=twist)
    local, rotation = robot.end_effector_pose(q[-1])
    tip = position[-1] + rotate(quaternion[-1], local)
    turned = multiply(quaternion[-1], quaternion_of(rotation))
    still = np.array([1.0, 0.0, 0.0, 0.0])
    start_rate = 0.0 if reach.rate is None else reach.rate
    angle = angle_between(quaternion, np.broadcast_to(still, quaternion.shape))
    violation = {
        "start": float(max(np.abs(q[0] - reach.start).max(), np.abs(qdot[0] - start_rate).max())),
        "end_rate": float(np.abs(qdot[-1]).max()),
        "position_error": float(np.linalg.norm(tip - reach.position)),
        "rotation_error": float(angle_between(turned, reach.quaternion)),
        "end_attitude": float(angle[-1]),
        "peak_attitude": float(angle.max()),
    }
    if limits.position is not None:
        violation["position"] = float(np.maximum(limits.position[:, 0] - q, q - limits.position[:, 1]).max())
    for name, values in (("rate", qdot), ("acceleration", qddot)):
        if (limit := getattr(limits, name)) is not None:
            violation[name] = float(np.abs(values).max() - limit)
    if limits.torque is not None:
        torque = joint_torques(model, *(x[::EVERY] for x in (q, qdot, qddot, twist)))
        violation["torque"] = float(np.abs(torque).max() - limits.torque)
    if limits.coriolis is not None:
        torque = joint_torques(model, *(x[::EVERY] for x in (q, qdot, 0.0 * qddot, twist)))
        violation["coriolis"] = float(np.abs(torque).max() - limits.coriolis)
    if reach.spheres is not None and len(reach.spheres):
        ends = link_ends(robot, q, position, quaternion)
        violation["clearance"] = -float(sphere_gaps(ends, reach.spheres, SINGLE_ARM.link_radius).min())
    weight = np.ones(SAMPLES)
    weight[[0, -1]] = 0.5  # trapezoidal rule
    cost = float(attitude_cost(twist * np.sqrt(weight)[:, None], dt, reach.c))
    return replace(motion, cost=cost, violation=violation)


def joint_torques(model: mujoco.MjModel, q: Array, qdot: Array, qddot: Array, twist: Array) -> Array:
    """Torques (K, n), N m, of the free-floating robot, from MuJoCo's mass matrix and bias forces.

    Args:
        q, qdot, qddot: (K, n). twist: (K, 6) of the base [v; w] in its axes.
    """
    data = mujoco.MjData(model)
    n = q.shape[1]
    torque, mass = np.empty_like(q), np.empty((model.nv, model.nv))
    for k in range(len(q)):
        data.qpos[:7] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
        data.qpos[7 : 7 + n], data.qvel[:6], data.qvel[6 : 6 + n] = q[k], twist[k], qdot[k]
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, mass)
        # No force on the base: its acceleration follows, then what the joints need.
        base = -np.linalg.solve(mass[:6, :6], data.qfrc_bias[:6] + mass[:6, 6 : 6 + n] @ qddot[k])
        torque[k] = mass[6 : 6 + n, :6] @ base + mass[6 : 6 + n, 6 : 6 + n] @ qddot[k]
        torque[k] += data.qfrc_bias[6 : 6 + n]
    return torque
