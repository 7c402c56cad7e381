"""Planning at the start of an episode, following the plan, and holding the goal once the plan is over."""

from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.plans import Failure, JointPath
from agents.policies.base import BasePolicy
from space_envs.dynamics.rotations import Array
from space_envs.errors import PolicyError
from space_envs.evaluation.play.causes import PlanState
from space_envs.policy import Knowledge

State = TypeVar("State")


class Reference(NamedTuple):
    """References of N episodes from their plans, now and one control period later.

    Attributes:
        step: (N,) control periods since the start of each plan.
        position, rate: (N, n) rad and rad/s, now.
        next_position, next_rate: (N, n), a control period later; the drives reach a rate at its end.
        over: (k,) rows with a finished plan.
    """

    step: NDArray[np.int64]
    position: Array
    rate: Array
    next_position: Array
    next_rate: Array
    over: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class FollowedPlans(PlanState):
    """Joint motions that N episodes follow; a policy's state, therefore never changed in place.

    Attributes:
        position, rate: (N, T, n) rad and rad/s, one sample a control period.
        start: (N,) s, time in the episode at which each plan starts.
        last: (N,) index of the sample at which each plan ends.
        failures: (N,) None, or the `Failure` because of which there is no plan and the arm stays at rest.
    """

    position: Array
    rate: Array
    start: Array
    last: NDArray[np.int64]
    failures: NDArray[np.object_]

    @property
    def planned(self) -> NDArray[np.bool_]:
        """Mask (N,) of the rows with a plan to the goal."""
        return np.array([failure is None for failure in self.failures], dtype=bool)

    def reference(self, time: Array, period: float) -> Reference:
        """Reference at times (N,) s into the episodes, with a control period in s."""
        step = np.rint((time - self.start) / period).astype(np.int64)
        last, every = self.last, np.arange(len(step))
        now, later = (every, np.minimum(step, last)), (every, np.minimum(step + 1, last))
        return Reference(
            step,
            self.position[now],
            self.rate[now],
            self.position[later],
            self.rate[later],
            np.flatnonzero(step >= last),
        )


def sampled_plans(
    rest: Array, plans: Sequence[JointPath | Failure], times: Array, start: Array
) -> FollowedPlans:
    """Plans of N episodes sampled at times (T,) s; after its end a plan goes on at its last rates.

    Without a plan the arm stays at rest.

    Args:
        rest: (N, n) rad, joint angles at the start. plans: of each episode. start: (N,) s.
    """
    position, rate = np.empty((2, len(rest), len(times), rest.shape[1]))
    failures = np.full(len(rest), None, dtype=object)
    last = np.full(len(rest), len(times) - 1)
    for row, plan in enumerate(plans):
        if isinstance(plan, Failure):
            failures[row] = plan
            position[row], rate[row] = rest[row], 0.0
        else:
            position[row], rate[row], _ = plan.sample(times)
            position[row] += np.maximum(times - plan.time[-1], 0.0)[:, None] * plan.rate[-1]
            last[row] = np.abs(times - plan.time[-1]).argmin()
    return FollowedPlans(position, rate, start, last, failures)


class FollowingPolicy(BasePolicy):
    """Follows the plans of a subclass with feedback of the joint angles, then holds the goal."""

    knowledge = Knowledge.MODEL

    tracking_gain: ClassVar[float]  # 1/s, of the joint error while a plan is followed

    def plans(self, observation: Array) -> FollowedPlans:
        """Plans of the episodes that start with observations (N, size)."""
        raise NotImplementedError

    def track(self, observation: Array, plans: FollowedPlans, reference: Reference) -> Array:
        """Joint rates (N, n), rad/s, of the plans at the next sample, corrected by the joint error."""
        angle = self.context.layout.read(observation, "joint_position")
        return reference.next_rate + self.tracking_gain * (reference.position - angle)

    def hold(self, observation: Array, planned: NDArray[np.bool_]) -> Array:
        """Joint rates (k, n), rad/s, that hold the end-effectors at their goals once the plan is over.

        Args:
            observation: (k, size). planned: (k, 1), whether there was a plan; the rates are zero without.
        """
        raise NotImplementedError

    def update(
        self, state: FollowedPlans | None, observation: Array, episode_start: NDArray[np.bool_] | None
    ) -> FollowedPlans:
        """The plans, with new ones in the rows of starting episodes; errors as in `rows_to_plan`."""
        rows = rows_to_plan(state, episode_start, len(observation))
        if state is not None and not rows.size:
            return state
        new = self.plans(observation[rows])
        return new if state is None or rows.size == len(observation) else merged(state, new, rows)

    def rates(self, observation: Array, state: FollowedPlans) -> Array:
        """Joint rates (N, n), rad/s: along the plan, then at the goal; zero without a plan."""
        time = self.context.layout.read(observation, "time")[:, 0]
        reference = state.reference(time, self.context.control_period)
        rate, over = self.track(observation, state, reference), reference.over
        if over.size:
            rate[over] = self.hold(observation[over], state.planned[over, None])
        return rate


def rows_to_plan(state: Any, episode_start: NDArray[np.bool_] | None, n: int) -> NDArray[np.int64]:
    """Rows with a starting episode.

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
    """Copy of `old` with some rows replaced by those of `new`; both are (nested) dataclasses of arrays."""
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
