"""Policies that plan an optimal motion at the start of an episode, and follow it to the goal pose."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any, Protocol

import numpy as np
from joblib import Parallel, delayed

from agents.planners.common.plans import Failure, Limits
from agents.planners.common.robot_files import shipped_robots
from agents.planners.single_arm.collocation.ocp import plan_ocp
from agents.planners.single_arm.inequalities.braking import Braking
from agents.planners.single_arm.inequalities.satellite import SatelliteClearance
from agents.planners.single_arm.library import find_library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.weights.sqp import Rows
from agents.planners.single_arm.weights.weight_space import WeightSpace
from agents.policies.clearance import SPHERE_MARGIN, KeepOut, link_radii, spheres_seen
from agents.policies.following import FollowedPlans, sampled_plans
from agents.policies.goals import observed_goals
from agents.policies.needs import POSE
from agents.policies.single_arm.reaching import (
    ReachingPolicy,
    interception_window,
    motion_duration,
    motion_times,
)
from space_envs.drives import CORIOLIS_SHARE, braking_deceleration
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.policy import PolicyContext
from space_envs.tasks.contacts import Contacts

STARTS, STARTS_AMONG_SPHERES = 1, 4  # initial guesses of the collocation
TORQUE_SHARE = 0.9  # of the torque limit of the drives, available to a plan


def drive_limits(context: PolicyContext) -> Limits:
    """Limits within which the drives follow a motion, with a margin for torques held over a period."""
    torque = context.model.actuator_forcerange[:, 1]
    return Limits(
        position=context.joint_limits,
        rate=context.rate_limit,
        acceleration=context.acceleration_limit,
        torque=TORQUE_SHARE * torque,
        coriolis=TORQUE_SHARE * CORIOLIS_SHARE * torque,
    )


def further_rows(
    context: PolicyContext, limited: bool = True
) -> Callable[[WeightSpace], tuple[Rows, ...]] | None:
    """Inequalities that keep plans clear of the satellite and, where limited, slow before the joints' ends.

    None for robots whose libraries ship: their motions ignore both, which hardly ever matters to those
    robots, and so do the plans that start from them.
    """
    if context.robot.digest in shipped_robots():
        return None
    deceleration, clear = braking_deceleration(context.robot), satellite_rows(context)

    def rows(space: WeightSpace) -> tuple[Rows, ...]:
        braking = (Braking(space, deceleration, context.joint_limits),) if limited else ()
        return braking if clear is None else (*braking, *clear(space))

    return rows


def satellite_rows(context: PolicyContext) -> Callable[[WeightSpace], tuple[Rows, ...]] | None:
    """Inequalities that keep plans clear of the satellite; None if contacts are not checked."""
    contacts = context.contacts
    if contacts is None:
        return None
    gaps = partial(_satellite_gaps, contacts, context.arm)
    return lambda space: (SatelliteClearance(space, gaps),)


def _satellite_gaps(contacts: Contacts, arm: FloatingRobot, q: Array) -> Array:
    return contacts.satellite_gaps(contacts.points(arm, q))


def reaches(context: PolicyContext, observation: Array, keep_attitude: bool) -> list[Reach]:
    """Problem of each row, in the current frame of the base, with a margin around spheres."""

    def read(name: str) -> Array:
        return context.layout.read(observation, name)

    goals, time = observed_goals(context, observation), read("time")[:, 0].tolist()
    goals = goals.in_frame(read("base_position"), read("base_quaternion"))
    start, rate = read("joint_position"), read("joint_velocity")
    duration, spheres = motion_duration(context.robot), spheres_seen(context, observation)
    if spheres is not None:
        spheres[..., 3] += SPHERE_MARGIN
    return [
        Reach(
            start[row],
            goals.row(row),
            duration,
            rate[row],
            keep_attitude,
            context.c,
            None if spheres is None else spheres[row],
            link_radii(context.robot),
            kind=context.goal_kind,
            window=interception_window(context, time[row]) if context.goals == "moving" else None,
        )
        for row in range(len(start))
    ]


class ReachPlanner(Protocol):
    """Plans one reach at a time."""

    def plan(self, reach: Reach) -> ReachPlan | Failure:
        """The motion, or the failure."""
        ...


class OptimalPolicy(ReachingPolicy):
    """Follows the motion of a subclass's planner. Without a plan the arm stays at rest."""

    keep_attitude = False  # whether the final attitude of the base is constrained to its initial attitude
    planner: ReachPlanner

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        self.limits = drive_limits(context)

    def plan(self, reaches: list[Reach]) -> list[ReachPlan | Failure]:
        """Plans of all rows."""
        return [self.planner.plan(reach) for reach in reaches]

    def plans(self, observation: Array) -> FollowedPlans:
        """Plans with sufficient clearance for the episodes that start with observations (N, size)."""
        read = self.context.layout.read
        plans = self.plan(reaches(self.context, observation, self.keep_attitude))
        times = motion_times(self.context)
        plans = clear_plans(plans, times, KeepOut.of(self.context, observation))
        return sampled_plans(
            read(observation, "joint_position"), plans, times, read(observation, "time")[:, 0]
        )


def clear_plans(
    plans: list[ReachPlan | Failure], times: Array, keep_out: KeepOut | None
) -> list[ReachPlan | Failure]:
    """Plans of N episodes; failures in place of those in which a link touches something at times (T,) s."""
    if keep_out is None:
        return plans
    rows = np.arange(len(plans))[:, None]
    return [_checked(plan, times, keep_out.take(row)) for plan, row in zip(plans, rows, strict=True)]


def _checked(plan: ReachPlan | Failure, times: Array, keep_out: KeepOut) -> ReachPlan | Failure:
    """The plan, or the failure of a plan in which a link touches something."""
    if isinstance(plan, Failure):
        return plan
    times = times[: np.abs(times - plan.time[-1]).argmin() + 1]
    path, rate, _ = plan.sample(times)
    return keep_out.refusal(plan.method, path, rate, float(times[1])) or plan


class OptimalControl(OptimalPolicy):
    """Minimum base disturbance (eq. 20) by collocation; the final attitude is unconstrained.

    From the motion of `promp_optimal`, and from others where there are spheres or that one leads nowhere.
    """

    needs = replace(POSE, goals=None)

    def plan(self, reaches: list[Reach]) -> list[ReachPlan | Failure]:
        """Plans of all rows, about a tenth of a second each, in as many processes as the context allows."""
        context = self.context
        library = find_library(context.robot, self.keep_attitude)
        work = [
            delayed(plan_ocp)(
                context.model,
                context.arm,
                reach,
                self.limits,
                library=library,
                starts=STARTS if reach.spheres is None else STARTS_AMONG_SPHERES,
            )
            for reach in reaches
        ]
        plans: Any = Parallel(n_jobs=context.jobs)(work)
        return list(plans)
