"""Objective weights, observed states and planned motions of the receding-horizon controller."""

from dataclasses import dataclass

import numpy as np

from agents.planners.single_arm.weights.elastic import Active
from agents.planners.single_arm.weights.shapes import Basis
from space_envs.checks import non_negative
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, positive, positive_integer


@dataclass(frozen=True)
class Weights:
    """Weights of the objective in addition to eq. 20, and lengths of the horizon.

    Attributes:
        duration: from the start to the rendezvous, s. earliest: the same at least, s, with a moving goal, for
            which it is chosen. latest: the same at most, where limits delay it. shortest: of the horizon, s,
            where less time remains.
        goal: on the squared terminal error of the end-effector, 1/m^2 and 1/rad^2. attitude_end: on the
            squared terminal attitude error of the satellite, 1/rad^2. attitude_late: on the same over the
            last `late` s, increasing from 0, 1/(rad^2 s). attitude: at all times, 1/(rad^2 s).
        damping: on changes of the motion, per unit of the integral of qdot' qdot over phase.
        iterations: Gauss-Newton iterations per control step.
    """

    duration: float = 16.0
    earliest: float = 10.0
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
        for name in ("duration", "earliest", "latest", "shortest", "late", "damping"):
            positive(name, getattr(self, name))
        for name in ("goal", "attitude_end", "attitude_late", "attitude"):
            non_negative(f"weight of {name}", getattr(self, name))
        positive_integer("iterations", self.iterations, 100)
        if self.latest < self.duration:
            raise ConfigurationError(f"latest must be at least {self.duration} s, got {self.latest!r}")


@dataclass(frozen=True, eq=False)
class ArmState:
    """Observed state: time s, angles (n,) rad, rates (n,) rad/s, and the satellite's position (3,) m and
    attitude (4,) w x y z in the inertial frame."""

    time: float
    angles: Array
    rates: Array
    position: Array
    quaternion: Array


@dataclass(frozen=True, eq=False)
class Horizon:
    """Planned motion from `start` to the end of the horizon.

    Attributes:
        start: s, time at which it starts. rendezvous: s, time at which the goal is to be reached. latest: s,
            latest rendezvous, where limits delay it. attitude: (4,) desired of the satellite.
        basis: of the weights. duration: of the motion, s. weights: (n, nb) of the motion.
        guarded: whether the further inequalities of its controller are imposed.
        value: of the objective. goal_error: largest component of the terminal error, m or rad; both infinite
            before the first iteration.
        accepted: whether the last iteration improved the motion; otherwise it is continued unchanged.
        active: bounds close to the motion. checked: s, time at which it was last found to be clear.
    """

    start: float
    rendezvous: float
    latest: float
    attitude: Array
    basis: Basis
    duration: float
    weights: Array
    guarded: bool = False
    value: float = np.inf
    goal_error: float = np.inf
    accepted: bool = True
    active: Active = frozenset()
    checked: float = -np.inf

    def motion(self, times: Array) -> tuple[Array, Array]:
        """Joint angles and rates (T, n), rad and rad/s, at times (T,) s after the start."""
        angles = self.basis.value(np.clip(times / self.duration, 0.0, 1.0)) @ self.weights.T
        return angles, self.rates(self.start + times)

    def rates(self, times: Array) -> Array:
        """Joint rates (..., n), rad/s, at times (...,) s, clipped to the motion."""
        phase = np.clip((np.asarray(times) - self.start) / self.duration, 0.0, 1.0)
        return self.basis.derivative(phase) @ self.weights.T / self.duration
