"""Inverse kinematics of a floating arm, batched: joint goals whose motions end at inertial poses.

The base's final pose depends on the motion of the joints. So the pose is solved in the base frame that is
predicted for the end of the motion that will be executed.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from agents.planners.common.damped_search import JointGoals, Rows, search
from space_envs.dynamics import FloatingRobot, roll_out_base
from space_envs.dynamics.rotations import Array, conjugate, from_matrix, multiply, rotate
from space_envs.tasks.goals.kinds import GoalKind, asked_jacobian, rotation_to_goal


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Joint angles and rates of motions, sampled from 0 s in steps of dt.

    Attributes:
        position, velocity: (..., T, n) rad and rad/s.
        dt: s.
    """

    position: Array
    velocity: Array
    dt: float


MotionModel = Callable[[Array, Rows], JointMotion]  # joint goals (k, n) of rows (k,) -> motions


def inverse_kinematics(
    arm: FloatingRobot,
    position: Array,
    quaternion: Array,
    start: Array,
    limits: Array,
    preferred: Array | None = None,
) -> JointGoals:
    """Joint angles that put the end-effector at poses in the BASE frame.

    Args:
        position: (N, 3) m. quaternion: (N, 4), end-effector to base.
        start: (N, n) rad, first iterate.
        limits: (n, 2) rad; no angle outside is returned.
        preferred: (N, n) rad that the redundancy is used to approach; None for `start`.
    """

    def error(q: Array, rows: Rows) -> Array:
        return pose_error(arm, q, position[rows], quaternion[rows])

    def jacobian(q: Array) -> Array:
        return arm.end_effector_jacobians(q)[1]

    return search(error, jacobian, start, limits, start if preferred is None else preferred)


def floating_inverse_kinematics(
    arm: FloatingRobot,
    goal_position: Array,
    goal_quaternion: Array,
    motion: MotionModel,
    base_position: Array,
    base_quaternion: Array,
    start: Array,
    limits: Array,
    preferred: Array | None = None,
    kind: GoalKind = "pose",
) -> JointGoals:
    """Joint goals whose motion brings the end-effector to poses in the INERTIAL frame.

    Args:
        goal_position: (N, 3) m. goal_quaternion: (N, 4), end-effector to inertial.
        motion: model of the motions (k, T, n) that will be executed to joint goals (k, n) of rows (k,); each
            ends at its goal or near it. Total momentum is zero.
        base_position, base_quaternion: (N, 3) m and (N, 4), of the base at the start.
        start, limits, preferred: as in `inverse_kinematics`. kind: of the goals.
    """

    def error(q: Array, rows: Rows) -> Array:
        path = motion(q, rows)
        positions, quaternions = roll_out_base(
            arm, path.position, path.velocity, path.dt, base_position[rows], base_quaternion[rows]
        )
        back = conjugate(quaternions[:, -1])
        place = rotate(back, goal_position[rows] - positions[:, -1])
        return pose_error(arm, path.position[:, -1], place, multiply(back, goal_quaternion[rows]), kind)

    def jacobian(q: Array) -> Array:
        found = arm.generalized_jacobian(q)
        return found if kind == "pose" else asked_jacobian(kind, found, arm.end_effector_pose(q)[1][..., 2])

    # The generalised Jacobian neglects that the base's final pose depends on the path too, an effect of
    # second order in the motion, which the iteration removes.
    return search(error, jacobian, start, limits, start if preferred is None else preferred)


def pose_error(
    arm: FloatingRobot, q: Array, position: Array, quaternion: Array, kind: GoalKind = "pose"
) -> Array:
    """Error (..., 6) [m; rad] from the end-effector to a goal of a kind in the base frame, base axes."""
    at, rotation = arm.end_effector_pose(q)
    rotation_error = rotation_to_goal(kind, from_matrix(rotation), quaternion)
    return np.concatenate([position - at, rotation_error], axis=-1)
