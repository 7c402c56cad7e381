"""The reactionless planners as policies: plan when an episode starts, follow the plan, hold the target."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.clearance import gaps
from agents.planners.dual_arm.free_paths.planner import plan_free
from agents.planners.dual_arm.prescribed_paths.instantaneous import plan_local, plan_zeta_zero
from agents.planners.dual_arm.prescribed_paths.ocp import plan_ocp
from agents.planners.dual_arm.problem import Capture, CapturePlan
from agents.planners.dual_arm.surroundings import Surroundings, tumbling_target
from agents.policies.clearance import MARGIN, link_radii
from agents.policies.dual_arm.observed import Reader
from agents.policies.dual_arm.reactionless_rate import track_rates, within_drives
from agents.policies.following import FollowedPlans, FollowingPolicy, Reference, sampled_plans
from agents.policies.needs import RENDEZVOUS
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.reactionless import reactionless_projection
from space_envs.dynamics.rotations import Array, conjugate, logarithm, multiply, rotate
from space_envs.errors import ConfigurationError
from space_envs.policy import PolicyContext
from space_envs.robots.robot import UNCHECKED, Robot
from space_envs.tasks.goals.tumbling import RENDEZVOUS_TIME

CHECKS = 201  # times at which the clearance of a plan is checked
_ALWAYS = 1e9  # s before the end at which grippers open: from the start
ATTITUDE_GAIN = 0.3  # 1/s, of the attitude error


@dataclass(frozen=True, eq=False)
class PlannerInput:
    """Input of one planner call, in the frame of the satellite at the start of the plan.

    Attributes:
        robot: with two arms, and a target. mechanics: its momentum-level mathematics.
        capture: boundary conditions. limits: of the joints.
        centre (3,) m, attitude (4,), spin (3,) rad/s: of the target at the start, which rotates freely.
        half_width: m, of the target.
    """

    robot: Robot
    mechanics: FloatingRobot
    capture: Capture
    limits: Limits
    centre: Array
    attitude: Array
    spin: Array
    half_width: float

    @property
    def surroundings(self) -> Surroundings:
        """Bodies from which the arms keep their distance."""
        satellite, target = self.robot.satellite, self.robot.target
        if target is None:
            raise ConfigurationError(f"the robot {self.robot.name!r} has no target, which takes two arms")
        return Surroundings(
            radius=float(link_radii(self.robot).max()),
            bus=np.array(satellite.box) if satellite.reachable else None,
            bus_centre=np.array(satellite.box_centre),
            standing=standing_links(self.robot),
            target=np.array(target.body) * self.half_width / target.half_width,
            motion=tumbling_target(self.centre, self.attitude, self.spin, np.array(target.inertia)),
            gripper=target.gripper,
        )

    def checked(self, plan: CapturePlan | Failure) -> CapturePlan | Failure:
        """The plan, or the failure of a plan in which the arms touch something.

        The gripper counts by its centre line all the time, as it does in the simulation.
        """
        if isinstance(plan, Failure):
            return plan
        around = replace(self.surroundings, contact=_ALWAYS)
        times = np.linspace(0.0, self.capture.duration, CHECKS)
        path = plan.sample(times)[0]
        found = gaps(self.mechanics, around, times, path, self.capture.duration, self.capture.start)
        if found.least > MARGIN:
            return plan
        what, node = found.worst()
        reason = f"{what} would come to {found.least:.3f} m at t = {times[node]:.2f} s"
        return Failure(plan.method, Cause.CLEARANCE, reason)


def standing_links(robot: Robot) -> int:
    """Number of links at the root of each arm whose capsules are not checked against the satellite."""
    checked = [
        capsule.link for arm in robot.arms for capsule in arm.capsules if capsule.satellite > UNCHECKED
    ]
    return min(checked, default=1) - 1


class ReactionlessPolicy(FollowingPolicy):
    """Plans with a method of `agents.planners.dual_arm`; without a plan the arms stay at rest.

    The plan ends `RENDEZVOUS_TIME` seconds after the start of the episode, with both end-effectors as fast as
    their grapple points; from then on the resolved rate of `reactionless_rate` stays with them.
    """

    needs = RENDEZVOUS
    tracking_gain = 1.0

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        self.reader = Reader(context)
        self._samples = round(RENDEZVOUS_TIME / context.control_period)

    @staticmethod
    def plan(task: PlannerInput) -> CapturePlan | Failure:
        """The plan of one episode."""
        raise NotImplementedError

    def inputs(self, observation: Array) -> list[PlannerInput]:
        """Planner inputs of episodes that start with observations (N, size)."""
        reader, context = self.reader, self.context
        origin = reader.vector(observation, "base_position")
        to_base = conjugate(reader.quaternion(observation, "base"))
        centre = reader.vector(observation, "target_position")
        points = reader.vectors(observation, "goal_position") - centre.reshape(-1, 1, 3)
        width = np.sqrt((points * points).sum(axis=-1)).mean(axis=-1)
        limits = Limits(
            position=context.joint_limits,
            rate=context.rate_limit,
            acceleration=context.acceleration_limit,
            torque=context.model.actuator_forcerange[:, 1],
        )
        captures = self._captures(observation, origin, to_base)
        centre = rotate(to_base, centre - origin)
        attitude = multiply(to_base, reader.quaternion(observation, "target"))
        spin = rotate(to_base, reader.vector(observation, "target_angular_velocity"))
        targets = zip(captures, centre, attitude, spin, width.tolist(), strict=True)
        known = context.robot, context.arm
        return [PlannerInput(*known, capture, limits, *target) for capture, *target in targets]

    def _captures(self, observation: Array, origin: Array, to_base: Array) -> list[Capture]:
        """Boundary conditions (N) at the rendezvous, in the frames of the satellites at (N, 3), (N, 4)."""
        reader = self.reader
        ahead = RENDEZVOUS_TIME - reader.field(observation, "time")[:, 0]
        start = reader.field(observation, "joint_position")
        goals = reader.goals(observation).in_frame(origin[:, None], conjugate(to_base)[:, None])
        return [
            Capture(start[row], float(ahead[row]), goals.row(row), reader.aligned)
            for row in range(len(start))
        ]

    def plans(self, observation: Array) -> FollowedPlans:
        """Plans with sufficient clearance for the episodes that start with observations (N, size)."""
        tasks = self.inputs(observation)
        plans: Any = Parallel(n_jobs=self.context.jobs)(delayed(self.plan)(task) for task in tasks)
        if self.context.contacts is not None:
            plans = [task.checked(plan) for task, plan in zip(tasks, plans, strict=True)]
        times = np.arange(self._samples + 1) * self.context.control_period
        rest, start = (self.reader.field(observation, name) for name in ("joint_position", "time"))
        return sampled_plans(rest, list(plans), times, start[:, 0])

    def track(self, observation: Array, plans: FollowedPlans, reference: Reference) -> Array:
        """Joint rates (N, n), rad/s, along the plans, with feedback of the attitude error."""
        rate = super().track(observation, plans, reference)
        rotating = self.context.arm.base_map(reference.next_position)[:, 3:]
        attitude = logarithm(self.reader.quaternion(observation, "base"))
        return reactionless_projection(rotating, rate, -ATTITUDE_GAIN * attitude)

    def hold(self, observation: Array, planned: NDArray[np.bool_]) -> Array:
        """Joint rates (k, n), rad/s, that keep the end-effectors at their grapple points."""
        rate = track_rates(self.reader, observation) * planned
        return within_drives(self.reader, observation, rate)


class ReactionlessZetaZero(ReactionlessPolicy):
    """Polynomial end-effector paths with zeta = 0."""

    @staticmethod
    def plan(task: PlannerInput) -> CapturePlan | Failure:
        """Method (a)."""
        return plan_zeta_zero(task.mechanics, task.capture, task.limits)


class ReactionlessLocal(ReactionlessPolicy):
    """Polynomial end-effector paths with the least kinetic energy at each instant."""

    @staticmethod
    def plan(task: PlannerInput) -> CapturePlan | Failure:
        """Method (b)."""
        return plan_local(task.mechanics, task.capture, task.limits)


class ReactionlessOCP(ReactionlessPolicy):
    """Polynomial end-effector paths with the least energy over the motion, from rest.

    In space the approach axes are aligned at the end of the plan.
    """

    @staticmethod
    def plan(task: PlannerInput) -> CapturePlan | Failure:
        """Method (c)."""
        return plan_ocp(task.mechanics, task.capture, task.limits, from_rest=True)


class ReactionlessFree(ReactionlessPolicy):
    """Paths free between their ends, clear of everything, with the least energy over the motion."""

    @staticmethod
    def plan(task: PlannerInput) -> CapturePlan | Failure:
        """Method (d)."""
        return plan_free(task.mechanics, task.capture, task.limits, task.surroundings)
