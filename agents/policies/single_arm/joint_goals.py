"""Following of motions to joint goals, which are replaced if the motion would touch something."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.damped_search import JointGoals
from agents.planners.common.inverse_kinematics import JointMotion
from agents.policies.clearance import KeepOut
from agents.policies.following import FollowedPlans, merged
from agents.policies.single_arm.reaching import ReachingPolicy
from space_envs.dynamics.rotations import Array
from space_envs.policy import PolicyContext

DETOURS = 8  # other joint goals that are tried if a motion touches something
DETOUR_RADIUS = 1.2  # rad, largest offset of a joint in the preferred posture of these goals


@dataclass(frozen=True, eq=False)
class JointGoalPlans(FollowedPlans):
    """Plans that end at joint goals, with the residuals of inverse kinematics."""

    goals: JointGoals

    @property
    def planned(self) -> NDArray[np.bool_]:
        """Rows (N,) whose motion leads to the goal pose."""
        return self.goals.converged


class JointGoalPolicy(ReachingPolicy):
    """Follows joint motions that a subclass plans.

    A motion that would put a link into the satellite or a sphere is planned again to other joint goals, a few
    times; if they all would, the arm stays at rest.
    """

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        random = np.random.default_rng(0)
        self._detours = random.uniform(-DETOUR_RADIUS, DETOUR_RADIUS, (DETOURS, context.arm.n_joints))

    def plan(self, observation: Array, preferred: Array | None = None) -> tuple[JointMotion, JointGoals]:
        """Motions (N, T, n), sampled at `motion_times`, and the joint goals at which they end.

        Args:
            preferred: (N, n) rad, angles that the goals approach within the redundancy; None for the start.
        """
        raise NotImplementedError

    def plans(self, observation: Array) -> JointGoalPlans:
        """Plans with sufficient clearance for the episodes that start with observations (N, size)."""
        motion, goals = self.plan(observation)
        start = self.context.layout.read(observation, "time")[:, 0]
        failures = np.full(len(observation), None, dtype=object)
        last = np.full(len(observation), motion.position.shape[1] - 1)
        plans = JointGoalPlans(motion.position, motion.velocity, start, last, failures, goals)
        keep_out = KeepOut.of(self.context, observation)
        return plans if keep_out is None else self._cleared(observation, plans, keep_out, motion.dt)

    def _cleared(
        self, observation: Array, plans: JointGoalPlans, keep_out: KeepOut, dt: float
    ) -> JointGoalPlans:
        """The plans, with motions that are not clear replaced by others, or by rest."""
        rest = self.context.layout.read(observation, "joint_position")
        rows = np.flatnonzero(~keep_out.clear(plans.position, plans.rate, dt))
        for offset in self._detours:
            if not rows.size:
                return plans
            other, goals = self.plan(observation[rows], rest[rows] + offset)
            clear = goals.converged & keep_out.take(rows).clear(other.position, other.velocity, dt)
            clear &= (np.abs(other.velocity) <= self.context.rate_limit).all(axis=(1, 2))
            found, rows = rows[clear], rows[~clear]
            better = JointGoalPlans(
                other.position[clear],
                other.velocity[clear],
                plans.start[found],
                plans.last[found],
                plans.failures[found],
                goals.take(clear),
            )
            plans = merged(plans, better, found)
        return self._resting(plans, rows, rest, keep_out, dt)

    def _resting(
        self, plans: JointGoalPlans, rows: NDArray[np.int64], rest: Array, keep_out: KeepOut, dt: float
    ) -> JointGoalPlans:
        """The plans, with the arm at rest (N, n) rad in rows (k,), and the reason why."""
        position, rate, failures = plans.position.copy(), plans.rate.copy(), plans.failures.copy()
        for row in rows:
            own = keep_out.take(np.array([row]))
            failures[row] = own.refusal(type(self).__name__, position[row], rate[row], dt)
        position[rows], rate[rows] = rest[rows, None], 0.0
        goals = plans.goals.rejected(rows, rest[rows])
        return replace(plans, position=position, rate=rate, failures=failures, goals=goals)
