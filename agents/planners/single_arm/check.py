"""Independent check of plans of the single arm, by numpy and MuJoCo: no planner uses any of this."""

from dataclasses import replace

import mujoco
import numpy as np

from agents.planners.common.plans import Limits
from agents.planners.single_arm.problem import Reach, ReachPlan
from space_envs.dynamics import FloatingRobot, attitude_cost, roll_out_base
from space_envs.dynamics.grapples import PoseTwist
from space_envs.dynamics.rotations import Array, angle_between, from_matrix, multiply, rotate, to_matrix
from space_envs.dynamics.spheres import link_ends, sphere_gaps
from space_envs.tasks.goals.kinds import GoalKind

SAMPLES = 1001  # of the roll-out
TORQUE_STRIDE = 5  # samples for one at which torques are evaluated


def check(
    model: mujoco.MjModel, robot: FloatingRobot, reach: Reach, limits: Limits, plan: ReachPlan
) -> ReachPlan:
    """Return a plan with its cost and violations as measured on an even grid, also between its nodes.

    Violations: `start` rad and rad/s, `position_error` m, `rotation_error` rad (of approach axes for goals
    of kind axis, absent for those of kind position), `linear_velocity_error` m/s and
    `angular_velocity_error` rad/s of the end-effector relative to the goal at T, `end_rate` rad/s of the
    joints at T (absent for a moving goal), `end_attitude` rad of the base at T, `peak_attitude` rad; beyond
    the limits (negative inside, absent without a limit) `position` rad, `rate` rad/s, `acceleration`
    rad/s^2, `torque` and `coriolis` N m, and `clearance` m, the largest depth of a link inside a sphere of
    reach.spheres.

    Args:
        model: compiled model of the robot, for the torques. reach: as `Reach.checked` returns it.
    """
    time = np.linspace(0.0, plan.time[-1], SAMPLES)
    goal = reach.goal.at(plan.time[-1])
    state = plan.sample(time)
    twist, dt = robot.base_twist(*state[:2]), float(time[1])
    base = roll_out_base(robot, *state[:2], dt, twist=twist)
    violation = _boundary_errors(robot, reach, state, base) | _goal_errors(robot, goal, state, base)
    violation |= _rotation_errors(robot, reach.kind, goal, state, base) | _excess(model, limits, state, twist)
    if reach.spheres is not None and len(reach.spheres):
        ends = link_ends(robot, state[0], *base)
        violation["clearance"] = -float(sphere_gaps(ends, reach.spheres, reach.link_radius).min())
    weight = np.ones(SAMPLES)
    weight[[0, -1]] = 0.5  # trapezoidal rule
    cost = float(attitude_cost(twist * np.sqrt(weight)[:, None], dt, reach.c))
    return replace(plan, cost=cost, violation=violation)


def _boundary_errors(
    robot: FloatingRobot, reach: Reach, state: tuple[Array, Array, Array], base: tuple[Array, Array]
) -> dict[str, float]:
    """Errors of the joints at the start and at T, and attitudes of the base."""
    q, qdot, _ = state
    start_rate = 0.0 if reach.rate is None else reach.rate
    angle = angle_between(base[1], np.broadcast_to([1.0, 0.0, 0.0, 0.0], base[1].shape))
    found = {
        "start": float(max(np.abs(q[0] - reach.start).max(), np.abs(qdot[0] - start_rate).max())),
        "end_attitude": float(angle[-1]),
        "peak_attitude": float(angle.max()),
    }
    return found if reach.goal.moves else found | {"end_rate": float(np.abs(qdot[-1]).max())}


def _goal_errors(
    robot: FloatingRobot, goal: PoseTwist, state: tuple[Array, Array, Array], base: tuple[Array, Array]
) -> dict[str, float]:
    """Errors of the end-effector's position and twist at T."""
    q, qdot, position, quaternion = state[0][-1], state[1][-1], base[0][-1], base[1][-1]
    local, _ = robot.end_effector_pose(q)
    reached = position + rotate(quaternion, local)
    twist = robot.generalized_jacobian(q) @ qdot
    linear, angular = rotate(quaternion, twist[:3]), rotate(quaternion, twist[3:])
    return {
        "position_error": float(np.linalg.norm(reached - goal.position)),
        "linear_velocity_error": float(np.linalg.norm(linear - goal.linear_velocity)),
        "angular_velocity_error": float(np.linalg.norm(angular - goal.angular_velocity)),
    }


def _rotation_errors(
    robot: FloatingRobot,
    kind: GoalKind,
    goal: PoseTwist,
    state: tuple[Array, Array, Array],
    base: tuple[Array, Array],
) -> dict[str, float]:
    """Error of the end-effector's rotation at T, as far as the goal asks for one."""
    _, axes = robot.end_effector_pose(state[0][-1])
    if kind == "pose":
        rotation = multiply(base[1][-1], from_matrix(axes))
        return {"rotation_error": float(angle_between(rotation, goal.quaternion))}
    if kind == "position":
        return {}
    approach, wanted = rotate(base[1][-1], axes[:, 2]), to_matrix(goal.quaternion)[:, 2]
    sine, cosine = np.linalg.norm(np.cross(approach, wanted)), approach @ wanted
    return {"rotation_error": float(np.arctan2(sine, cosine))}


def _excess(
    model: mujoco.MjModel, limits: Limits, state: tuple[Array, Array, Array], twist: Array
) -> dict[str, float]:
    """Largest values beyond the limits, by name; those without a limit are absent."""
    q, qdot, qddot = state
    found = limits.excess(position=q, rate=qdot, acceleration=qddot)
    for name, accelerations in (("torque", qddot), ("coriolis", 0.0 * qddot)):
        if getattr(limits, name) is not None:
            torque = joint_torques(model, *(x[::TORQUE_STRIDE] for x in (q, qdot, accelerations, twist)))
            found |= limits.excess(**{name: torque})
    return found


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
        # Without a force on the base its acceleration follows, and from it the torques.
        base = -np.linalg.solve(mass[:6, :6], data.qfrc_bias[:6] + mass[:6, 6 : 6 + n] @ qddot[k])
        torque[k] = mass[6 : 6 + n, :6] @ base + mass[6 : 6 + n, 6 : 6 + n] @ qddot[k]
        torque[k] += data.qfrc_bias[6 : 6 + n]
    return torque
