"""Policies that plan with a network at the start of an episode, correct the plan, and follow it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from agents.planners.single_arm.amortised.motions import MotionBatch, Problems
from agents.planners.single_arm.amortised.planner import BASIS, MOST_CORRECTIONS, NetworkPlanner
from agents.policies.following import FollowedPlans, merged
from agents.policies.goals import observed_goals
from agents.policies.learned.learned_policy import check_trained_for, missing_weights, shipped_file_of
from agents.policies.learned.policy_file import PlanFormat, PolicyFile
from agents.policies.needs import POSE
from agents.policies.single_arm.optimal import drive_limits
from agents.policies.single_arm.reaching import ReachingPolicy
from agents.policies.single_arm.reactionless.problem import latest_arrival
from space_envs.dynamics.rotations import Array, conjugate, multiply, rotate
from space_envs.errors import ConfigurationError, PolicyError, positive
from space_envs.policy import Knowledge, PolicyContext

SPARE = 1.5  # s, of an episode behind the end of a plan: the hold, and half a second
SHORTEST = 2.0  # s, of a plan's remainder that is planned again
KEPT = "kept"  # kind of plans


@dataclass(frozen=True, eq=False)
class NetworkPlans(FollowedPlans):
    """Plans with what is needed to plan their remainders again.

    Attributes:
        weights: (N, n, nb) of the motions. duration: (N,) s. begin: (N,) s, time in the episode of the first
            plan. attitude: (N, 4) of the base then.
    """

    weights: Array
    duration: Array
    begin: Array
    attitude: Array


def plan_duration(context: PolicyContext, kind: str) -> float:
    """Duration of plans of a kind from the start of an episode, s."""
    if kind == "reactionless":
        return latest_arrival(context)
    return context.horizon * context.control_period - SPARE


def problems_at(
    context: PolicyContext, observation: Array, duration: Array | float, attitude: Array | None = None
) -> Problems:
    """Problems of observations (N, size) in the current frame of the base.

    Args:
        duration: s. attitude: (N, 4) of the base at the end, inertial; None for the current one.
    """

    def read(name: str) -> Array:
        return context.layout.read(observation, name)

    back = conjugate(read("base_quaternion"))
    goals = observed_goals(context, observation).at(0.0)
    return Problems.of(
        read("joint_position"),
        read("joint_velocity"),
        np.broadcast_to(duration, len(observation)).astype(np.float64),
        rotate(back, goals.position - read("base_position")),
        multiply(back, goals.quaternion),
        None if attitude is None else multiply(back, attitude),
    )


def needs_pose(context: PolicyContext) -> str | None:
    """Reason why tasks that ask for less than a pose do not fit."""
    kind = context.goal_kind
    return (
        None
        if kind == "pose"
        else f"its networks plan to whole poses, the task asks for goals of kind {kind!r}"
    )


class PlanningNetwork(ReachingPolicy):
    """Follows the motion that a network of `train.py --algo planner` gives, after Gauss-Newton corrections.

    Args:
        file: the network. corrections: Gauss-Newton steps onto the goal at planning time; 0 is the network
            alone. replan: times after the start of the plan, s, at which its remainder is corrected from the
            observed state.

    Raises:
        PolicyError: if the file is no network that plans, or was trained for another id, control mode or
            robot. ConfigurationError: for corrections and times that are none.
    """

    needs = replace(POSE, obstacles=False, other=needs_pose)
    knowledge = Knowledge.LEARNED_WITH_MODEL

    def __init__(
        self,
        context: PolicyContext,
        seed: int,
        file: PolicyFile,
        corrections: int = 2,
        replan: Sequence[float] = (),
    ) -> None:
        super().__init__(context, seed)
        check_trained_for(file, context)
        if not 0 <= corrections <= MOST_CORRECTIONS:
            raise ConfigurationError(f"corrections must lie in 0..{MOST_CORRECTIONS}, got {corrections!r}")
        self._network, self._view, self._format = file.network, file.view(context.layout), _plan_format(file)
        self._planner = NetworkPlanner(context.arm, drive_limits(context), context.c, corrections)
        self._replan = {round(positive("replan", time) / context.control_period) for time in replan}

    def plans(self, observation: Array) -> NetworkPlans:
        """Plans of the episodes that start with observations (N, size)."""
        read = self.context.layout.read
        output = self._network.means(self._view(observation)).astype(np.float64)
        batch = self._planner.batch(problems_at(self.context, observation, self._format.duration))
        y = output.reshape(len(output), batch.joints, batch.free)
        time = read(observation, "time")[:, 0].copy()
        return self._followed(batch, y, None, time, time, read(observation, "base_quaternion"))

    def update(
        self, state: FollowedPlans | None, observation: Array, episode_start: NDArray[np.bool_] | None
    ) -> FollowedPlans:
        """The plans: new ones in starting episodes, corrected remainders at the times of replanning."""
        found = super().update(state, observation, episode_start)
        if not self._replan or not isinstance(found, NetworkPlans):
            return found
        time = self.context.layout.read(observation, "time")[:, 0]
        step = np.rint((time - found.begin) / self.context.control_period)
        left = found.start + found.duration - time
        rows = np.flatnonzero(np.isin(step, list(self._replan)) & found.planned & (left >= SHORTEST))
        return self._replanned(found, observation, rows, time, left) if rows.size else found

    def _replanned(
        self, state: NetworkPlans, observation: Array, rows: NDArray[np.int64], time: Array, left: Array
    ) -> NetworkPlans:
        """Plans with remainders corrected from the observed state, in rows where that leads to a plan."""
        phase = 1.0 - left[rows] / state.duration[rows]
        problems = problems_at(self.context, observation[rows], left[rows], state.attitude[rows])
        batch = self._planner.batch(problems)
        y = batch.coordinates(remainder(state.weights[rows], phase))
        corrections = max(1, self._planner.corrections)
        new = self._followed(batch, y, corrections, time[rows], state.begin[rows], state.attitude[rows])
        good = new.planned
        every = np.flatnonzero(good)
        chosen = NetworkPlans(**{name: value[every] for name, value in vars(new).items()})
        return merged(state, chosen, rows[good]) if every.size else state

    def _followed(
        self,
        batch: MotionBatch,
        y: Array,
        corrections: int | None,
        start: Array,
        begin: Array,
        attitude: Array,
    ) -> NetworkPlans:
        """Corrected and checked motions, sampled once a control period."""
        found, period = self._planner.plan(batch, y, corrections), self.context.control_period
        duration = batch.problems.duration
        last = np.rint(duration / period).astype(np.int64)
        times = np.arange(round(self._format.duration / period) + 1) * period
        phase = np.minimum(times / duration[:, None], 1.0)
        columns = found.weights.swapaxes(1, 2)
        position = BASIS.value(phase) @ columns
        rate = BASIS.derivative(phase) @ columns / duration[:, None, None]
        failed = np.array([failure is not None for failure in found.failures], dtype=bool)
        position[failed], rate[failed] = batch.problems.start[failed, None], 0.0
        return NetworkPlans(
            position, rate, start, last, found.failures, found.weights, duration, begin, attitude
        )


def remainder(weights: Array, phase: Array) -> Array:
    """Weights (N, n, nb) of the motions from phases (N,) on, of motions of weights (N, n, nb)."""
    nodes = 0.5 - 0.5 * np.cos(np.pi * (np.arange(BASIS.size) + 0.5) / BASIS.size)
    later = BASIS.value(phase[:, None] + (1.0 - phase[:, None]) * nodes)  # (N, nodes, nb)
    return weights @ np.linalg.solve(BASIS.value(nodes), later).swapaxes(1, 2)


def _plan_format(file: PolicyFile) -> PlanFormat:
    if file.plans is None or file.plans.kind != KEPT:
        raise PolicyError(f"the network gives no motions of the kind {KEPT!r}")
    return file.plans


class PlannerNetwork(PlanningNetwork):
    """The network that ships, with two corrections; `PlannerNetworkAlone` has none."""

    name: ClassVar[str] = "planner_network"
    corrections: ClassVar[int] = 2
    needs = replace(
        PlanningNetwork.needs, other=lambda c: needs_pose(c) or missing_weights("planner_network", c)
    )

    def __init__(self, context: PolicyContext, seed: int = 0, **options: Any) -> None:
        options.setdefault("corrections", self.corrections)
        super().__init__(context, seed, shipped_file_of(self.name, context), **options)


class PlannerNetworkAlone(PlannerNetwork):
    """The network that ships, without corrections."""

    corrections = 0
