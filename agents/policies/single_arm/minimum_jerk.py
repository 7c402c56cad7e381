"""Minimum-jerk joint motion to a joint goal that accounts for the motion of the base."""

from dataclasses import dataclass

from agents.planners.common.damped_search import JointGoals, Rows
from agents.planners.common.inverse_kinematics import JointMotion, floating_inverse_kinematics
from agents.policies.single_arm.joint_goals import JointGoalPolicy
from agents.policies.single_arm.reaching import motion_times
from space_envs.dynamics.rotations import Array
from space_envs.policy import PolicyContext


@dataclass(frozen=True, eq=False)
class Profile:
    """Motions whose joints run q(t) = goal + a(t) (start - goal) + b(t) rate, `rate` being that at t = 0.

    Attributes:
        displacement, slope: a (T,) and its time derivative, 1/s. drift, pace: b (T,), s, and its derivative.
        dt: s.
    """

    displacement: Array
    slope: Array
    drift: Array
    pace: Array
    dt: float

    def motion(self, start: Array, rate: Array, goal: Array) -> JointMotion:
        """Motions (N, T, n) from `start` (N, n) rad with `rate` (N, n) rad/s to rest at `goal` (N, n)."""
        offset, rate = (start - goal)[:, None, :], rate[:, None, :]
        position = goal[:, None, :] + self.displacement[:, None] * offset + self.drift[:, None] * rate
        return JointMotion(position, self.slope[:, None] * offset + self.pace[:, None] * rate, self.dt)


def minimum_jerk_profile(times: Array) -> Profile:
    """The quintic from any state to rest, which has the least integrated squared jerk for its end states."""
    duration = times[-1]
    s = times / duration
    return Profile(
        displacement=1.0 - s**3 * (10.0 + s * (6.0 * s - 15.0)),
        slope=-30.0 * s**2 * (1.0 - s) ** 2 / duration,
        drift=duration * s * (1.0 + s**2 * (-6.0 + s * (8.0 - 3.0 * s))),
        pace=1.0 + s**2 * (-18.0 + s * (32.0 - 15.0 * s)),
        dt=float(times[1] - times[0]),
    )


def profile_goals(
    context: PolicyContext, observation: Array, profile: Profile, preferred: Array | None = None
) -> JointGoals:
    """Joint goals of `profile` from the observed states with which the inertial goal is reached.

    Args:
        preferred: (N, n) rad, joint angles that the goals approach within the redundancy; None for the start.
    """

    def read(name: str) -> Array:
        return context.layout.read(observation, name)

    start, rate = read("joint_position"), read("joint_velocity")

    def motion(goal: Array, rows: Rows) -> JointMotion:
        return profile.motion(start[rows], rate[rows], goal)

    return floating_inverse_kinematics(
        context.arm,
        read("goal_position"),
        read("goal_quaternion"),
        motion,
        read("base_position"),
        read("base_quaternion"),
        start if preferred is None else preferred,
        context.joint_limits,
        kind=context.goal_kind,
    )


class ProfilePolicy(JointGoalPolicy):
    """Follows motions of a subclass's profile to joint goals that account for the motion of the base."""

    profile: Profile

    def plan(self, observation: Array, preferred: Array | None = None) -> tuple[JointMotion, JointGoals]:
        """The motions of the profile with which the inertial goal is reached, and their joint goals."""
        read = self.context.layout.read
        goals = profile_goals(self.context, observation, self.profile, preferred)
        start, rate = read(observation, "joint_position"), read(observation, "joint_velocity")
        return self.profile.motion(start, rate, goals.position), goals


class MinimumJerk(ProfilePolicy):
    """Moves straight in joint space, with the least integrated squared jerk, then holds the goal."""

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        self.profile = minimum_jerk_profile(motion_times(context))
