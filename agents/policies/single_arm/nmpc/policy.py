"""Nonlinear model predictive control of the single arm as a policy."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.plans import Failure
from agents.planners.single_arm.library import find_library
from agents.planners.single_arm.nmpc.controller import Controller
from agents.planners.single_arm.nmpc.first import FirstPlans, attitude_if_possible
from agents.planners.single_arm.nmpc.problem import ArmState, Horizon, Weights
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.planners.single_arm.weights.legendre import LegendreBasis
from agents.policies.base import BasePolicy
from agents.policies.clearance import KeepOut
from agents.policies.following import rows_to_plan
from agents.policies.goals import observed_goals
from agents.policies.needs import POSE
from agents.policies.single_arm.optimal import drive_limits, further_rows, satellite_rows
from agents.policies.single_arm.reaching import held_rates
from space_envs.dynamics.rotations import Array
from space_envs.evaluation.play.causes import PlanState
from space_envs.policy import Knowledge, PolicyContext

SETTLING = 0.5  # s after the rendezvous, after which the arm holds a static goal
CHECK_PERIOD = 0.3  # s, after which the motion that is followed is checked against the satellite again
SPACING = 0.2  # s, of times at which a motion is checked
LOOK_AHEAD = 4.0  # s; at the limits of rate and acceleration a joint stops in 1.2 s


@dataclass(frozen=True, eq=False)
class RecedingPlans(PlanState):
    """Motions that N episodes currently follow; never changed in place.

    Attributes:
        horizons: N motions, None where the first plan failed.
        start: (N,) s, time at which each episode started.
        failures: (N,) None, or the `Failure` because of which there is no motion to follow.
    """

    horizons: Sequence[Horizon | None]
    start: Array
    failures: NDArray[np.object_]


class NMPC(BasePolicy):
    """At every step the first part of the optimal motion over the remaining time, from the observed state.

    What lies far ahead is planned again many times before it is reached, so that only the next `LOOK_AHEAD`
    of a motion must be clear of the satellite. Where it is not, the motion before goes on if as much of it is
    clear, and otherwise the arm brakes, which it can within that time; the next step tries again.
    """

    knowledge = Knowledge.MODEL
    needs = replace(POSE, goals=None, obstacles=False)
    weights = Weights()
    basis = LegendreBasis()

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        further = further_rows(context)
        # Arms without redundancy may go on exchanging errors of goal and attitude.
        self._settles = further is not None and context.goals == "static"
        self.controller = Controller(
            context.arm,
            drive_limits(context),
            context.c,
            self.weights,
            self.basis,
            further or satellite_rows(context),
            context.goal_kind,
        )
        self.first_plan = self.first_plans(guarded=further is not None)

    def first_plans(self, guarded: bool) -> FirstPlans:
        """First motions of the controller, from the robot's library or by `promp_optimal_kept`'s planner."""
        context = self.context
        library = find_library(context.robot, keep_attitude=True)
        planner = OptimalPlanner(context.arm, drive_limits(context), library, further=further_rows(context))
        return FirstPlans(self.controller, attitude_if_possible(planner), library, guarded)

    def arm_state(self, observation: Array) -> ArmState:
        """The arm's state in one observation (size,)."""
        read = self.context.layout.read
        names = ("joint_position", "joint_velocity", "base_position", "base_quaternion")
        return ArmState(float(read(observation, "time")[0]), *(read(observation, name) for name in names))

    def update(
        self, state: RecedingPlans | None, observation: Array, episode_start: NDArray[np.bool_] | None
    ) -> RecedingPlans:
        """The updated motions; an episode without a first motion never gets one."""
        n, time = len(observation), self.context.layout.read(observation, "time")[:, 0]
        starting = np.zeros(n, dtype=bool)
        starting[rows_to_plan(state, episode_start, n)] = True
        start = time.copy() if state is None else np.where(starting, time, state.start)
        failures = np.full(n, None, dtype=object) if state is None else state.failures.copy()
        horizons: list[Horizon | None] = [None] * n if state is None else list(state.horizons)
        for row, seen in enumerate(observation):
            before = None if starting[row] else horizons[row]
            if starting[row] or before is not None:
                horizons[row], failures[row] = self._advanced(before, seen)
        return RecedingPlans(tuple(horizons), start, failures)

    def rates(self, observation: Array, state: RecedingPlans) -> Array:
        """Joint rates (N, n), rad/s, of the motions at the end of the period; zero without a motion."""
        time = self.context.layout.read(observation, "time")[:, 0]
        rate = np.zeros((len(observation), self.context.arm.n_joints))
        for row, horizon in enumerate(state.horizons):
            if horizon is None or state.failures[row] is not None:
                continue
            if self._settles and time[row] > horizon.rendezvous + SETTLING:
                rate[row] = held_rates(self.context, observation[row : row + 1])[0]
            else:
                rate[row] = horizon.rates(np.array(float(time[row]) + self.context.control_period))
        return rate

    def _advanced(self, before: Horizon | None, observation: Array) -> tuple[Horizon | None, Failure | None]:
        """The motion from one observation (size,), and the failure because of which it is not followed."""
        arm, goal = self.arm_state(observation), observed_goals(self.context, observation[None]).row(0)
        if before is None:
            found = self.first_plan(arm, goal)
        else:
            found = self.controller.advance(before, arm, goal)
        if isinstance(found, Failure):
            return None, found
        if arm.time < found.checked + CHECK_PERIOD - 1e-9:
            return found, None
        failure = self._touching(found, arm, observation)
        if failure and before is not None and not found.guarded:
            found = self.controller.advance(replace(before, guarded=True), arm, goal)
            failure = self._touching(found, arm, observation)
        if failure and before is not None and self._touching(before, arm, observation) is None:
            found, failure = replace(before, guarded=True), None
        return replace(found, checked=-np.inf if failure else arm.time), failure

    def _touching(self, horizon: Horizon, arm: ArmState, observation: Array) -> Failure | None:
        """Failure of a motion that must not be followed from an observation (size,); None if it may be."""
        keep_out = KeepOut.of(self.context, observation[None])
        if keep_out is None:
            return None
        times = arm.time - horizon.start + SPACING * np.arange(round(LOOK_AHEAD / SPACING) + 1)
        return keep_out.refusal("nmpc", *horizon.motion(times), SPACING)
