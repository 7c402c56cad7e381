"""First motions of the receding-horizon controller, from stored motions or from a planner's."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from agents.planners.common.plans import Failure
from agents.planners.single_arm.library import Library
from agents.planners.single_arm.nmpc.controller import GOAL_TOLERANCE, Controller
from agents.planners.single_arm.nmpc.problem import ArmState, Horizon
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.planners.single_arm.weights.shapes import Shapes
from promp import GaussianBasis
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array

CANDIDATES = 3  # stored motions that are compared after `COMPARED` iterations
COMPARED = 2
DURATIONS = 4  # times of the rendezvous with a moving goal that are compared
ITERATIONS = 10  # at most, on the first motion
SETTLED = 0.02  # relative gain of an iteration below which it is the last
GUARDED_ITERATIONS = 10  # more, with further inequalities where a motion violates them
_PHASE = np.linspace(0.0, 1.0, 101)


Plan = Callable[[Reach], ReachPlan | Failure]


def attitude_if_possible(planner: OptimalPlanner) -> Plan:
    """Motions with the attitude constrained at the end, or without where there are none."""

    def plan(reach: Reach) -> ReachPlan | Failure:
        found = planner.plan(reach)
        if not isinstance(found, Failure):
            return found
        free = planner.plan(replace(reach, keep_attitude=False))
        return found if isinstance(free, Failure) else free

    return plan


class FirstPlans:
    """First motions of one controller.

    Args:
        plan: the motion that is improved where no stored one leads to the goal. library: of motions in the
            weights of a ProMP; None for none. guarded: whether further inequalities of the controller are
            imposed at once; otherwise where a motion violates them.
    """

    def __init__(
        self, controller: Controller, plan: Plan, library: Library | None = None, guarded: bool = False
    ) -> None:
        self._controller, self._plan, self._library, self._guarded = controller, plan, library, guarded
        shapes = Shapes.of(GaussianBasis())
        self._fixed, self._free = shapes.fixed, shapes.free
        self._values = controller.basis.value(_PHASE)
        self._converted = np.linalg.lstsq(self._values, shapes.basis.value(_PHASE), rcond=None)[0].T

    def __call__(self, state: ArmState, goal: Grapple) -> Horizon | Failure:
        """The motion at the start of an episode, to a goal whose time counts from it.

        The desired attitude is the satellite's present one. Where no motion ends with it, the motion leads to
        the goal alone, and later iterations regulate the attitude as far as possible.
        """
        controller = self._controller
        found = self._stored(state, goal)
        if found is None or found.goal_error > GOAL_TOLERANCE:
            planned = self._planned(state, goal)
            if isinstance(planned, Failure):
                return planned
            found = planned
        if not found.guarded and controller.violates(found, state, goal):
            found = self._improved(replace(found, guarded=True), state, goal, GUARDED_ITERATIONS)
        return replace(found, latest=state.time + controller.weights.latest)

    def _durations(self, goal: Grapple) -> list[float]:
        """Times to the rendezvous, s, that are compared."""
        weights = self._controller.weights
        if goal.moves and weights.earliest < weights.duration:
            return np.linspace(weights.duration, weights.earliest, DURATIONS).tolist()
        return [weights.duration]

    def _stored(self, state: ArmState, goal: Grapple) -> Horizon | None:
        """The best of the stored motions with the nearest goals, improved; None without a library."""
        if self._library is None:
            return None
        started = []
        for duration in self._durations(goal):
            ends = np.stack([state.angles, state.rates * duration, np.zeros_like(state.angles)], axis=1)
            stored = self._library.nearest(self._reach(state, goal, duration), CANDIDATES)
            weights = (ends @ self._fixed.T + stored @ self._free.T) @ self._converted
            guesses = [self._horizon(one, state, duration) for one in weights]
            started += [self._improved(guess, state, goal, COMPARED) for guess in guesses]
        best = min(started, key=lambda horizon: horizon.value)
        return self._improved(best, state, goal, ITERATIONS - COMPARED)

    def _planned(self, state: ArmState, goal: Grapple) -> Horizon | Failure:
        """The planner's motion, improved; that to a moving goal starts from one to rest at its place."""
        duration = self._durations(goal)[0]
        reach = self._reach(state, goal, duration)
        still = Grapple.at_rest(reach.end.position, reach.end.quaternion)
        found = self._plan(replace(reach, goal=still))
        if isinstance(found, Failure):
            return found
        angles = found.sample(_PHASE * found.time[-1])[0]
        weights = np.linalg.lstsq(self._values, angles, rcond=None)[0].T
        return self._improved(self._horizon(weights, state, duration), state, goal, ITERATIONS)

    def _improved(self, horizon: Horizon, state: ArmState, goal: Grapple, most: int) -> Horizon:
        """The motion after iterations until one gains little."""
        for _ in range(most):
            before, horizon = horizon.value, self._controller.advance(horizon, state, goal)
            if horizon.value > (1.0 - SETTLED) * before:
                break
        return horizon

    def _horizon(self, weights: Array, state: ArmState, duration: float) -> Horizon:
        rendezvous = state.time + duration
        return Horizon(
            start=state.time,
            rendezvous=rendezvous,
            latest=rendezvous,
            attitude=state.quaternion,
            basis=self._controller.basis,
            duration=duration,
            weights=weights,
            guarded=self._guarded,
        )

    def _reach(self, state: ArmState, goal: Grapple, duration: float) -> Reach:
        """The problem in the present frame of the satellite."""
        return Reach(
            start=state.angles,
            goal=goal.in_frame(state.position, state.quaternion),
            duration=duration,
            rate=state.rates,
            keep_attitude=True,
            c=self._controller.c,
            kind=self._controller.kind,
        )
