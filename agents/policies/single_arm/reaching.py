"""Following of a single arm's plans: a motion of fixed duration, then slow resolved rate to the goal pose."""

import numpy as np
from numpy.typing import NDArray

from agents.policies.following import FollowingPolicy
from agents.policies.needs import POSE
from agents.policies.single_arm.gjm import resolved_rate
from space_envs.dynamics.rotations import Array
from space_envs.policy import PolicyContext

DURATION = 10.0  # s, of every planned motion
# The pose error at the end of a motion is corrected slowly, once the plan is over.
HOLD_GAIN, HOLD_LINEAR_SPEED, HOLD_ANGULAR_SPEED = 0.5, 0.02, 0.02  # 1/s, m/s, rad/s


def motion_times(context: PolicyContext) -> Array:
    """Sampling times (T,) of a planned motion, s: whole control periods from 0 to (nearly) the duration."""
    return np.arange(max(1, round(DURATION / context.control_period)) + 1) * context.control_period


class ReachingPolicy(FollowingPolicy):
    """Follows a joint motion of `DURATION`, then corrects the pose of the end-effector."""

    needs = POSE
    tracking_gain = 2.0

    def hold(self, observation: Array, planned: NDArray[np.bool_]) -> Array:
        """Joint rates (k, n), rad/s, towards the goal pose; zero without a plan."""
        rate = resolved_rate(self.context, observation, HOLD_GAIN, HOLD_LINEAR_SPEED, HOLD_ANGULAR_SPEED)
        return rate * planned
