"""The paper's receding-horizon linear-quadratic controller (shyam2020, sec. IV, eq. 12) as a policy."""

import numpy as np

from agents.planners.common.linear_quadratic import closed_loop, receding_gains
from agents.policies.following import Reference
from agents.policies.single_arm.joint_goals import JointGoalPlans
from agents.policies.single_arm.minimum_jerk import Profile, ProfilePolicy
from agents.policies.single_arm.reaching import motion_times
from space_envs.dynamics.rotations import Array
from space_envs.policy import PolicyContext

# The same for every joint, so that the joints are decoupled; only the ratio of the weights matters.
POSITION_WEIGHT = 100.0  # 1/rad^2
RATE_WEIGHT = 0.0  # s^2/rad^2
CONTROL_WEIGHT = 1.0  # s^4/rad^2


class ModelPredictive(ProfilePolicy):
    """At every step the first control of the optimal motion over the horizon, from the observed joint state.

    The joint goal comes from inverse kinematics in the base frame that the controller's own motion, as it
    predicts it, ends in.
    """

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        times = motion_times(context)
        weights = np.diag([POSITION_WEIGHT, RATE_WEIGHT])
        gains, _ = receding_gains(weights, np.array([[CONTROL_WEIGHT]]), times)
        dt = float(times[1])
        transition, _ = closed_loop(gains, dt)
        self._gains = gains[:, 0]  # (T, 2), of every joint
        self.profile = Profile(
            transition[:, 0, 0], transition[:, 1, 0], transition[:, 0, 1], transition[:, 1, 1], dt
        )

    def track(self, observation: Array, plans: JointGoalPlans, reference: Reference) -> Array:
        """Rates (N, n) after the period: those now plus the period times the optimal accelerations."""
        read = self.context.layout.read
        gain = self._gains[np.minimum(reference.step, len(self._gains) - 1)]
        rate = read(observation, "joint_velocity")
        offset = read(observation, "joint_position") - plans.goals.position
        return rate - self.context.control_period * (gain[:, :1] * offset + gain[:, 1:] * rate)
