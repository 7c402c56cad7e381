"""Motions of many problems in the weights of a ProMP, and their effect on the base, with derivatives.

A motion is q(t) = Psi(t) W' with weights W (n, nb). With the start, its rate and rest at the end given,
nb - 3 functions a joint are free: the coordinates y (n, nb - 3). `WeightSpace` is the same for one problem.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.shapes import Basis, Shapes
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, to_matrix

INTERVALS = 12  # of the roll-out of the base, which moves by less than 1e-3 m and 2e-4 rad with 64
SAMPLES = 33  # at which limits count


@dataclass(frozen=True, eq=False)
class Problems:
    """Problems of S motions, in the frame of the base at the start of each.

    Attributes:
        start, rate: (S, n) rad and rad/s at the start. duration: (S,) s.
        goal: (S, 21) position m and rotation of the end-effector, and rotation of the base, at the end, the
            rotations by columns.
    """

    start: Array
    rate: Array
    duration: Array
    goal: Array

    @classmethod
    def of(
        cls,
        start: Array,
        rate: Array,
        duration: Array,
        position: Array,
        quaternion: Array,
        attitude: Array | None = None,
    ) -> Self:
        """Problems with goals (S, 3) and (S, 4); attitudes (S, 4) at the end, None for those at first."""
        s = len(start)
        unit = np.tile([1.0, 0.0, 0.0, 0.0], (s, 1)) if attitude is None else attitude
        columns = [to_matrix(each).swapaxes(1, 2).reshape(s, 9) for each in (quaternion, unit)]
        return cls(start, rate, duration, np.concatenate([position, *columns], axis=1))

    def rows(self, chosen: NDArray[Any]) -> "Problems":
        """Problems of some rows, by number or mask."""
        return Problems(self.start[chosen], self.rate[chosen], self.duration[chosen], self.goal[chosen])


class Linearised(NamedTuple):
    """Costs and terminal errors of S motions with derivatives by the coordinates, flattened (n m).

    Attributes:
        residual: (S, R), whose squares sum to the cost, eq. 20 times dt, m^2/s. by: (S, R, n m).
        error: (S, 9) at the end: position m and rotation rad of the end-effector from the goal, rotation rad
            of the base from its goal. error_by: (S, 9, n m).
    """

    residual: Array
    by: Array
    error: Array
    error_by: Array


class MotionBatch:
    """Motions of S problems.

    Args:
        robot: of one arm. basis: of the weights. c: m/rad, of eq. 20.

    Attributes:
        size: n m, number of coordinates. joints, free: n and m.
    """

    def __init__(self, robot: FloatingRobot, basis: Basis, problems: Problems, c: float) -> None:
        self._shapes = shapes = Shapes.of(basis, INTERVALS, SAMPLES)
        self._functions, self.problems = ArmFunctions.of(robot, INTERVALS), problems
        self.joints, self.free = robot.n_joints, shapes.free.shape[1]
        self.size = self.joints * self.free
        t = problems.duration[:, None]
        ends = np.stack([problems.start, problems.rate * t, np.zeros_like(problems.start)], axis=2)
        self.fixed = ends @ shapes.fixed.T  # (S, n, nb)
        self._gauss, self._even = shapes.gauss[:2] @ shapes.free, shapes.even @ shapes.free
        self._end = shapes.end @ shapes.free
        self._per_time = problems.duration ** -np.arange(3.0)[:, None]  # (3, S)
        self._step = t / INTERVALS
        self._scale = np.sqrt(0.5 * self._step) * np.array([1.0, 1.0, 1.0, c, c, c])

    def weights(self, y: Array) -> Array:
        """ProMP weights (S, n, nb) of coordinates (S, n, m)."""
        return self.fixed + y @ self._shapes.free.T

    def coordinates(self, weights: Array) -> Array:
        """Coordinates (S, n, m) with the nearest weights to weights (S, n, nb)."""
        return (weights - self.fixed) @ np.linalg.pinv(self._shapes.free).T

    def samples(self, y: Array) -> Array:
        """Angles, rates and accelerations (3, S, P, n) of coordinates (S, n, m) at even times."""
        return self._at(self._shapes.even, y)

    @property
    def samples_by(self) -> Array:
        """Their derivatives (3, S, P, m) by the coordinates of the joint."""
        return self._even[:, None] * self._per_time[:, :, None, None]

    def effect(self, y: Array) -> tuple[Array, Array]:
        """Costs (S,), m^2/s, and errors (S, 9) of coordinates (S, n, m), as in `Linearised`."""
        (twist,) = self._functions.twist(*self._at(self._shapes.gauss[:2], y))
        residual = twist * self._scale[:, None]
        pose = self._functions.chain(twist.reshape(len(y), -1), self._step)[0]
        return (residual * residual).sum(axis=(1, 2)), self._ending(y, pose)[0]

    def linearised(self, y: Array) -> Linearised:
        """Costs and errors of coordinates (S, n, m) with their derivatives."""
        s, n, points = len(y), self.joints, 2 * INTERVALS
        twist, slope = self._functions.slopes(*self._at(self._shapes.gauss[:2], y))
        pose, propagation = self._functions.chain(twist.reshape(s, -1), self._step)
        angle, rate = self._gauss[0], self._gauss[1] * self._per_time[1, :, None, None]
        scaled = slope * self._scale[:, None, :, None]
        by = scaled[..., :n, None] * angle[:, None, None]
        by += scaled[..., n:, None] * rate[:, :, None, None]
        later = (propagation.reshape(s, points, 6, 6) @ slope).transpose(0, 2, 3, 1)  # (S, 6, 2 n, points)
        error, ending = self._ending(y, pose)
        moved = later[:, :, :n] @ angle + later[:, :, n:] @ rate[:, None]
        error_by = ending[..., :6] @ moved.reshape(s, 6, self.size)
        error_by += (ending[..., 6:, None] * self._end).reshape(s, 9, self.size)
        residual = (twist * self._scale[:, None]).reshape(s, -1)
        return Linearised(residual, by.reshape(s, 6 * points, self.size), error, error_by)

    def _at(self, functions: Array, y: Array) -> Array:
        """Motion and its derivatives by time (k, S, points, n), for functions (k, points, nb)."""
        weights = self.weights(y).swapaxes(-1, -2)
        found = functions[:, None] @ weights
        return found * self._per_time[: len(functions), :, None, None]

    def _ending(self, y: Array, pose: Array) -> Sequence[Array]:
        end = self.weights(y) @ self._shapes.end
        return self._functions.ending(end, pose[:, -1], self.problems.goal)
