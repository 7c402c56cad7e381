"""Following of a single arm's plans: a motion of given duration, then slow resolved rate to the goal."""

import numpy as np
from numpy.typing import NDArray

from agents.policies.following import FollowingPolicy
from agents.policies.needs import POSE
from agents.policies.single_arm.gjm import resolved_rate
from space_envs.dynamics.rotations import Array
from space_envs.policy import PolicyContext
from space_envs.robots.robot import Robot

DURATION = 10.0  # s, of every planned motion of a robot that is fast enough
DISPLACEMENT = 1.0  # rad, of a joint, that a minimum-jerk motion of the duration can make within the limits
EARLIEST = 0.5  # of the duration, of motions to moving goals
RESERVE = 1.0  # s, of an episode that motions to moving goals leave in addition to the hold
_JERK_RATE, _JERK_ACCELERATION = 15.0 / 8.0, 10.0 / 3.0**0.5  # its largest, for unit displacement and time
# The pose error at the end of a motion is corrected slowly, once the plan is over.
HOLD_GAIN, HOLD_LINEAR_SPEED, HOLD_ANGULAR_SPEED = 0.5, 0.02, 0.02  # 1/s, m/s, rad/s


def motion_duration(robot: Robot) -> float:
    """Duration of every planned motion of a robot, s: `DURATION`, or longer for slow joints."""
    by_rate = _JERK_RATE * DISPLACEMENT / robot.rate_limit.min()
    by_acceleration = np.sqrt(_JERK_ACCELERATION * DISPLACEMENT / robot.acceleration_limit.min())
    return max(DURATION, float(by_rate), float(by_acceleration))


def motion_times(context: PolicyContext) -> Array:
    """Sampling times (T,) of planned motions, s: whole control periods from 0 to (nearly) the longest one."""
    static = context.goals == "static"
    longest = motion_duration(context.robot) if static else interception_window(context, 0.0)[1]
    return np.arange(max(1, round(longest / context.control_period)) + 1) * context.control_period


def interception_window(context: PolicyContext, time: float) -> tuple[float, float]:
    """Earliest and latest duration, s, of motions to a moving goal that start at a time in the episode, s.

    The goal is held before the episode ends.
    """
    earliest = EARLIEST * motion_duration(context.robot)
    left = context.horizon * context.control_period - time - context.envelope.hold - RESERVE
    return earliest, max(left, earliest + context.control_period)


def held_rates(context: PolicyContext, observation: Array) -> Array:
    """Joint rates (N, n), rad/s, slowly towards the goal pose, at observations (N, size)."""
    return resolved_rate(context, observation, HOLD_GAIN, HOLD_LINEAR_SPEED, HOLD_ANGULAR_SPEED)


class ReachingPolicy(FollowingPolicy):
    """Follows a joint motion of `motion_duration`, then corrects the pose of the end-effector."""

    needs = POSE
    tracking_gain = 2.0

    def hold(self, observation: Array, planned: NDArray[np.bool_]) -> Array:
        """Joint rates (k, n), rad/s, towards the goal pose; zero without a plan."""
        return held_rates(self.context, observation) * planned
