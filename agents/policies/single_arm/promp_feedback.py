"""Control from the learned distribution (shyam2020, sec. VII): the ProMP's own covariance gives the gains."""

from dataclasses import replace

import numpy as np

from agents.planners.common.damped_search import JointGoals
from agents.planners.common.inverse_kinematics import JointMotion
from agents.policies.following import FollowedPlans, Reference
from agents.policies.needs import POSE
from agents.policies.single_arm.promp import ConditionalMean, missing_prior
from agents.policies.single_arm.stochastic_feedback import StochasticFeedback
from space_envs.dynamics.rotations import Array
from space_envs.policy import PolicyContext

# rad and rad/s, assumed standard deviations of measured angles and rates: they bound the gains
# where the distribution has hardly any spread, at its ends.
POSITION_NOISE, RATE_NOISE = 1e-3, 2e-3


class PrompFeedback(ConditionalMean):
    """Draws accelerations so that motions are distributed as the ProMP conditioned on start and goal.

    Gains and noise (`StochasticFeedback`) are those of the conditional distribution, which is
    the same for all goals; only its mean depends on them. Where the distribution narrows, the expected
    acceleration leads back to the mean; while it widens, a deviation may grow as those of the demonstrations
    do. Where its spread is below that with which the state is taken to be measured, it hardly corrects.
    """

    needs = replace(POSE, obstacles=False, other=missing_prior)

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        self._law = StochasticFeedback.of(
            self._prior.free,
            float(self._prior.times[-1]),
            context.control_period,
            POSITION_NOISE,
            RATE_NOISE,
        )
        self._rng = np.random.default_rng(seed)

    def plan(self, observation: Array, preferred: Array | None = None) -> tuple[JointMotion, JointGoals]:
        """The conditional mean as accelerations that are held for a control period lead along it."""
        motion, goals = super().plan(observation, preferred)
        moved = 0.5 * motion.dt * (motion.velocity[:, 1:] + motion.velocity[:, :-1]).cumsum(axis=1)
        position = np.concatenate([motion.position[:, :1], motion.position[:, :1] + moved], axis=1)
        return JointMotion(position, motion.velocity, motion.dt), goals

    def track(self, observation: Array, plans: FollowedPlans, reference: Reference) -> Array:
        """Joint rates (N, n), rad/s, to which the expected accelerations lead in the control period."""
        read = self.context.layout.read
        rate = read(observation, "joint_velocity")
        deviation = np.concatenate(
            [read(observation, "joint_position") - reference.position, rate - reference.rate], axis=1
        )
        feedback = self._law.feedback(reference.step, deviation)
        return rate + reference.next_rate - reference.rate + self._law.period * feedback

    def actions(self, observation: Array, state: FollowedPlans, deterministic: bool) -> Array:
        """Actions (N, n) by expected accelerations, or by accelerations that are drawn around them."""
        action = super().actions(observation, state, deterministic)
        if deterministic:
            return action
        time = self.context.layout.read(observation, "time")[:, 0]
        step = state.reference(time, self.context.control_period).step
        change = self._law.period * self._law.noise(step, self._rng)
        return np.clip(action + change / self.context.action_scale, -1.0, 1.0)
