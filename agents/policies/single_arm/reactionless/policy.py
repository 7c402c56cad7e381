"""Following of paths in the reaction null space, and feedback that stays in it."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.library import find_reactionless_library, reactionless_command
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.reactionless.planner import ReactionlessPlanner, Timing
from agents.policies.clearance import KeepOut
from agents.policies.following import FollowedPlans, FollowingPolicy, Reference, sampled_plans
from agents.policies.goals import goal_twist
from agents.policies.needs import POSE
from agents.policies.single_arm.optimal import clear_plans, reaches
from agents.policies.single_arm.reactionless.problem import latest_arrival, path_limits
from space_envs.dynamics.reactionless import end_effectors, reactionless_projection, reactionless_rates
from space_envs.dynamics.rotations import Array, conjugate, rotate
from space_envs.policy import PolicyContext

TRACKING_GAIN = 2.0  # 1/s, of the joint error
ATTITUDE_GAIN = 1.0  # 1/s, of the attitude error
HOLD_GAIN = 0.5  # 1/s, of the pose error once a plan is over
HOLD_SPEED = 0.02  # m/s and rad/s


class PrompReactionless(FollowingPolicy):
    """Follows a path in the reaction null space with feedback that stays in it.

    It arrives at the end of the episode, with the least disturbance, or with timing "shortest" as soon as the
    limits allow. Its last rows feed back the attitude error, and the rate of the base that unmodelled masses
    leave.
    """

    needs = replace(POSE, fields=(*POSE.fields, "base_angular_velocity"), joints=7, planar=False, goals=None)
    tracking_gain = TRACKING_GAIN

    def __init__(self, context: PolicyContext, seed: int = 0, timing: Timing = "latest") -> None:
        super().__init__(context, seed)
        library = find_reactionless_library(context.robot)
        self.planner = ReactionlessPlanner(context.arm, path_limits(context), library, timing)
        self._stored = library is not None

    def plan(self, asked: list[Reach], observation: Array | None = None) -> list[ReachPlan | Failure]:
        """Plans of all rows, which are of observations (N, size).

        Without a library, failures of the search name the command that makes it.
        """
        plans = [self.planner.plan(reach) for reach in asked]
        return plans if self._stored else [self._with_command(plan) for plan in plans]

    def _with_command(self, plan: ReachPlan | Failure) -> ReachPlan | Failure:
        if not isinstance(plan, Failure) or plan.cause is Cause.OUT_OF_REACH:
            return plan
        robot = self.context.robot
        advice = f"starts were random, `{reactionless_command(robot)}` makes a library of {robot.name!r}"
        return replace(plan, reason=f"{plan.reason}; {advice}")

    def plans(self, observation: Array) -> FollowedPlans:
        """Plans of the episodes that start with observations (N, size), to the end of the episode."""
        context, read = self.context, self.context.layout.read
        time = read(observation, "time")[:, 0]
        latest = np.maximum(latest_arrival(context) - time, context.control_period)
        asked = reaches(context, observation, keep_attitude=True)
        asked = [replace(one, duration=t) for one, t in zip(asked, latest, strict=True)]
        plans = self.plan(asked, observation)
        count = int(np.ceil(latest.max(initial=context.control_period) / context.control_period))
        times = np.arange(count + 1) * context.control_period
        if asked and asked[0].spheres is not None:  # the planner knows links from joint to joint alone
            plans = clear_plans(plans, times, KeepOut.of(context, observation))
        return sampled_plans(read(observation, "joint_position"), plans, times, time)

    def track(self, observation: Array, plans: FollowedPlans, reference: Reference) -> Array:
        """Joint rates (N, n), rad/s, nearest to the plans' that turn the base as `_base_rate` says."""
        wanted = super().track(observation, plans, reference)
        angular = self.context.arm.base_map(reference.next_position)[:, 3:]
        return reactionless_projection(angular, wanted, self._base_rate(observation))

    def hold(self, observation: Array, planned: NDArray[np.bool_]) -> Array:
        """Joint rates (k, n), rad/s, towards the goal and along with it that do not turn the base.

        They are zero without a plan.
        """
        read = self.context.layout.read
        to_base = conjugate(read(observation, "base_quaternion"))
        now = end_effectors(self.context.arm, read(observation, "joint_position"))
        linear, angular = (
            _limited(HOLD_GAIN * rotate(to_base, read(observation, name)))[:, None]
            for name in ("position_error", "rotation_error")
        )
        if self.context.goals == "moving":
            twist = goal_twist(self.context, observation)
            linear += rotate(to_base, twist[:, :3])[:, None]
            angular += rotate(to_base, twist[:, 3:])[:, None]
        asked = None if self.context.goal_kind == "position" else angular
        return reactionless_rates(now, linear, asked, self._base_rate(observation)) * planned

    def _base_rate(self, observation: Array) -> Array:
        """Angular velocity (N, 3) of the base, rad/s in its axes, that nominal masses are asked for."""
        read = self.context.layout.read
        quaternion = read(observation, "base_quaternion")
        error = 2.0 * quaternion[:, 1:] * np.copysign(1.0, quaternion[:, :1])  # of small rotations, base axes
        rate = read(observation, "joint_velocity")
        angular = self.context.arm.base_map(read(observation, "joint_position"))[:, 3:]
        expected = (angular @ rate[..., None])[..., 0]
        seen = rotate(conjugate(quaternion), read(observation, "base_angular_velocity"))
        return -ATTITUDE_GAIN * error - (seen - expected)


def _limited(rate: Array) -> Array:
    """Rates (k, 3), slowed as a whole to the speed limit."""
    length = np.sqrt((rate * rate).sum(axis=1, keepdims=True))
    return rate / np.maximum(length / HOLD_SPEED, 1.0)
