"""Receding-horizon control of the single arm by a shrinking horizon in the weights of a ProMP.

In every control step the remaining motion is replanned from the observed state, on the momentum-level model,
by one Gauss-Newton iteration from the previous motion (real-time iteration; Diehl, Bock and Schloeder 2005).
The goal is a pose in the inertial frame at a given time and may move.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from agents.planners.common.plans import Failure, Limits
from agents.planners.single_arm.inequalities.torques import Torques
from agents.planners.single_arm.library import Library
from agents.planners.single_arm.nmpc.objective import Objective
from agents.planners.single_arm.nmpc.problem import ArmState, Horizon, Target, Weights
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.planners.single_arm.weights.bounds import Bounds, lower_and_upper
from agents.planners.single_arm.weights.elastic import ElasticProgram
from agents.planners.single_arm.weights.legendre import LegendreBasis
from agents.planners.single_arm.weights.shapes import Basis, Shapes
from agents.planners.single_arm.weights.sqp import Rows
from agents.planners.single_arm.weights.weight_space import WeightSpace
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array, conjugate, multiply, rotate, to_matrix
from space_envs.errors import positive

INITIAL_ITERATIONS = 10  # on the first plan
MAX_HALVINGS = 3  # of a step that increases the objective, before it is rejected
GOAL_TOLERANCE = 5e-3  # m or rad; a motion with a larger terminal error gets more time
DELAY = 0.1  # s, of the rendezvous in one control step
GOAL_DAMPING = 1e-3  # of the joint rates that follow a moving goal, squared singular value


class Controller:
    """Receding-horizon control of one robot.

    Args:
        robot: of one arm. limits: on motions. c: m/rad, of eq. 20. library: of stored motions that the first
            plan starts from. weights: of the objective. basis: of the motions. further: soft inequalities of
            a space of motions; None for none.
    """

    def __init__(
        self,
        robot: FloatingRobot,
        limits: Limits,
        c: float = 1.0,
        library: Library | None = None,
        weights: Weights = Weights(),
        basis: Basis = LegendreBasis(),
        further: Callable[[WeightSpace], tuple[Rows, ...]] | None = None,
    ) -> None:
        self.weights = weights
        limits = limits.checked(robot)
        self._robot, self._limits, self._c, self._basis = robot, limits, positive("c", c), basis
        self._further = further
        self._planner = OptimalPlanner(robot, limits, library, further=further)
        self._sides = lower_and_upper(robot, limits)
        shapes = Shapes.of(basis)
        self._fit = np.linalg.pinv(shapes.even[1] @ shapes.free)  # from rates by phase to coordinates
        self._even = np.linspace(0.0, 1.0, shapes.even.shape[1])

    def first_plan(self, state: ArmState, target: Target) -> Horizon | Failure:
        """Plan the motion at the start of an episode, iterated to convergence.

        The desired attitude is the satellite's present one. Where no motion ends with it, the motion leads to
        the goal alone, and later iterations regulate the attitude as far as possible.
        """
        duration = self.weights.duration
        position, quaternion, _ = target(state.time + duration)
        back = conjugate(state.quaternion)
        reach = Reach(
            start=state.angles,
            goal=Grapple.at_rest(rotate(back, position - state.position), multiply(back, quaternion)),
            duration=duration,
            rate=state.rates,
            keep_attitude=True,
            c=self._c,
        )
        found = self._planner.plan(reach)
        if isinstance(found, Failure):
            free = self._planner.plan(replace(reach, keep_attitude=False))
            if isinstance(free, Failure):
                return found
            found = free
        values = self._basis.value(found.time / duration)
        rendezvous = state.time + duration
        horizon = Horizon(
            start=state.time,
            rendezvous=rendezvous,
            latest=rendezvous,
            attitude=state.quaternion,
            basis=self._basis,
            duration=duration,
            weights=np.linalg.lstsq(values, found.position, rcond=None)[0].T,
        )
        for _ in range(INITIAL_ITERATIONS):  # with the basis and the objective of this controller
            horizon = self.advance(horizon, state, target)
        return replace(horizon, latest=state.time + self.weights.latest)

    def advance(self, before: Horizon, state: ArmState, target: Target) -> Horizon:
        """Motion from a state on: the previous one, improved by Gauss-Newton iterations."""
        duration = max(before.rendezvous - state.time, self.weights.shortest)
        end_rate = self._following(before, state.time + duration, target)
        space = self._space(before, state, target, duration, end_rate)
        rates = before.rates(state.time + duration * self._even) * duration
        y = (self._fit @ (rates - space.even_fixed[1] * duration)).T
        # The first sample is the observed state, which cannot be bounded.
        bounds = Bounds(space.even[:, 1:], space.even_fixed[:, 1:], *self._sides)
        inequalities: list[Rows] = [
            Torques(space, limit, accelerating)
            for limit, accelerating in ((self._limits.torque, True), (self._limits.coriolis, False))
            if limit is not None
        ]
        if self._further is not None:
            inequalities += self._further(space)
        objective = Objective(space, bounds, inequalities, self.weights, self._attitude(before, state))
        at = space.disturbance(y[None])
        value, accepted = objective.value(y, at), False
        program = ElasticProgram(bounds, before.active)
        for _ in range(self.weights.iterations):
            hessian, gradient = objective.quadratic(at)
            step = program.solve(hessian, gradient, y, [row.linear(y, at, 1.0) for row in inequalities])
            if isinstance(step, Failure):
                break
            for halving in range(MAX_HALVINGS + 1):
                trial = y + 0.5**halving * step
                there = space.disturbance(trial[None])
                if (better := objective.value(trial, there)) < value:
                    y, at, value, accepted = trial, there, better, True
                    break
        late = (
            float(np.abs(at.goal_error[0, :6]).max()) > GOAL_TOLERANCE and before.rendezvous < before.latest
        )
        return replace(
            before,
            start=state.time,
            rendezvous=min(before.rendezvous + DELAY, before.latest) if late else before.rendezvous,
            duration=duration,
            weights=space.weights(y),
            accepted=accepted,
            active=program.close(y),
        )

    def _attitude(self, before: Horizon, state: ArmState) -> Array:
        """Desired attitude (3, 3) in the present frame of the satellite."""
        return to_matrix(multiply(conjugate(state.quaternion), before.attitude))

    def _space(
        self, before: Horizon, state: ArmState, target: Target, duration: float, end_rate: Array
    ) -> WeightSpace:
        """Motions from the state, in the present frame of the satellite."""
        position, quaternion, _ = target(state.time + duration)
        back = conjugate(state.quaternion)
        return WeightSpace(
            self._robot,
            self._basis,
            state.angles,
            state.rates,
            duration,
            rotate(back, position - state.position),
            to_matrix(multiply(back, quaternion)),
            self._c,
            self._attitude(before, state),
            end_rate,
        )

    def _following(self, before: Horizon, end: float, target: Target) -> Array:
        """Joint rates (n,) at the end that give the end-effector the twist of the goal."""
        twist = target(end)[2]
        if not twist.any():
            return np.zeros(self._robot.n_joints)
        q = before.weights @ self._basis.value(1.0)
        # To first order the satellite has the desired attitude there.
        back = conjugate(before.attitude)
        local = np.concatenate([rotate(back, twist[:3]), rotate(back, twist[3:])])
        jacobian = self._robot.generalized_jacobian(q)
        square = jacobian @ jacobian.T + GOAL_DAMPING * np.eye(6)
        return jacobian.T @ np.linalg.solve(square, local)
