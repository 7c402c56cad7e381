"""First motions of the receding-horizon controller, from stored motions or from a planner's."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from agents.planners.common.plans import Failure
from agents.planners.single_arm.library import Library
from agents.planners.single_arm.nmpc.controller import GOAL_TOLERANCE, Controller
from agents.planners.single_arm.nmpc.problem import ArmState, Horizon, Target
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.planners.single_arm.weights.shapes import Shapes
from promp import GaussianBasis
from space_envs.dynamics.rotations import Array, conjugate, multiply, rotate

CANDIDATES = 3  # stored motions that are compared after `COMPARED` iterations
COMPARED = 2
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

    def __call__(self, state: ArmState, target: Target) -> Horizon | Failure:
        """The motion at the start of an episode.

        The desired attitude is the satellite's present one. Where no motion ends with it, the motion leads to
        the goal alone, and later iterations regulate the attitude as far as possible.
        """
        controller = self._controller
        found = self._stored(state, target)
        if found is None or found.goal_error > GOAL_TOLERANCE:
            planned = self._planned(state, target)
            if isinstance(planned, Failure):
                return planned
            found = planned
        if not found.guarded and controller.violates(found, state, target):
            found = self._improved(replace(found, guarded=True), state, target, GUARDED_ITERATIONS)
        return replace(found, latest=state.time + controller.weights.latest)

    def _stored(self, state: ArmState, target: Target) -> Horizon | None:
        """The best of the stored motions with the nearest goals, improved; None without a library."""
        if self._library is None:
            return None
        duration = self._controller.weights.duration
        ends = np.stack([state.angles, state.rates * duration, np.zeros_like(state.angles)], axis=1)
        stored = self._library.nearest(self._reach(state, target), CANDIDATES)
        weights = (ends @ self._fixed.T + stored @ self._free.T) @ self._converted
        started = [self._improved(self._horizon(one, state), state, target, COMPARED) for one in weights]
        best = min(started, key=lambda horizon: horizon.value)
        return self._improved(best, state, target, ITERATIONS - COMPARED)

    def _planned(self, state: ArmState, target: Target) -> Horizon | Failure:
        """The planner's motion, improved."""
        found = self._plan(self._reach(state, target))
        if isinstance(found, Failure):
            return found
        angles = found.sample(_PHASE * found.time[-1])[0]
        weights = np.linalg.lstsq(self._values, angles, rcond=None)[0].T
        return self._improved(self._horizon(weights, state), state, target, ITERATIONS)

    def _improved(self, horizon: Horizon, state: ArmState, target: Target, most: int) -> Horizon:
        """The motion after iterations until one gains little."""
        for _ in range(most):
            before, horizon = horizon.value, self._controller.advance(horizon, state, target)
            if horizon.value > (1.0 - SETTLED) * before:
                break
        return horizon

    def _horizon(self, weights: Array, state: ArmState) -> Horizon:
        duration = self._controller.weights.duration
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

    def _reach(self, state: ArmState, target: Target) -> Reach:
        """The problem in the present frame of the satellite."""
        duration = self._controller.weights.duration
        position, quaternion, _ = target(state.time + duration)
        back = conjugate(state.quaternion)
        return Reach(
            start=state.angles,
            position=rotate(back, position - state.position),
            quaternion=multiply(back, quaternion),
            duration=duration,
            rate=state.rates,
            keep_attitude=True,
            c=self._controller.c,
        )
