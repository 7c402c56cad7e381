"""What planners share: plan where an episode starts, follow the plan, then stay with the goal."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.damped_search import JointGoals
from agents.planners.common.inverse_kinematics import JointMotion
from agents.planners.common.plans import Failure, JointPath
from agents.policies.clearance import KeepOut
from agents.policies.gjm import resolved_rate
from agents.policies.needs import POSE
from space_envs.dynamics.rotations import Array
from space_envs.errors import PolicyError
from space_envs.evaluation.records.causes import PlanState
from space_envs.policy import PolicyContext

State = TypeVar("State")
Steps = NDArray[np.int64]

DURATION = 10.0  # s, of every planned motion
TRACKING_GAIN = 2.0  # 1/s, of the joint error while a plan is followed
OTHERS, OTHER_RADIUS = (
    8,
    1.2,
)  # joint goals that are tried in place of a motion that touches; rad, how far off
# What is left at the end of a motion is taken away slowly, once the plan is over.
HOLD_GAIN, HOLD_LINEAR_SPEED, HOLD_ANGULAR_SPEED = 0.5, 0.02, 0.02  # 1/s, m/s, rad/s


@dataclass(frozen=True, eq=False)
class Plan(PlanState):
    """The motions of N episodes; unchanged from step to step, so that it can be handed round as a state.

    Attributes:
        position, velocity: (N, T, n) rad and rad/s, one sample a control period.
        start: (N,) s, time in the episode at which each motion begins.
        goals: joint goals, with what inverse kinematics left over.
        failures: (N,) None, or the `Failure` that says why the arm rests instead.
    """

    position: Array
    velocity: Array
    start: Array
    goals: JointGoals
    failures: NDArray[np.object_]


@dataclass(frozen=True, eq=False)
class Following(PlanState):
    """The optimal plans of N episodes; unchanged from step to step.

    Attributes:
        position, rate: (N, T + 1, n) rad and rad/s, one sample a control period.
        start: (N,) s, time in the episode at which each plan begins.
        failures: (N,) None, or the `Failure` that says why there is no plan.
    """

    position: Array
    rate: Array
    start: Array
    failures: NDArray[np.object_]

    @property
    def planned(self) -> NDArray[np.bool_]:
        """Rows (N,) that have a plan."""
        return np.array([failure is None for failure in self.failures], dtype=bool)

    def reference(self, time: Array, period: float) -> tuple[Array, Array, Array, NDArray[np.int64]]:
        """What the plans ask at times (N,) s into the episodes and one control period, s, later.

        Returns:
            Angles (N, n) rad now; angles and rates (N, n) rad/s then, since the drives reach a rate at the
            end of a period; indices of the rows whose plan is over.
        """
        step = np.rint((time - self.start) / period).astype(np.int64)
        last, every = self.position.shape[1] - 1, np.arange(len(step))
        now, then = (every, np.minimum(step, last)), (every, np.minimum(step + 1, last))
        return self.position[now], self.position[then], self.rate[then], np.flatnonzero(step >= last)


def following(rest: Array, plans: Sequence[JointPath | Failure], times: Array, start: Array) -> Following:
    """What the plans of N episodes ask at sampling times (T + 1,) s; without a plan the arm rests.

    Args:
        rest: (N, n) rad, joint angles at the start. plans: of each episode. start: (N,) s.
    """
    position, rate = np.empty((2, len(rest), len(times), rest.shape[1]))
    failures = np.full(len(rest), None, dtype=object)
    for row, plan in enumerate(plans):
        if isinstance(plan, Failure):
            failures[row] = plan
            position[row], rate[row] = rest[row], 0.0
        else:
            position[row], rate[row], _ = plan.sample(times)
    return Following(position, rate, start, failures)


def motion_times(context: PolicyContext) -> Array:
    """Sampling times (T,) of a planned motion, s: whole control periods from 0 to (nearly) the duration."""
    return np.arange(max(1, round(DURATION / context.control_period)) + 1) * context.control_period


def rows_to_plan(state: Any, episode_start: NDArray[np.bool_] | None, n: int) -> NDArray[np.int64]:
    """Rows whose episode begins.

    Raises:
        PolicyError: if `episode_start` has not N entries, or N changed in the middle of episodes.
    """
    if episode_start is None:
        episode_start = np.full(n, state is None)
    episode_start = np.asarray(episode_start, dtype=bool)
    if episode_start.shape != (n,):
        raise PolicyError(f"episode_start must have shape ({n},), got {episode_start.shape}")
    known = n if episode_start.all() else (0 if state is None else len(state.start))
    if known != n:
        raise PolicyError(
            f"{n} observations, and a state for {known} episodes: all episodes must start together"
        )
    return np.flatnonzero(episode_start)


def merged(old: State, new: State, rows: NDArray[np.int64]) -> State:
    """`old` with its rows replaced by those of `new`; both are dataclasses of arrays, nested or not."""
    values = {}
    for field in fields(old):  # pyright: ignore[reportArgumentType]
        before, after = getattr(old, field.name), getattr(new, field.name)
        if isinstance(before, np.ndarray):
            replaced = before.copy()
            replaced[rows] = after
            values[field.name] = replaced
        else:
            values[field.name] = merged(before, after, rows)
    return type(old)(**values)


def continued(
    state: State | None,
    observation: Array,
    episode_start: NDArray[np.bool_] | None,
    plan: Callable[[Array], State],
) -> State:
    """The state with the rows planned anew whose episode begins; errors as in `rows_to_plan`."""
    rows = rows_to_plan(state, episode_start, len(observation))
    if state is not None and not rows.size:
        return state
    new = plan(observation[rows])
    return new if state is None or rows.size == len(observation) else merged(state, new, rows)


def hold_rate(
    context: PolicyContext, observation: Array, goals: JointGoals, rows: NDArray[np.int64]
) -> Array:
    """Joint rates (k, n), rad/s, of rows (k,) whose motion is over.

    They correct the pose of the end-effector; where no motion to the goal was found the arm rests.
    """
    rate = resolved_rate(context, observation[rows], HOLD_GAIN, HOLD_LINEAR_SPEED, HOLD_ANGULAR_SPEED)
    return rate * goals.converged[rows, None]


class TrajectoryPolicy:
    """Follows joint motions that a subclass plans, with feedback of the joint angles.

    A motion that would put a link into the satellite or a sphere is planned anew to other joint goals, a few
    times; if they all would, the arm rests.
    """

    needs = POSE

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        self.context = context
        random = np.random.default_rng(0)
        self._others = random.uniform(-OTHER_RADIUS, OTHER_RADIUS, (OTHERS, context.arm.n_joints))

    def plan(self, observation: Array, preferred: Array | None = None) -> tuple[JointMotion, JointGoals]:
        """Motions (N, T, n), sampled at `motion_times`, and the joint goals they end at.

        Args:
            preferred: (N, n) rad, joint angles that the redundancy draws the goals to; None is the start.
        """
        raise NotImplementedError

    def _plans(self, observation: Array) -> Plan:
        read, keep_out = self.context.layout.read, KeepOut.of(self.context, observation)
        rest = read(observation, "joint_position")
        motion, goals = self.plan(observation)
        position, velocity = motion.position.copy(), motion.velocity.copy()
        failures = np.full(len(rest), None, dtype=object)
        if keep_out is not None:
            dt = motion.dt
            rows = np.flatnonzero(~keep_out.clear(position, velocity, dt))
            for offset in self._others:
                if not rows.size:
                    break
                other, found = self.plan(observation[rows], rest[rows] + offset)
                clear = found.converged & keep_out.take(rows).clear(other.position, other.velocity, dt)
                clear &= np.abs(other.velocity).max(axis=(1, 2)) <= self.context.rate_limit
                position[rows[clear]], velocity[rows[clear]] = other.position[clear], other.velocity[clear]
                goals = merged(goals, found.take(clear), rows[clear])
                rows = rows[~clear]
            for row in rows:
                own = keep_out.take(np.array([row]))
                failures[row] = own.refusal(type(self).__name__, position[row], velocity[row], dt)
            position[rows], velocity[rows] = rest[rows, None], 0.0
            goals = goals.rejected(rows, rest[rows])
        return Plan(position, velocity, read(observation, "time")[:, 0], goals, failures)

    def follow(self, observation: Array, plan: Plan, step: Steps) -> Array:
        """Joint rates (N, n), rad/s, for the end of the control period, `step` (N,) periods into the plan.

        The drives reach a rate at the end of the period: the reference's rate there is what to ask for.
        """
        last = plan.position.shape[1] - 1
        every = np.arange(len(observation))
        now, then = np.minimum(step, last), np.minimum(step + 1, last)
        error = plan.position[every, now] - self.context.layout.read(observation, "joint_position")
        return plan.velocity[every, then] + TRACKING_GAIN * error

    def predict(
        self,
        observation: Array,
        state: Plan | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Plan]:
        """Actions (N, n) and the plans that they follow."""
        context, read = self.context, self.context.layout.read
        observation = context.check_observation(observation)
        time = read(observation, "time")[:, 0]
        state = continued(state, observation, episode_start, self._plans)
        step = np.rint((time - state.start) / context.control_period).astype(np.int64)
        rate = self.follow(observation, state, step)
        over = np.flatnonzero(step >= state.position.shape[1] - 1)
        if over.size:
            rate[over] = hold_rate(context, observation, state.goals, over)
        return np.clip(rate / context.action_scale, -1.0, 1.0), state
