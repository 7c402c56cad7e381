"""Receding-horizon control of the single arm by a shrinking horizon in the weights of a ProMP.

In every control step the remaining motion is replanned from the observed state, on the momentum-level model,
by one Gauss-Newton iteration from the previous motion (real-time iteration; Diehl, Bock and Schloeder 2005).
The goal is a grapple in the inertial frame, whose time counts from the observation, and may move.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from agents.planners.common.plans import Failure, Limits
from agents.planners.single_arm.inequalities.torques import Torques
from agents.planners.single_arm.nmpc.objective import Objective
from agents.planners.single_arm.nmpc.problem import ArmState, Horizon, Weights
from agents.planners.single_arm.weights.bounds import Bounds, lower_and_upper
from agents.planners.single_arm.weights.elastic import ElasticProgram
from agents.planners.single_arm.weights.legendre import LegendreBasis
from agents.planners.single_arm.weights.shapes import Basis, Shapes
from agents.planners.single_arm.weights.sqp import Rows
from agents.planners.single_arm.weights.weight_space import WeightSpace
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array, conjugate, multiply, to_matrix
from space_envs.errors import positive
from space_envs.tasks.goals.kinds import GoalKind, checked_kind

MAX_HALVINGS = 3  # of a step that increases the objective, before it is rejected
GOAL_TOLERANCE = 5e-3  # m or rad; a motion with a larger terminal error gets more time
EARLY = 1e-6  # s, by which a horizon may be shorter than the shortest
DELAY = 0.1  # s, of the rendezvous in one control step
GOAL_DAMPING = 1e-3  # of the joint rates that follow a moving goal, squared singular value


class Controller:
    """Receding-horizon control of one robot.

    Args:
        robot: of one arm. limits: on motions. c: m/rad, of eq. 20. weights: of the objective. basis: of the
            motions. further: soft inequalities of a space of motions, imposed where a horizon says so; None
            for none. kind: of the goals.
    """

    def __init__(
        self,
        robot: FloatingRobot,
        limits: Limits,
        c: float = 1.0,
        weights: Weights = Weights(),
        basis: Basis = LegendreBasis(),
        further: Callable[[WeightSpace], tuple[Rows, ...]] | None = None,
        kind: GoalKind = "pose",
    ) -> None:
        self.kind: GoalKind = checked_kind(kind)
        self.robot, self.limits, self.c = robot, limits.checked(robot), positive("c", c)
        self.weights, self.basis, self._further = weights, basis, further
        self._sides = lower_and_upper(robot, limits)
        shapes = Shapes.of(basis)
        self._fit = np.linalg.pinv(shapes.even[1] @ shapes.free)  # from rates by phase to coordinates
        self._even = np.linspace(0.0, 1.0, shapes.even.shape[1])

    def advance(self, before: Horizon, state: ArmState, goal: Grapple) -> Horizon:
        """Motion from a state on: the previous one, improved by Gauss-Newton iterations.

        The last second before the rendezvous with a moving goal is carried out as it was planned.
        """
        remaining = before.rendezvous - state.time
        if goal.moves and 0.0 < remaining < self.weights.shortest - EARLY:
            return before
        duration = max(remaining, self.weights.shortest)
        space = self._space(before, state, goal, duration)
        y = self._continued(before, state.time, space)
        # The first sample is the observed state, which cannot be bounded.
        bounds = Bounds(space.even[:, 1:], space.even_fixed[:, 1:], *self._sides)
        inequalities = self._inequalities(space, before.guarded)
        objective = Objective(space, bounds, self.weights, self._attitude(before, state))
        program, accepted = ElasticProgram(bounds, before.active), False
        value, error = np.inf, np.inf
        for _ in range(self.weights.iterations):
            at = space.disturbance(y[None])
            hessian, gradient = objective.quadratic(at)
            linear = [row.linear(y, at, 1.0) for row in inequalities]
            # What has no rows is far from being violated.
            close = [row for row, rows in zip(inequalities, linear, strict=True) if len(rows[1])]
            value, error = objective.value(y, at, close), _largest(space, at.goal_error)
            step = program.solve(hessian, gradient, y, linear)
            if isinstance(step, Failure):
                break
            for halving in range(MAX_HALVINGS + 1):
                trial = y + 0.5**halving * step
                there = space.effect(trial[None])
                if (better := objective.value(trial, there, close)) < value:
                    y, value, error, accepted = trial, better, _largest(space, there.goal_error), True
                    break
        late = error > GOAL_TOLERANCE and before.rendezvous < before.latest
        return replace(
            before,
            start=state.time,
            rendezvous=min(before.rendezvous + DELAY, before.latest) if late else before.rendezvous,
            duration=duration,
            weights=space.weights(y),
            value=value,
            goal_error=error,
            accepted=accepted,
            active=program.close(y),
        )

    def violates(self, horizon: Horizon, state: ArmState, goal: Grapple) -> bool:
        """Whether a motion that starts at a state violates the further inequalities."""
        if self._further is None:
            return False
        space = self._space(horizon, state, goal, horizon.duration)
        y = space.coordinates(horizon.weights)
        return any(row.violation(y) > 0.0 for row in self._further(space))

    def _continued(self, before: Horizon, time: float, space: WeightSpace) -> Array:
        """Coordinates (n, m) of the rest of the previous motion."""
        rates = before.rates(time + space.duration * self._even) * space.duration
        return (self._fit @ (rates - space.even_fixed[1] * space.duration)).T

    def _inequalities(self, space: WeightSpace, guarded: bool) -> list[Rows]:
        limits = (self.limits.torque, True), (self.limits.coriolis, False)
        found: list[Rows] = [Torques(space, most, whole) for most, whole in limits if most is not None]
        return [*found, *self._further(space)] if guarded and self._further is not None else found

    def _attitude(self, before: Horizon, state: ArmState) -> Array:
        """Desired attitude (3, 3) in the present frame of the satellite."""
        return to_matrix(multiply(conjugate(state.quaternion), before.attitude))

    def _space(self, before: Horizon, state: ArmState, goal: Grapple, duration: float) -> WeightSpace:
        """Motions from the state, in the present frame of the satellite."""
        end = goal.in_frame(state.position, state.quaternion).at(duration)
        attitude = self._attitude(before, state)
        return WeightSpace(
            self.robot,
            self.basis,
            state.angles,
            state.rates,
            duration,
            end.position,
            to_matrix(end.quaternion),
            self.c,
            attitude,
            self._following(before, attitude, end.twist) if goal.moves else None,
            kind=self.kind,
        )

    def _following(self, before: Horizon, attitude: Array, twist: Array) -> Array:
        """Joint rates (n,) at the end that give the end-effector a twist (6,)."""
        q = before.weights @ self.basis.value(1.0)
        # To first order the satellite has the desired attitude there.
        local = np.concatenate([attitude.T @ twist[:3], attitude.T @ twist[3:]])
        jacobian = self.robot.generalized_jacobian(q)
        square = jacobian @ jacobian.T + GOAL_DAMPING * np.eye(6)
        return jacobian.T @ np.linalg.solve(square, local)


def _largest(space: WeightSpace, goal_error: Array) -> float:
    """Largest component of a terminal error (1, r + 3) of the end-effector, m or rad."""
    return float(np.abs(goal_error[0, : space.rows]).max())
