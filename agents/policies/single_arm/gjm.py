"""Resolved motion rate control with the generalised Jacobian (Umetani and Yoshida 1989), damped."""

from typing import Any

import numpy as np

from agents.policies.base import BasePolicy
from agents.policies.goals import goal_twist
from space_envs.dynamics.rotations import Array, conjugate, rotate
from space_envs.policy import Knowledge, Needs, PolicyContext
from space_envs.tasks.goals.kinds import asked_jacobian

GAIN = 0.6  # 1/s, of the end-effector's error
LINEAR_SPEED = 0.15  # m/s, largest commanded speed of the end-effector
ANGULAR_SPEED = 0.25  # rad/s
DAMPING = 0.03  # of the inverse, in the units of the generalised Jacobian's singular values
# The drives limit every joint separately, which bends the path; below the limit the direction is unchanged.
ACCELERATION_SHARE = 0.8


def resolved_rate(
    context: PolicyContext,
    observation: Array,
    gain: float = GAIN,
    linear_speed: float = LINEAR_SPEED,
    angular_speed: float = ANGULAR_SPEED,
) -> Array:
    """Joint rates (N, n), rad/s, that move the end-effector towards the goal in the inertial frame (eq. 8).

    They are the least ones: rotations that the goal does not ask for are free. The twist gain * error,
    relative to that of the goal, is slowed as a whole to the speed limits. Total momentum is assumed to be
    zero.

    Args:
        observation: (N, size). gain: 1/s. linear_speed: m/s. angular_speed: rad/s.
    """
    arm, read = context.arm, context.layout.read
    linear, angular = read(observation, "position_error"), read(observation, "rotation_error")
    length = np.sqrt((linear * linear).sum(axis=1, keepdims=True))
    angle = np.sqrt((angular * angular).sum(axis=1, keepdims=True))
    slow = np.maximum(np.maximum(gain * length / linear_speed, gain * angle / angular_speed), 1.0)
    # The Jacobian is in base axes, the error in inertial ones.
    to_base = conjugate(read(observation, "base_quaternion"))
    twist = gain * _rotated(to_base, np.concatenate([linear, angular], axis=1)) / slow
    if context.goals == "moving":
        twist += _rotated(to_base, goal_twist(context, observation))
    q = read(observation, "joint_position")
    jacobian = arm.generalized_jacobian(q)
    if context.goal_kind != "pose":
        jacobian = asked_jacobian(context.goal_kind, jacobian, arm.end_effector_pose(q)[1][..., 2])
    square = jacobian @ jacobian.swapaxes(1, 2) + DAMPING**2 * np.eye(6)
    rate = (jacobian.swapaxes(1, 2) @ np.linalg.solve(square, twist[..., None]))[..., 0]
    return rate / np.maximum((np.abs(rate) / context.rate_limit).max(axis=1, keepdims=True), 1.0)


def _rotated(quaternion: Array, twist: Array) -> Array:
    """Twists (N, 6) [v; w] rotated by quaternions (N, 4)."""
    return np.concatenate([rotate(quaternion, twist[:, :3]), rotate(quaternion, twist[:, 3:])], axis=1)


class GeneralizedJacobian(BasePolicy):
    """Moves the end-effector straight towards the goal and then along with it.

    It rotates the base and ignores bodies in its path.
    """

    knowledge = Knowledge.MODEL
    needs = Needs(
        fields=("joint_position", "joint_velocity", "base_quaternion", "position_error", "rotation_error"),
        control_modes=("joint_velocity",),
        arms=1,
    )

    def rates(self, observation: Array, state: Any) -> Array:
        """Joint rates (N, n), rad/s, that change no faster than the drives allow."""
        context = self.context
        now = context.layout.read(observation, "joint_velocity")
        change = resolved_rate(context, observation) - now
        most = ACCELERATION_SHARE * context.acceleration_limit * context.control_period
        return now + change / np.maximum((np.abs(change) / most).max(axis=1, keepdims=True), 1.0)
