"""The reactionless planners as policies: plan where an episode starts, follow, then stay with the target."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from joblib import Parallel, delayed
from numpy.typing import NDArray

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.clearance import Surroundings, gaps, turning_target
from agents.planners.dual_arm.free_paths.planner import plan_free
from agents.planners.dual_arm.prescribed_paths.instantaneous import plan_local, plan_zeta_zero
from agents.planners.dual_arm.prescribed_paths.ocp import plan_ocp
from agents.planners.dual_arm.problem import Capture, CapturePlan
from agents.policies.clearance import MARGIN
from agents.policies.dual_arm.observed import Reader
from agents.policies.dual_arm.reactionless_rate import limited, track_rates
from agents.policies.needs import RENDEZVOUS
from agents.policies.tracking import Following, continued, following
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.reactionless import keep_attitude
from space_envs.dynamics.rotations import Array, conjugate, logarithm, multiply, rotate
from space_envs.policy import PolicyContext
from space_envs.robots.parameters import DUAL_ARM_PLANAR, DUAL_ARM_SPATIAL

MEETING = 20.0  # s after the start of the episode, when every plan ends
TRACKING_GAIN = 1.0  # 1/s, of the joint error while a plan is followed
CHECKS = 201  # times at which a plan is looked at
_ALWAYS = 1e9  # s before the end, when grippers are open
ATTITUDE_GAIN = 0.3  # 1/s, of the attitude that is left


@dataclass(frozen=True, eq=False)
class Task:
    """What one call of a planner is given, in the frame of the satellite at its start.

    Attributes:
        capture: boundary conditions. limits: of the joints.
        centre (3,) m, attitude (4,), spin (3,) rad/s: of the target at the start, which then turns freely.
        half_width: m, of the target.
    """

    robot: FloatingRobot
    capture: Capture
    limits: Limits
    centre: Array
    attitude: Array
    spin: Array
    half_width: float

    @property
    def surroundings(self) -> Surroundings:
        """What the arms keep away from."""
        planar = self.capture.axis is None
        parameters = DUAL_ARM_PLANAR if planar else DUAL_ARM_SPATIAL
        target, side = parameters.target, 0.5 * parameters.satellite_side
        return Surroundings(
            radius=parameters.link_radius,
            bus=None if planar else np.full(3, side),
            target=np.array(target.body) * self.half_width / target.half_width,
            motion=turning_target(self.centre, self.attitude, self.spin, np.array(target.inertia)),
        )

    def checked(self, plan: CapturePlan | Failure) -> CapturePlan | Failure:
        """The plan, or why it is none: a motion in which arms touch something is not followed.

        The gripper counts by its centre line all the time, as it does in the simulation.
        """
        if isinstance(plan, Failure):
            return plan
        around = replace(self.surroundings, contact=_ALWAYS)
        times = np.linspace(0.0, self.capture.duration, CHECKS)
        path = plan.sample(times)[0]
        found = gaps(self.robot, around, times, path, self.capture.duration, self.capture.start)
        if found.least > MARGIN:
            return plan
        what, node = found.worst()
        reason = f"{what} would come to {found.least:.3f} m at t = {times[node]:.2f} s"
        return Failure(plan.method, Cause.CLEARANCE, reason)


class ReactionlessPlanner:
    """Plans with one of the methods of `agents.planners.dual_arm`; where there is no plan, the arms rest.

    The plan ends `MEETING` seconds after the start of the episode, with both end-effectors as fast as their
    grapple points; from then on the resolved rate of `reactionless_rate` stays with them.
    """

    needs = RENDEZVOUS

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        self.context = context
        self.reader = Reader(context)
        self._samples = round(MEETING / context.control_period)

    @staticmethod
    def plan(task: Task) -> CapturePlan | Failure:
        """The plan of one episode."""
        raise NotImplementedError

    def tasks(self, observation: Array) -> list[Task]:
        """What is asked in each row, from observations (k, size)."""
        reader, context = self.reader, self.context
        ahead = MEETING - reader.field(observation, "time")[:, 0]
        attitude = reader.quaternion(observation, "base")
        back, origin = conjugate(attitude), reader.vector(observation, "base_position")
        centre = rotate(back, reader.vector(observation, "target_position") - origin)
        start = reader.field(observation, "joint_position")
        points = reader.vectors(observation, "goal_position") - reader.vector(
            observation, "target_position"
        ).reshape(-1, 1, 3)
        width = np.sqrt((points * points).sum(axis=-1)).mean(axis=-1)
        limits = Limits(
            position=context.joint_limits,
            rate=context.rate_limit,
            acceleration=context.acceleration_limit,
            torque=float(context.model.actuator_forcerange[0, 1]),
        )
        target = multiply(back, reader.quaternion(observation, "target"))
        spin = rotate(back, reader.vector(observation, "target_angular_velocity"))
        found = []
        for row, turn in enumerate(back):
            motion = reader.grapples(observation[row : row + 1], ahead[row : row + 1])
            capture = Capture(
                start=start[row],
                duration=float(ahead[row]),
                position=rotate(turn, motion.position[0, -1] - origin[row]),
                velocity=rotate(turn, motion.velocity[0, -1]),
                axis=None if motion.axis is None else rotate(turn, motion.axis[0, -1]),
            )
            around = centre[row], target[row], spin[row], float(width[row])
            found.append(Task(context.arm, capture, limits, *around))
        return found

    def _plans(self, observation: Array) -> Following:
        tasks = self.tasks(observation)
        plans: Any = Parallel(n_jobs=self.context.jobs)(delayed(self.plan)(task) for task in tasks)
        if self.context.contacts is not None:
            plans = [task.checked(plan) for task, plan in zip(tasks, plans, strict=True)]
        times = np.arange(self._samples + 1) * self.context.control_period
        rest, start = (self.reader.field(observation, name) for name in ("joint_position", "time"))
        return following(rest, list(plans), times, start[:, 0])

    def predict(
        self,
        observation: Array,
        state: Following | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Following]:
        """Actions (N, n) and the plans that they follow."""
        context, reader = self.context, self.reader
        observation = context.check_observation(observation)
        state = continued(state, observation, episode_start, self._plans)
        time, angle = reader.field(observation, "time")[:, 0], reader.field(observation, "joint_position")
        now, then, rate, over = state.reference(time, context.control_period)
        rate = rate + TRACKING_GAIN * (now - angle)
        turning = context.arm.base_map(then)[:, 3:]
        attitude = logarithm(reader.quaternion(observation, "base"))
        rate = keep_attitude(turning, rate, -ATTITUDE_GAIN * attitude)
        action = np.clip(rate / context.action_scale, -1.0, 1.0)
        if over.size:
            rate = track_rates(reader, observation[over]) * state.planned[over, None]
            action[over] = limited(reader, observation[over], rate)
        return action, state


class ZetaZero(ReactionlessPlanner):
    """Polynomial end-effector paths with zeta = 0."""

    @staticmethod
    def plan(task: Task) -> CapturePlan | Failure:
        """Method (a)."""
        return plan_zeta_zero(task.robot, task.capture, task.limits)


class Local(ReactionlessPlanner):
    """Polynomial end-effector paths with the least kinetic energy at each instant."""

    @staticmethod
    def plan(task: Task) -> CapturePlan | Failure:
        """Method (b)."""
        return plan_local(task.robot, task.capture, task.limits)


class OptimalControl(ReactionlessPlanner):
    """Polynomial end-effector paths with the least energy over the motion, from rest."""

    needs = replace(RENDEZVOUS, planar=True)

    @staticmethod
    def plan(task: Task) -> CapturePlan | Failure:
        """Method (c)."""
        return plan_ocp(task.robot, task.capture, task.limits, from_rest=True)


class FreePaths(ReactionlessPlanner):
    """Paths free between their ends, clear of everything, with the least energy over the motion."""

    @staticmethod
    def plan(task: Task) -> CapturePlan | Failure:
        """Method (d)."""
        return plan_free(task.robot, task.capture, task.limits, task.surroundings)
