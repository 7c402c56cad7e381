"""Motions in the weights of a ProMP whose boundary conditions are eliminated, and what they do to the base.

A motion is q(t) = Psi(t) W' with weights W (n, nb) of the ProMP's basis. What the start, the start's rate and
rest at the end leave free is spanned by nb - 3 functions a joint; the coordinates y (n, nb - 3) with respect
to them are chosen so that the sum of their squares is the integral of qdot' qdot that they add.
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike

from agents.planners.single_arm.weights.functions import ArmFunctions
from space_envs.dynamics import FloatingRobot, attitude_cost
from space_envs.dynamics.rotations import Array

INTERVALS = 16  # of the base's roll-out, with two Gauss points each
SAMPLES = 101  # at which limits are kept
DENSE = 128  # intervals of the integral that a cost is stated by: 16 are up to 1.3 % too low
_FINE = 401


class Basis(Protocol):
    """Functions of phase in [0, 1], (...) -> (..., nb), with derivatives by phase; hashable."""

    def __hash__(self) -> int: ...

    def value(self, phase: ArrayLike) -> Array: ...

    def derivative(self, phase: ArrayLike) -> Array: ...

    def second_derivative(self, phase: ArrayLike) -> Array: ...


@dataclass(frozen=True, eq=False)
class Shapes:
    """The functions of phase that motions are made of, for one basis; times have the unit of the duration.

    Attributes:
        fixed: (nb, 3) weights of a joint per start, start's rate (times T) and end's rate (times T).
        free: (nb, m) weights of the free functions.
        gauss, even: basis functions (3, count, nb): value, first and second derivative by phase, at the
            Gauss points and on an even grid. end: (nb,) at phase 1.
    """

    basis: Basis
    fixed: Array
    free: Array
    gauss: Array
    even: Array
    end: Array

    @classmethod
    def of(cls, basis: Basis, intervals: int = INTERVALS, samples: int = SAMPLES) -> "Shapes":
        """Those of a basis, made at first use and kept."""
        return _shapes(basis, intervals, samples)


@lru_cache(maxsize=8)
def _shapes(basis: Basis, intervals: int, samples: int) -> Shapes:
    ends = np.stack([basis.value(0.0), basis.derivative(0.0), basis.derivative(1.0)])
    rate = basis.derivative(np.linspace(0.0, 1.0, _FINE))
    square = rate.T @ rate / (_FINE - 1)  # integral of qdot^2
    null = np.linalg.svd(ends)[2][3:].T
    factor = np.linalg.cholesky(null.T @ square @ null)
    any_way = np.linalg.pinv(ends)
    quietest = any_way - null @ np.linalg.solve(null.T @ square @ null, null.T @ square @ any_way)
    points = (np.arange(intervals)[:, None] + 0.5 + np.array([-0.5, 0.5]) / np.sqrt(3.0)).ravel() / intervals

    def at(phase: Array) -> Array:
        return np.stack([basis.value(phase), basis.derivative(phase), basis.second_derivative(phase)])

    return Shapes(
        basis=basis,
        fixed=quietest,
        free=null @ np.linalg.inv(factor).T,
        gauss=at(points),
        even=at(np.linspace(0.0, 1.0, samples)),
        end=basis.value(1.0),
    )


@dataclass(frozen=True, eq=False)
class Disturbance:
    """What motions (S,) do, with first derivatives by the coordinates y, flattened (n m).

    Attributes:
        cost: (S,) eq. 20 times dt, m^2/s. miss: (S, 9) position m and rotation rad of the end-effector from
            its goal, rotation of the base from its goal, rad.
        residual: (S, R) whose squares sum to the cost. residual_slope: (S, R, n m).
        miss_slope: (S, 9, n m).
        pose: (S, K + 1, 12) of the base at the ends of the intervals.
        pushes: (S, 2 K, 6, 2 n) displacement of the base, in inertial axes at the inertial origin, that a
            change of [q; qdot] at a Gauss point causes afterwards.
    """

    cost: Array
    miss: Array
    residual: Array
    residual_slope: Array
    miss_slope: Array
    pose: Array
    pushes: Array


class WeightSpace:
    """The motions of one start and duration, and what they leave of one goal.

    The frame of all poses is that of the base at the start.

    Args:
        start, rate: (n,) rad and rad/s. duration: s. position, rotation: (3,) m and (3, 3) of the
            end-effector at the end. c: m/rad, of eq. 20. attitude: (3, 3) of the base at the end, where it
            is asked for; None is that of the start. end_rate: (n,) rad/s at the end; None is rest.
    """

    def __init__(
        self,
        robot: FloatingRobot,
        basis: Basis,
        start: Array,
        rate: Array,
        duration: float,
        position: Array,
        rotation: Array,
        c: float,
        attitude: Array | None = None,
        end_rate: Array | None = None,
    ) -> None:
        self.shapes = shapes = Shapes.of(basis)
        self.functions = ArmFunctions.of(robot, INTERVALS)
        attitude = np.eye(3) if attitude is None else attitude
        self.duration = duration
        self._goal = np.concatenate([position, rotation.T.ravel(), attitude.T.ravel()])
        self._n, self.free = robot.n_joints, shapes.free.shape[1]
        self.size = self._n * self.free
        end_rate = np.zeros(self._n) if end_rate is None else end_rate
        self.fixed = np.stack([start, rate * duration, end_rate * duration], axis=1) @ shapes.fixed.T
        per_time = duration ** -np.arange(3.0)[:, None, None]
        gauss, even = shapes.gauss * per_time, shapes.even * per_time
        self._gauss = gauss[:2] @ shapes.free  # (2, 2 K, m)
        self._gauss_fixed = gauss[:2] @ self.fixed.T  # (2, 2 K, n)
        self.even, self.even_fixed = even @ shapes.free, even @ self.fixed.T
        self._end, self._end_fixed = shapes.end @ shapes.free, self.fixed @ shapes.end
        self._step = np.array([duration / INTERVALS])
        weight = np.sqrt(0.5 * duration / INTERVALS)
        self._scale = weight * np.array([1.0, 1.0, 1.0, c, c, c])
        self._c = c

    def weights(self, y: Array) -> Array:
        """ProMP weights (..., n, nb) of coordinates (..., n, m)."""
        return self.fixed + y @ self.shapes.free.T

    def coordinates(self, weights: Array) -> Array:
        """Coordinates (..., n, m) whose weights are nearest to weights (..., n, nb)."""
        return (weights - self.fixed) @ np.linalg.pinv(self.shapes.free).T

    def _states(self, y: Array) -> Array:
        """Angles and rates (2, S, 2 K, n) at the Gauss points."""
        return self._gauss_fixed[:, None] + (y @ self._gauss.swapaxes(1, 2)[:, None]).swapaxes(-1, -2)

    def poses(self, y: Array) -> Array:
        """Base poses (S, K + 1, 12) at the ends of the intervals."""
        return self._chain(self.functions.twist(*self._states(y))[0])[0]

    def dense_cost(self, y: Array) -> Array:
        """Eq. 20 times dt (S,), m^2/s, of coordinates (S, n, m), by a far finer quadrature than `values`."""
        value, slope, _ = Shapes.of(self.shapes.basis, DENSE).gauss
        columns = self.weights(y).swapaxes(-1, -2)
        (xi,) = self.functions.twist(value @ columns, slope @ columns / self.duration)
        return attitude_cost(xi, 0.5 * self.duration / DENSE, self._c)

    def values(self, y: Array) -> tuple[Array, Array]:
        """Cost (S,) and miss (S, 9) of coordinates (S, n, m)."""
        (xi,) = self.functions.twist(*self._states(y))
        residual = xi * self._scale
        cost = (residual * residual).sum(axis=(1, 2))
        pose = self._chain(xi)[0][:, -1]
        return cost, self._ending(y, pose)[0]

    def disturbance(self, y: Array) -> Disturbance:
        """The same with derivatives."""
        s, n, m = len(y), self._n, self.free
        xi, slope = self.functions.slopes(*self._states(y))
        pose, pull = self._chain(xi)
        residual = (xi * self._scale).reshape(s, 12 * INTERVALS)
        by_angle, by_rate = self._gauss[:, :, None, None, :]  # (2 K, 1, 1, m)
        scaled = slope * self._scale[:, None]
        change = scaled[..., :n, None] * by_angle + scaled[..., n:, None] * by_rate  # (S, 2 K, 6, n, m)
        pushes = pull.reshape(s, 2 * INTERVALS, 6, 6) @ slope
        miss, ending = self._ending(y, pose[:, -1])
        miss_slope = ending[..., :6] @ self.drift(pushes)
        miss_slope += (ending[..., 6:, None] * self._end).reshape(s, 9, n * m)
        return Disturbance(
            cost=(residual * residual).sum(axis=1),
            miss=miss,
            residual=residual,
            residual_slope=change.reshape(s, 12 * INTERVALS, n * m),
            miss_slope=miss_slope,
            pose=pose,
            pushes=pushes,
        )

    def drift(self, pushes: Array) -> Array:
        """Displacement (S, 6, n m) of the base at the end, per coordinate."""
        s, n, points = len(pushes), self._n, 2 * INTERVALS
        columns = pushes.reshape(s, points, 12 * n).swapaxes(1, 2).reshape(s, 6, 2, n, points)
        angle, rate = self._gauss
        return (columns[:, :, 0] @ angle + columns[:, :, 1] @ rate).reshape(s, 6, self.size)

    def drifts(self, pushes: Array) -> Array:
        """The same (S, K + 1, 6, n m) at the ends of all intervals."""
        s, n = len(pushes), self._n
        by_interval = pushes.reshape(s, INTERVALS, 2, 6, 2, n)
        gauss = self._gauss.reshape(2, INTERVALS, 2, self.free)
        moved = np.einsum("skpixj,xkpm->skijm", by_interval, gauss, optimize=True)
        moved = moved.reshape(s, INTERVALS, 6, self.size).cumsum(axis=1)
        return np.concatenate([np.zeros((s, 1, 6, self.size)), moved], axis=1)

    def _chain(self, xi: Array) -> list[Array]:
        step = np.broadcast_to(self._step, (len(xi), 1))
        return self.functions.chain(xi.reshape(len(xi), 12 * INTERVALS), step)

    def _ending(self, y: Array, pose: Array) -> list[Array]:
        goal = np.broadcast_to(self._goal, (len(y), len(self._goal)))
        return self.functions.ending(self._end_fixed + y @ self._end, pose, goal)
