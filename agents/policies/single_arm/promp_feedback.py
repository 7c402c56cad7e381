"""Control from the learned distribution (shyam2020, sec. VII): the ProMP's own covariance gives the gains."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.damped_search import JointGoals
from agents.planners.common.inverse_kinematics import JointMotion
from agents.planners.single_arm.stochastic_feedback import StochasticFeedback
from agents.policies.needs import POSE
from agents.policies.single_arm.promp import ConditionalMean
from agents.policies.tracking import Plan, Steps
from space_envs.dynamics.rotations import Array
from space_envs.policy import PolicyContext

# rad and rad/s, deviations with which angles and rates are taken to be measured: they bound the gains
# where the distribution has hardly any spread, at its ends.
POSITION_NOISE, RATE_NOISE = 1e-3, 2e-3


class PrompFeedback(ConditionalMean):
    """Draws accelerations so that motions are distributed as the ProMP conditioned on start and goal.

    Gains and noise (`StochasticFeedback`) are those of the distribution that conditioning leaves, which is
    the same for all goals; only its mean depends on them. Where the distribution narrows, the expected
    acceleration leads back to the mean; while it widens, a deviation may grow as those of the demonstrations
    do. Where its spread is below that with which the state is taken to be measured, it hardly corrects.
    """

    needs = replace(POSE, joints=7, obstacles=False)

    def __init__(self, context: PolicyContext, seed: int) -> None:
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

    def follow(self, observation: Array, plan: Plan, step: Steps) -> Array:
        """Joint rates (N, n), rad/s, to which the expected accelerations lead in the control period."""
        read, every = self.context.layout.read, np.arange(len(observation))
        last = plan.position.shape[1] - 1
        now, then = np.minimum(step, last), np.minimum(step + 1, last)
        rate = read(observation, "joint_velocity")
        off = np.concatenate(
            [
                read(observation, "joint_position") - plan.position[every, now],
                rate - plan.velocity[every, now],
            ],
            axis=1,
        )
        back = np.einsum("nij,nj->ni", self._law.gain[np.minimum(step, last - 1)], off)
        return rate + plan.velocity[every, then] - plan.velocity[every, now] + self._law.period * back

    def predict(
        self,
        observation: Array,
        state: Plan | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Any]:
        """Actions (N, n) and the plans that they follow; drawn if not deterministic, else expected ones."""
        action, state = super().predict(observation, state, episode_start, deterministic)
        if deterministic:
            return action, state
        time = self.context.layout.read(observation, "time")[:, 0]
        step = np.rint((time - state.start) / self.context.control_period).astype(np.int64)
        under = step < len(self._law.spread)
        spread = self._law.spread[np.minimum(step, len(self._law.spread) - 1)]
        drawn = np.einsum("nij,nj->ni", spread, self._rng.standard_normal(action.shape))
        drawn *= self._law.period * under[:, None]
        return np.clip(action + drawn / self.context.action_scale, -1.0, 1.0), state
