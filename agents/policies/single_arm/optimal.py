"""Policies that plan an optimal motion where an episode begins, follow it, and then stay with the goal."""

from dataclasses import replace
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from agents.planners.common.plans import Failure, Limits
from agents.planners.single_arm.collocation.ocp import plan_ocp
from agents.planners.single_arm.library import shipped_library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.weights.promp_optimal import Planner
from agents.policies.clearance import ASKED, KeepOut, spheres_seen
from agents.policies.gjm import resolved_rate
from agents.policies.needs import POSE
from agents.policies.tracking import (
    DURATION,
    HOLD_ANGULAR_SPEED,
    HOLD_GAIN,
    HOLD_LINEAR_SPEED,
    TRACKING_GAIN,
    Following,
    continued,
    following,
    motion_times,
)
from space_envs.control import CORIOLIS_SHARE
from space_envs.dynamics.rotations import Array, conjugate, multiply, rotate
from space_envs.policy import PolicyContext

STARTS = 4  # of the collocation
TORQUE_ROOM = 0.9  # share of the torque at which drives give way that a plan uses


def drive_limits(context: PolicyContext) -> Limits:
    """Limits within which the drives follow a motion; a torque that is held over a period needs some room."""
    torque = float(context.model.actuator_forcerange[0, 1])
    return Limits(
        position=context.joint_limits,
        rate=context.rate_limit,
        acceleration=context.acceleration_limit,
        torque=TORQUE_ROOM * torque,
        coriolis=TORQUE_ROOM * CORIOLIS_SHARE * torque,
    )


def reaches(context: PolicyContext, observation: Array, keep_attitude: bool) -> list[Reach]:
    """What is asked in each row, in the frame of the base as it is now, with some room around spheres."""

    def read(name: str) -> Array:
        return context.layout.read(observation, name)

    back, origin = conjugate(read("base_quaternion")), read("base_position")
    position = rotate(back, read("goal_position") - origin)
    quaternion = multiply(back, read("goal_quaternion"))
    start, rate = read("joint_position"), read("joint_velocity")
    spheres = spheres_seen(context, observation)
    if spheres is not None:
        spheres[..., 3] += ASKED
    return [
        Reach(
            start[row],
            position[row],
            quaternion[row],
            DURATION,
            rate[row],
            keep_attitude,
            context.c,
            None if spheres is None else spheres[row],
        )
        for row in range(len(start))
    ]


class OptimalPolicy:
    """Follows what a subclass plans, with feedback of the joint angles. Without a plan the arm rests."""

    needs = POSE
    keep_attitude = False

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        self.context, self.limits = context, drive_limits(context)

    def plan(self, asked: list[Reach]) -> list[ReachPlan | Failure]:
        """Plans of all rows."""
        raise NotImplementedError

    def _plans(self, observation: Array) -> Following:
        read = self.context.layout.read
        plans = self.plan(reaches(self.context, observation, self.keep_attitude))
        rest, start = read(observation, "joint_position"), read(observation, "time")[:, 0]
        times, keep_out = motion_times(self.context), KeepOut.of(self.context, observation)
        if keep_out is not None:
            rows = np.arange(len(plans))[:, None]
            plans = [_checked(plan, times, keep_out.take(row)) for plan, row in zip(plans, rows, strict=True)]
        return following(rest, plans, times, start)

    def predict(
        self,
        observation: Array,
        state: Following | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Following]:
        """Actions (N, n) and the plans that they follow."""
        context, read = self.context, self.context.layout.read
        observation = context.check_observation(observation)
        state = continued(state, observation, episode_start, self._plans)
        time, angle = read(observation, "time")[:, 0], read(observation, "joint_position")
        now, _, rate, over = state.reference(time, context.control_period)
        rate = rate + TRACKING_GAIN * (now - angle)
        if over.size:
            hold = resolved_rate(context, observation[over], HOLD_GAIN, HOLD_LINEAR_SPEED, HOLD_ANGULAR_SPEED)
            rate[over] = hold * state.planned[over, None]
        return np.clip(rate / context.action_scale, -1.0, 1.0), state


def _checked(plan: ReachPlan | Failure, times: Array, keep_out: KeepOut) -> ReachPlan | Failure:
    """The plan, or why it is none: a motion that puts a link into something is not followed."""
    if isinstance(plan, Failure):
        return plan
    path, rate, _ = plan.sample(times)
    return keep_out.refusal(plan.method, path, rate, float(times[1])) or plan


class OptimalControl(OptimalPolicy):
    """Least eq. 20 by collocation from several starts; the attitude is free."""

    def plan(self, asked: list[Reach]) -> list[ReachPlan | Failure]:
        """Plans of all rows, about half a second each, in as many processes as the context allows."""
        context = self.context
        work = [
            delayed(plan_ocp)(context.model, context.arm, reach, self.limits, starts=STARTS)
            for reach in asked
        ]
        plans: Any = Parallel(n_jobs=context.jobs)(work)
        return list(plans)


class PrompOptimal(OptimalPolicy):
    """Least eq. 20 in the weights of a ProMP, from stored optimal motions; the attitude is free."""

    needs = replace(POSE, joints=7)

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        self._planner = Planner(context.arm, self.limits, shipped_library(self.keep_attitude))

    def plan(self, asked: list[Reach]) -> list[ReachPlan | Failure]:
        """Plans of all rows, in milliseconds each."""
        return [self._planner.plan(reach) for reach in asked]


class PrompOptimalKept(PrompOptimal):
    """The same with the base's first attitude at the end."""

    keep_attitude = True
