"""Resolved rate of both end-effectors with the reactionless constraint, from the observation alone."""

from typing import Any

import numpy as np

from agents.policies.base import BasePolicy
from agents.policies.dual_arm.keep_clear import clear_rates
from agents.policies.dual_arm.observed import Reader
from agents.policies.needs import RENDEZVOUS
from space_envs.drives import braking_rates
from space_envs.dynamics.reactionless import (
    axis_rotation,
    end_effectors,
    reactionless_projection,
    reactionless_rates,
)
from space_envs.dynamics.rotations import Array, conjugate, logarithm, rotate, z_axis
from space_envs.policy import Knowledge, PolicyContext

GAIN = 0.5  # 1/s, of the end-effectors' error
SPEED = 0.12  # m/s, largest speed of an end-effector relative to its grapple point
ANGULAR_SPEED = 0.2  # rad/s, of an end-effector
ATTITUDE_GAIN = 0.3  # 1/s, of the attitude error
DAMPING = 0.04  # m/rad
POSTURE_GAIN = 0.05  # 1/s, towards the middle of the joint range, in the remaining null space
ACCELERATION_SHARE = 0.6  # of the drives' limit, since limits on single joints would bend the path


def track_rates(reader: Reader, observation: Array) -> Array:
    """Joint rates (N, n), rad/s, towards the grapple points and then along with them.

    The attitude stays constant, and the arms stay clear of the satellite, of the target and of each other.

    Args:
        observation: (N, size).
    """
    context = reader.context
    period, q = context.control_period, reader.field(observation, "joint_position")
    attitude = reader.quaternion(observation, "base")
    to_base = conjugate(attitude)
    # The command is reached at the end of the period, so it is computed for the configuration at that time.
    then = q + period * reader.field(observation, "joint_velocity")
    now = end_effectors(context.arm, then)
    ahead = reader.goals(observation).at(period)
    hand = reader.vectors(observation, "end_effector_position")
    hand = hand + period * reader.vectors(observation, "end_effector_linear_velocity")
    velocity = _slowed(GAIN * (ahead.position - hand), SPEED) + ahead.linear_velocity
    rotation = None
    if reader.aligned:
        axis = rotate(to_base[:, None], z_axis(ahead.quaternion))
        rotation = _slowed(GAIN * axis_rotation(now.axis, axis), ANGULAR_SPEED)
    middle = 0.5 * (context.joint_limits[:, 0] + context.joint_limits[:, 1])
    rate = reactionless_rates(
        now,
        rotate(to_base[:, None], velocity),
        rotation,
        base_rate=-ATTITUDE_GAIN * logarithm(attitude),
        posture=POSTURE_GAIN * (middle - q),
        damping=DAMPING,
    )
    return clear_rates(reader, observation, then, rate)


def _slowed(vectors: Array, most: float) -> Array:
    """Vectors (N, 2, 3), both scaled by the same factor so that neither is longer than `most`."""
    size = np.sqrt((vectors * vectors).sum(axis=-1)).max(axis=-1)
    return vectors / np.maximum(size / most, 1.0)[:, None, None]


def within_drives(reader: Reader, observation: Array, rate: Array) -> Array:
    """Rates (N, n), rad/s, slowed as a whole to the limit and so that each joint can stop before its end.

    They change no faster than the drives allow; reactionless rates stay reactionless.
    """
    context = reader.context
    now, q = reader.field(observation, "joint_velocity"), reader.field(observation, "joint_position")
    room = np.where(rate > 0.0, context.joint_limits[:, 1] - q, q - context.joint_limits[:, 0])
    fastest = braking_rates(context.robot, np.maximum(room, 0.0))
    rate = rate / np.maximum((np.abs(rate) / np.maximum(fastest, 1e-9)).max(axis=1, keepdims=True), 1.0)
    # The current rates are reactionless at the current joint angles; here they become so at the next ones.
    rotating = context.arm.base_map(q + context.control_period * now)[:, 3:]
    attitude = logarithm(reader.quaternion(observation, "base"))
    present = reactionless_projection(rotating, now, -ATTITUDE_GAIN * attitude)
    change = rate - present
    most = ACCELERATION_SHARE * context.acceleration_limit * context.control_period
    return present + change / np.maximum((np.abs(change) / most).max(axis=1, keepdims=True), 1.0)


class ReactionlessRate(BasePolicy):
    """Moves both end-effectors to their grapple points and along with them, clear of bodies in the path.

    The attitude of the satellite stays constant.
    """

    knowledge = Knowledge.MODEL
    needs = RENDEZVOUS

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        self.reader = Reader(context)

    def rates(self, observation: Array, state: Any) -> Array:
        """Joint rates (N, n), rad/s, within the limits of the drives."""
        return within_drives(self.reader, observation, track_rates(self.reader, observation))
