"""Nonlinear model predictive control of the single arm: a shrinking horizon in the weights of a ProMP.

At every control step the motion that is left is planned anew from the state observed, on the momentum-level
model, by one Gauss-Newton iteration from the motion planned before (real-time iteration; Diehl, Bock and
Schloeder 2005). The goal is a pose in the inertial frame at a given time and may move.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from agents.planners.common.plans import Failure, Limits
from agents.planners.single_arm.library import Library
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.weights.elastic import PRICE, SLACK, Active, ElasticProgram
from agents.planners.single_arm.weights.inequalities import Torques
from agents.planners.single_arm.weights.legendre import LegendreBasis
from agents.planners.single_arm.weights.promp_optimal import ANGLE_ROOM, ROOM, Planner
from agents.planners.single_arm.weights.quadratic import Bounds
from agents.planners.single_arm.weights.weight_space import INTERVALS, Basis, Disturbance, Shapes, WeightSpace
from space_envs.checks import non_negative
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, conjugate, exponential, multiply, rotate, to_matrix
from space_envs.errors import ConfigurationError, positive, positive_integer

POLISH = 10  # control steps' worth of iterations on the first plan
HALVINGS = 3  # of a step that makes the objective worse, before it is left out
LATE = 5e-3  # m or rad, that a motion may miss the goal by before it is given more time
DELAY = 0.1  # s more in a control step
TIP_DAMPING = 1e-3  # of the joint rates that follow a moving goal, squared singular value

Target = Callable[[float], tuple[Array, Array, Array]]
"""Where the goal is at a time, s: position (3,) m, quaternion (4,) w x y z, twist (6,) [v m/s; w rad/s], all
in the inertial frame."""


def coasting(position: Array, quaternion: Array, twist: Array, time: float = 0.0) -> Target:
    """A goal that keeps its twist (6,), with the position (3,) m and quaternion (4,) it has at `time`, s."""

    def target(then: float) -> tuple[Array, Array, Array]:
        ahead = then - time
        turned = multiply(exponential(twist[3:] * ahead), quaternion)
        return position + twist[:3] * ahead, turned, twist

    return target


@dataclass(frozen=True)
class Weights:
    """What the controller minimises besides eq. 20, and how far it looks.

    Attributes:
        duration: from the start to the goal, s. latest: likewise, when limits delay it. shortest: horizon, s,
            that is kept when less time is left.
        goal: of the end-effector's miss at the end, 1/m^2 and 1/rad^2. attitude_end: of the satellite's
            attitude at the end, 1/rad^2. attitude_late: over the last `late` s, growing from 0, 1/(rad^2 s).
            attitude: at all times, likewise.
        damping: of changes of the motion, per unit of the integral of qdot' qdot over phase.
        iterations: Gauss-Newton steps a control step.
    """

    duration: float = 16.0
    latest: float = 18.0
    shortest: float = 1.0
    goal: float = 1e4
    attitude_end: float = 1e3
    attitude_late: float = 1e2
    late: float = 4.0
    attitude: float = 1.0
    damping: float = 1e-4
    iterations: int = 1

    def __post_init__(self) -> None:
        for name in ("duration", "latest", "shortest", "late", "damping"):
            positive(name, getattr(self, name))
        for name in ("goal", "attitude_end", "attitude_late", "attitude"):
            non_negative(f"weight of {name}", getattr(self, name))
        positive_integer("iterations", self.iterations, 100)
        if self.latest < self.duration:
            raise ConfigurationError(f"latest must be at least {self.duration} s, got {self.latest!r}")


@dataclass(frozen=True, eq=False)
class ArmState:
    """What is observed: time s, angles (n,) rad, rates (n,) rad/s, satellite's position (3,) m and attitude
    (4,) w x y z in the inertial frame."""

    time: float
    angles: Array
    rates: Array
    position: Array
    quaternion: Array


@dataclass(frozen=True, eq=False)
class Horizon:
    """The motion that is planned, from `begin` to the end of the horizon.

    Attributes:
        begin: s, time of its start. meeting: s, when the goal is to be met. latest: s, likewise, when
            limits delay it. attitude: (4,) of the satellite that is to be kept.
        basis: of the weights. duration: of the motion, s. weights: (n, nb) of the motion.
        accepted: whether the last iteration was of use; otherwise the motion goes on as it was.
        active: bounds that it comes near.
    """

    begin: float
    meeting: float
    latest: float
    attitude: Array
    basis: Basis
    duration: float
    weights: Array
    accepted: bool = True
    active: Active = frozenset()

    def motion(self, times: Array) -> tuple[Array, Array]:
        """Joint angles and rates (T, n), rad and rad/s, at times (T,) s after its beginning."""
        angles = self.basis.value(np.clip(times / self.duration, 0.0, 1.0)) @ self.weights.T
        return angles, self.rates(self.begin + times)

    def rates(self, times: Array) -> Array:
        """Joint rates (..., n), rad/s, at times (...,) s; times beyond the ends count as the ends."""
        phase = np.clip((np.asarray(times) - self.begin) / self.duration, 0.0, 1.0)
        return self.basis.derivative(phase) @ self.weights.T / self.duration


class Controller:
    """Receding-horizon control of one robot.

    Args:
        robot: of one arm. limits: that motions keep. c: m/rad, of eq. 20. library: of stored motions that the
            first plan starts from. weights: of the objective.
    """

    def __init__(
        self,
        robot: FloatingRobot,
        limits: Limits,
        c: float = 1.0,
        library: Library | None = None,
        weights: Weights = Weights(),
        basis: Basis = LegendreBasis(),
    ) -> None:
        self.weights = weights
        limits = limits.checked(robot)
        self._robot, self._limits, self._c, self._basis = robot, limits, positive("c", c), basis
        self._planner = Planner(robot, limits, library)
        self._bounds = _low_and_high(robot, limits)
        shapes = Shapes.of(basis)
        self._fit = np.linalg.pinv(shapes.even[1] @ shapes.free)  # from rates by phase to coordinates
        self._even = np.linspace(0.0, 1.0, shapes.even.shape[1])

    def first_plan(self, state: ArmState, target: Target) -> Horizon | Failure:
        """The motion that an episode begins with, solved to the end, or why there is none.

        The attitude that is kept is the one that the satellite has now. Where no motion keeps it, the motion
        is one to the goal alone; what follows regulates the attitude as far as it can.
        """
        duration = self.weights.duration
        position, quaternion, _ = target(state.time + duration)
        back = conjugate(state.quaternion)
        reach = Reach(
            start=state.angles,
            position=rotate(back, position - state.position),
            quaternion=multiply(back, quaternion),
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
        meeting = state.time + duration
        horizon = Horizon(
            begin=state.time,
            meeting=meeting,
            latest=meeting,
            attitude=state.quaternion,
            basis=self._basis,
            duration=duration,
            weights=np.linalg.lstsq(values, found.position, rcond=None)[0].T,
        )
        for _ in range(POLISH):  # in the basis and with the objective of this controller
            horizon = self.advance(horizon, state, target)
        return replace(horizon, latest=state.time + self.weights.latest)

    def advance(self, before: Horizon, state: ArmState, target: Target) -> Horizon:
        """The motion from the state on: the one before, improved by the Gauss-Newton iterations."""
        duration = max(before.meeting - state.time, self.weights.shortest)
        end_rate = self._following(before, state.time + duration, target)
        space = self._space(before, state, target, duration, end_rate)
        wanted = before.rates(state.time + duration * self._even) * duration
        y = (self._fit @ (wanted - space.even_fixed[1] * duration)).T
        # What is given at the start cannot be bounded there.
        bounds = Bounds(space.even[:, 1:], space.even_fixed[:, 1:], *self._bounds)
        torques = [
            Torques(space, limit, accelerating)
            for limit, accelerating in ((self._limits.torque, True), (self._limits.coriolis, False))
            if limit is not None
        ]
        objective = _Objective(space, bounds, torques, self.weights, self._attitude(before, state))
        at = space.disturbance(y[None])
        value, accepted = objective.value(y, at), False
        program = ElasticProgram(bounds, before.active)
        for _ in range(self.weights.iterations):
            hessian, gradient = objective.quadratic(at)
            step = program.solve(hessian, gradient, y, [row.linear(y, at, 1.0) for row in torques])
            if step is None:
                break
            for halving in range(HALVINGS + 1):
                trial = y + 0.5**halving * step
                there = space.disturbance(trial[None])
                if (better := objective.value(trial, there)) < value:
                    y, at, value, accepted = trial, there, better, True
                    break
        late = float(np.abs(at.miss[0, :6]).max()) > LATE and before.meeting < before.latest
        return replace(
            before,
            begin=state.time,
            meeting=min(before.meeting + DELAY, before.latest) if late else before.meeting,
            duration=duration,
            weights=space.weights(y),
            accepted=accepted,
            active=program.touched(y),
        )

    def _attitude(self, before: Horizon, state: ArmState) -> Array:
        """Attitude to keep (3, 3), seen from the satellite as it is now."""
        return to_matrix(multiply(conjugate(state.quaternion), before.attitude))

    def _space(
        self, before: Horizon, state: ArmState, target: Target, duration: float, end_rate: Array
    ) -> WeightSpace:
        """Motions from the state, in the frame of the satellite as it is now."""
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
        """Joint rates (n,) at the end with which the end-effector has the goal's twist."""
        twist = target(end)[2]
        if not twist.any():
            return np.zeros(self._robot.n_joints)
        q = before.weights @ self._basis.value(1.0)
        # The satellite has the attitude to keep there, to first order.
        turn = conjugate(before.attitude)
        local = np.concatenate([rotate(turn, twist[:3]), rotate(turn, twist[3:])])
        jacobian = self._robot.generalized_jacobian(q)
        square = jacobian @ jacobian.T + TIP_DAMPING * np.eye(6)
        return jacobian.T @ np.linalg.solve(square, local)


def _low_and_high(robot: FloatingRobot, limits: Limits) -> tuple[Array, Array]:
    """Least and greatest angles, rates and accelerations, (3, n) each."""
    n = robot.n_joints
    angles = np.tile([-np.inf, np.inf], (n, 1)) if limits.position is None else limits.position
    angles = angles + ANGLE_ROOM * np.array([1.0, -1.0])
    most = [np.full(n, np.inf if x is None else ROOM * x) for x in (limits.rate, limits.acceleration)]
    return np.stack([angles[:, 0], *(-x for x in most)]), np.stack([angles[:, 1], *most])


class _Objective:
    """The sum of squares that is minimised over a space of motions.

    Args:
        attitude: (3, 3) of the satellite that is to be kept, in the space's frame.
    """

    def __init__(
        self,
        space: WeightSpace,
        bounds: Bounds,
        torques: Sequence[Torques],
        weights: Weights,
        attitude: Array,
    ) -> None:
        self._space, self._bounds, self._torques = space, bounds, torques
        self._weights, self._back = weights, attitude.T
        length = space.duration / INTERVALS
        left = space.duration - length * np.arange(1, INTERVALS + 1)  # s until the end
        density = weights.attitude + weights.attitude_late * np.clip(1.0 - left / weights.late, 0.0, 1.0)
        density = density * length
        density[-1] += weights.attitude_end
        self._scale = np.sqrt(density)
        self._unit = np.eye(space.size) * 2.0 * weights.damping

    def value(self, y: Array, at: Disturbance) -> float:
        """At coordinates (n, m), with a price on bounds that are broken."""
        miss, turn = at.miss[0, :6], self._scale[:, None] * self._turned(at)
        beyond = sum(row.violation(y) for row in self._torques)
        if self._bounds.any:
            beyond += max(float(self._bounds.excess(y).max()) - SLACK, 0.0)
        missed = self._weights.goal * (miss @ miss)
        return float(at.cost[0] + missed + (turn * turn).sum() + PRICE * beyond)

    def quadratic(self, at: Disturbance) -> tuple[Array, Array]:
        """Hessian (n m, n m) by Gauss and Newton, damped, and gradient (n m,) at one motion."""
        root = np.sqrt(self._weights.goal)
        turn = self._scale[:, None] * self._turned(at)
        slope = self._scale[:, None, None] * self._space.drifts(at.pushes)[0, 1:, 3:]
        size = self._space.size
        rows = np.concatenate([at.residual_slope[0], root * at.miss_slope[0, :6], slope.reshape(-1, size)])
        values = np.concatenate([at.residual[0], root * at.miss[0, :6], turn.ravel()])
        return 2.0 * rows.T @ rows + self._unit, 2.0 * values @ rows

    def _turned(self, at: Disturbance) -> Array:
        """Rotation vectors (K, 3), rad, of the satellite from the attitude to keep, after each interval."""
        rotation = at.pose[0, 1:, 3:].reshape(-1, 3, 3).swapaxes(1, 2) @ self._back
        skew = 0.5 * (rotation - rotation.swapaxes(1, 2))
        axial = np.stack([skew[:, 2, 1], skew[:, 0, 2], skew[:, 1, 0]], axis=1)
        sine = np.sqrt((axial * axial).sum(axis=1))
        angle = np.arctan2(sine, 0.5 * (np.trace(rotation, axis1=1, axis2=2) - 1.0))
        return axial * np.divide(angle, sine, out=np.ones_like(sine), where=sine > 1e-9)[:, None]
