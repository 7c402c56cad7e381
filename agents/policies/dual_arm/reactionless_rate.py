"""Resolved rate of both end-effectors with the reactionless constraint, from the observation alone."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.policies.dual_arm.keep_clear import clear_rates
from agents.policies.dual_arm.observed import Reader
from agents.policies.needs import RENDEZVOUS
from space_envs.control import BRAKING
from space_envs.dynamics.reactionless import axis_turn, keep_attitude, reactionless_rates, tips
from space_envs.dynamics.rotations import Array, conjugate, logarithm, rotate
from space_envs.policy import PolicyContext

GAIN = 0.5  # 1/s, of the end-effectors' error
SPEED = 0.12  # m/s, the most an end-effector is asked for beyond what the grapple point does
TURN_SPEED = 0.2  # rad/s
ATTITUDE_GAIN = 0.3  # 1/s, of the attitude that is left
DAMPING = 0.04  # m/rad
POSTURE_GAIN = 0.05  # 1/s, towards the middle of the joint range, where nothing else is asked
ACCELERATION_SHARE = 0.6  # of the drives' limit; they limit each joint on its own, which bends the path


def track_rates(reader: Reader, observation: Array) -> Array:
    """Joint rates (N, n), rad/s, towards the grapple points and then along with them, the attitude kept and
    the arms clear of the satellite, of the target and of each other.

    Args:
        observation: (N, size).
    """
    context = reader.context
    period, q = context.control_period, reader.field(observation, "joint_position")
    attitude = reader.quaternion(observation, "base")
    back = conjugate(attitude)
    # The command is reached at the end of the period, so it is made for the configuration then.
    then = q + period * reader.field(observation, "joint_velocity")
    now = tips(context.arm, then)
    ahead = reader.grapples(observation, np.array([period]))
    hand = reader.vectors(observation, "end_effector_position")
    hand = hand + period * reader.vectors(observation, "end_effector_linear_velocity")
    wanted = _slowed(GAIN * (ahead.position[:, 0] - hand), SPEED) + ahead.velocity[:, 0]
    turn = None
    if ahead.axis is not None:
        turn = _slowed(GAIN * axis_turn(now.axis, rotate(back[:, None], ahead.axis[:, 0])), TURN_SPEED)
    middle = 0.5 * (context.joint_limits[:, 0] + context.joint_limits[:, 1])
    rate = reactionless_rates(
        now,
        rotate(back[:, None], wanted),
        turn,
        base_rate=-ATTITUDE_GAIN * logarithm(attitude),
        posture=POSTURE_GAIN * (middle - q),
        damping=DAMPING,
    )
    return clear_rates(reader, observation, then, rate)


def _slowed(wanted: Array, most: float) -> Array:
    """Vectors (N, 2, 3), both scaled alike so that neither is longer than `most`."""
    size = np.sqrt((wanted * wanted).sum(axis=-1)).max(axis=-1)
    return wanted / np.maximum(size / most, 1.0)[:, None, None]


def limited(reader: Reader, observation: Array, rate: Array) -> Array:
    """Actions (N, n) for rates (N, n), slowed as a whole to the rate limit and so that every joint can stop
    before its end, and changed no faster than the drives can; all of it keeps reactionless motion so."""
    context = reader.context
    now, q = reader.field(observation, "joint_velocity"), reader.field(observation, "joint_position")
    room = np.where(rate > 0.0, context.joint_limits[:, 1] - q, q - context.joint_limits[:, 0])
    fastest = np.minimum(np.sqrt(2.0 * BRAKING * np.maximum(room, 0.0)), context.rate_limit)
    rate = rate / np.maximum((np.abs(rate) / np.maximum(fastest, 1e-9)).max(axis=1, keepdims=True), 1.0)
    # The present motion leaves the base alone where the joints are; here it is where they will be.
    turning = context.arm.base_map(q + context.control_period * now)[:, 3:]
    attitude = logarithm(reader.quaternion(observation, "base"))
    present = keep_attitude(turning, now, -ATTITUDE_GAIN * attitude)
    change = rate - present
    most = ACCELERATION_SHARE * context.acceleration_limit * context.control_period
    rate = present + change / np.maximum(np.abs(change).max(axis=1, keepdims=True) / most, 1.0)
    return np.clip(rate / context.action_scale, -1.0, 1.0)


class ReactionlessRate:
    """Moves both end-effectors towards their grapple points and along with them, clear of what may not be
    touched, the attitude kept."""

    needs = RENDEZVOUS

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        self.context = context
        self.reader = Reader(context)

    def predict(
        self,
        observation: Array,
        state: Any = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        """Actions (N, n); there is no state."""
        observation = self.context.check_observation(observation)
        rate = track_rates(self.reader, observation)
        return limited(self.reader, observation, rate), None
