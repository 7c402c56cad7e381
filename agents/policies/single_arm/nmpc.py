"""Nonlinear model predictive control of the single arm as a policy."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.plans import Failure
from agents.planners.single_arm.library import shipped_library
from agents.planners.single_arm.nmpc.controller import Controller
from agents.planners.single_arm.nmpc.problem import ArmState, Horizon, Target, Weights, coasting
from agents.policies.clearance import KeepOut
from agents.policies.needs import POSE
from agents.policies.single_arm.optimal import drive_limits
from agents.policies.tracking import rows_to_plan
from space_envs.dynamics.rotations import Array
from space_envs.evaluation.records.causes import PlanState
from space_envs.policy import PolicyContext

LOOK_AHEAD = 4.0  # s; at the limits of rate and acceleration a joint stops in 1.2 s


@dataclass(frozen=True, eq=False)
class Receding(PlanState):
    """What N episodes plan; never changed in place.

    Attributes:
        horizons: N motions, None where the first plan failed.
        start: (N,) s, time at which each episode began.
        failures: (N,) None, or the `Failure` that says why there is no motion to follow now.
    """

    horizons: Sequence[Horizon | None]
    start: Array
    failures: NDArray[np.object_]


class NMPC:
    """At every step the first move of the best motion over the time that is left, from the state observed.

    What lies far ahead is planned again many times before it is reached, so that only the next `LOOK_AHEAD`
    of a motion must be clear of the satellite. Where it is not, the motion before goes on if as much of it is
    clear, and otherwise the arm brakes, which it can within that time; the next step tries again.
    """

    needs = replace(POSE, joints=7, goals=None, obstacles=False)
    weights = Weights()

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        self.context = context
        limits, library = drive_limits(context), shipped_library(True, limited=False)
        self.controller = Controller(context.arm, limits, context.c, library, self.weights)

    def target(self, observation: Array) -> Target:
        """Where the goal of one observation (size,) will be: it keeps the velocity observed, if any."""
        layout, read = self.context.layout, self.context.layout.read
        twist = np.zeros(6)
        for part, name in ((twist[:3], "goal_linear_velocity"), (twist[3:], "goal_angular_velocity")):
            if name in layout.slices:
                part[:] = read(observation, name)
        pose = read(observation, "goal_position"), read(observation, "goal_quaternion")
        return coasting(*pose, twist, float(read(observation, "time")[0]))

    def state(self, observation: Array) -> ArmState:
        """The arm's state in one observation (size,)."""
        read = self.context.layout.read
        names = ("joint_position", "joint_velocity", "base_position", "base_quaternion")
        return ArmState(float(read(observation, "time")[0]), *(read(observation, name) for name in names))

    def predict(
        self,
        observation: Array,
        state: Receding | None = None,
        episode_start: NDArray[np.bool_] | None = None,
        deterministic: bool = True,
    ) -> tuple[Array, Receding]:
        """Actions (N, n) and the motions they begin."""
        context = self.context
        observation = context.check_observation(observation)
        n = len(observation)
        begins = np.zeros(n, dtype=bool)
        begins[rows_to_plan(state, episode_start, n)] = True
        time = context.layout.read(observation, "time")[:, 0]
        start = time.copy() if state is None else np.where(begins, time, state.start)
        failures = np.full(n, None, dtype=object) if state is None else state.failures.copy()
        horizons: list[Horizon | None] = [None] * n if state is None else list(state.horizons)
        action = np.zeros((n, context.arm.n_joints))
        for row, seen in enumerate(observation):
            arm, target = self.state(seen), self.target(seen)
            before = None if begins[row] else horizons[row]
            if begins[row]:
                found = self.controller.first_plan(arm, target)
            elif before is None:
                continue
            else:
                found = self.controller.advance(before, arm, target)
            if isinstance(found, Failure):
                failures[row], horizons[row] = found, None
                continue
            failures[row] = self._touching(found, arm, seen)
            if failures[row] and before is not None and self._touching(before, arm, seen) is None:
                found, failures[row] = before, None
            horizons[row] = found
            if failures[row] is None:
                # The drives reach a rate at the end of the period: the motion's rate there is asked for.
                rate = found.rates(np.array(arm.time + context.control_period))
                action[row] = np.clip(rate / context.action_scale, -1.0, 1.0)
        return action, Receding(tuple(horizons), start, failures)

    def _touching(self, horizon: Horizon, arm: ArmState, observation: Array) -> Failure | None:
        """Why a motion is none to follow in the state of an observation (size,). Otherwise None."""
        keep_out = KeepOut.of(self.context, observation[None])
        if keep_out is None:
            return None
        dt = self.context.control_period
        times = arm.time - horizon.start + dt * np.arange(round(LOOK_AHEAD / dt) + 1)
        return keep_out.refusal("nmpc", *horizon.motion(times), dt)
