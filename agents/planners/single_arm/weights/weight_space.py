"""Motions in the weights of a ProMP with eliminated boundary conditions, and their effect on the base.

A motion is q(t) = Psi(t) W' with weights W (n, nb) of the ProMP's basis. With the start, the start rate and
the end rate given, nb - 3 functions a joint are free; the coordinates y (n, nb - 3) with respect to them are
scaled so that the sum of their squares is the integral of qdot' qdot that they add.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.shapes import INTERVALS, Basis, Shapes
from space_envs.dynamics import FloatingRobot, attitude_cost
from space_envs.dynamics.rotations import Array
from space_envs.tasks.goals.kinds import GOAL_ROWS, GoalKind

DENSE = 128  # intervals of the integral for reported costs: with 16 they are up to 1.3 % too low


@dataclass(frozen=True, eq=False)
class Disturbance:
    """Costs and terminal errors of motions (S,), with derivatives by the coordinates y, flattened (n m).

    Attributes:
        cost: (S,) eq. 20 times dt, m^2/s. goal_error: (S, r + 3) at the end: position m and rotation rad of
            the end-effector from its goal, as far as the goal asks for them, then rotation rad of the base
            from its goal.
        residual: (S, R) whose squares sum to the cost. residual_slope: (S, R, n m).
        goal_slope: (S, r + 3, n m).
        pose: (S, K + 1, 12) of the base at the ends of the intervals.
        influence: (S, 2 K, 6, 2 n) later displacement of the base, in inertial axes at the inertial origin,
            by [q; qdot] at the Gauss points. propagation: (S, 2 K, 6, 6) the same by the twists.
        ending: (S, r + 3, 6 + n) goal error by the displacement of the base at the end, and the last angles.
    """

    cost: Array
    goal_error: Array
    residual: Array
    residual_slope: Array
    goal_slope: Array
    pose: Array
    influence: Array
    propagation: Array
    ending: Array


class Effect(NamedTuple):
    """Cost (S,), goal error (S, r + 3) and base poses (S, K + 1, 12) of motions, as in `Disturbance`."""

    cost: Array
    goal_error: Array
    pose: Array


class WeightSpace:
    """Motions with one start, duration and goal.

    The frame of all poses is that of the base at the start.

    Args:
        start, rate: (n,) rad and rad/s. duration: s. position, rotation: (3,) m and (3, 3) of the
            end-effector at the end. c: m/rad, of eq. 20. attitude: (3, 3) of the base at the end, where it
            is constrained; None for that of the start. end_rate: (n,) rad/s at the end; None for rest.
        kind: of the goal.

    Attributes:
        rows: r, number of equations of the goal.
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
        kind: GoalKind = "pose",
    ) -> None:
        self.shapes = shapes = Shapes.of(basis)
        self.functions, self.rows = ArmFunctions.of(robot, INTERVALS), GOAL_ROWS[kind]
        self._ended = self.functions.ending_of(kind)
        self._bent = self.functions.ending_curvature_of(kind)
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
        self._tiled = np.tile(self._gauss, self._n)[:, :, None]  # (2, 2 K, 1, n m), the same for every joint
        self._gauss_fixed = gauss[:2] @ self.fixed.T  # (2, 2 K, n)
        self.even, self.even_fixed = even @ shapes.free, even @ self.fixed.T
        self._end, self._end_fixed = shapes.end @ shapes.free, self.fixed @ shapes.end
        self._step = duration / INTERVALS
        weight = np.sqrt(0.5 * duration / INTERVALS)
        self._scale = weight * np.array([1.0, 1.0, 1.0, c, c, c])
        self._c = c

    def constrained(self, keep_attitude: bool) -> int:
        """Number of equations for the end, with or without those of the base's attitude."""
        return self.rows + 3 if keep_attitude else self.rows

    def weights(self, y: Array) -> Array:
        """ProMP weights (..., n, nb) of coordinates (..., n, m)."""
        return self.fixed + y @ self.shapes.free.T

    def coordinates(self, weights: Array) -> Array:
        """Coordinates (..., n, m) with the nearest weights to weights (..., n, nb)."""
        return (weights - self.fixed) @ np.linalg.pinv(self.shapes.free).T

    def _states(self, y: Array) -> Array:
        """Angles and rates (2, S, 2 K, n) at the Gauss points."""
        return self._gauss_fixed[:, None] + (y @ self._gauss.swapaxes(1, 2)[:, None]).swapaxes(-1, -2)

    def poses(self, y: Array) -> Array:
        """Base poses (S, K + 1, 12) at the ends of the intervals."""
        return self._chain(self.functions.twist(*self._states(y))[0])[0]

    def last(self, y: Array) -> tuple[Array, Array]:
        """Angles (n,), rad, and attitude (3, 3) of the base at the end of a motion, coordinates (n, m)."""
        rotation = self.poses(y[None])[0, -1, 3:].reshape(3, 3).T
        return self._end_fixed + y @ self._end, rotation

    def dense_cost(self, y: Array) -> Array:
        """Eq. 20 times dt (S,), m^2/s, of coordinates (S, n, m), by a finer quadrature than `values`."""
        value, slope, _ = Shapes.of(self.shapes.basis, DENSE).gauss
        columns = self.weights(y).swapaxes(-1, -2)
        (xi,) = self.functions.twist(value @ columns, slope @ columns / self.duration)
        return attitude_cost(xi, 0.5 * self.duration / DENSE, self._c)

    def values(self, y: Array) -> tuple[Array, Array]:
        """Cost (S,) and terminal goal error (S, r + 3) of coordinates (S, n, m)."""
        cost, goal_error, _ = self.effect(y)
        return cost, goal_error

    def effect(self, y: Array) -> Effect:
        """Costs, goal errors and base poses of coordinates (S, n, m), without derivatives."""
        (xi,) = self.functions.twist(*self._states(y))
        residual = xi * self._scale
        pose = self._chain(xi)[0]
        return Effect((residual * residual).sum(axis=(1, 2)), self._ending(y, pose[:, -1])[0], pose)

    def disturbance(self, y: Array) -> Disturbance:
        """Costs and goal errors of coordinates (S, n, m) with their derivatives."""
        s, n, m = len(y), self._n, self.free
        xi, slope = self.functions.slopes(*self._states(y))
        pose, propagation = self._chain(xi)
        residual = (xi * self._scale).reshape(s, 12 * INTERVALS)
        scaled = slope * self._scale[:, None]
        change = scaled[..., :n].repeat(m, axis=-1)  # (S, 2 K, 6, n m)
        change *= self._tiled[0]
        by_rate = scaled[..., n:].repeat(m, axis=-1)
        by_rate *= self._tiled[1]
        change += by_rate
        propagation = propagation.reshape(s, 2 * INTERVALS, 6, 6)
        influence = propagation @ slope
        goal_error, ending = self._ending(y, pose[:, -1])
        goal_slope = ending[..., :6] @ self.displacement(influence)
        goal_slope += (ending[..., 6:, None] * self._end).reshape(s, self.rows + 3, n * m)
        return Disturbance(
            cost=(residual * residual).sum(axis=1),
            goal_error=goal_error,
            residual=residual,
            residual_slope=change.reshape(s, 12 * INTERVALS, n * m),
            goal_slope=goal_slope,
            pose=pose,
            influence=influence,
            propagation=propagation,
            ending=ending,
        )

    def curvature(self, y: Array, at: Disturbance, weight: Array) -> Array:
        """Second derivatives (n m, n m) of cost + weight' goal_error at coordinates (n, m).

        Those of the exponential of one interval are neglected, and the residuals' part by first derivatives
        is left out: add 2 residual_slope' residual_slope.

        Args:
            at: what `disturbance` returns for y. weight: (r + 3,).
        """
        push = weight @ at.ending[0, :, :6]  # on displacements at the end
        twist_weight = 2.0 * self._scale * at.residual[0].reshape(-1, 6) + push @ at.propagation[0]
        states = self._states(y[None])[:, 0]
        (bend,) = self.functions.curvature(*states, twist_weight)
        half = self._through_twists(bend)
        moved = self._moved(at.influence[0])  # (2 K, 6, n m)
        before = moved.cumsum(axis=0) - moved
        before[1::2] += (2.0 / np.sqrt(3.0) - 1.0) * moved[::2]  # within an interval, by Magnus' term
        half += 0.5 * before.reshape(-1, self.size).T @ (_pairing(push) @ moved).reshape(-1, self.size)
        last = np.concatenate([moved.sum(axis=0), np.kron(np.eye(self._n), self._end)])
        end = self._end_fixed + y @ self._end
        (second,) = self._bent(end, at.pose[0, -1], self._goal, weight)
        return half + half.T + last.T @ second @ last

    def _through_twists(self, bend: Array) -> Array:
        """Half the second derivatives (n m, n m) by coordinates; bend (2 K, n, 2 n) by angles and rates."""
        n, m = self._n, self.free
        angle, rate = self._gauss[:, :, None, None]  # (2 K, 1, 1, m)
        mixed = 0.5 * bend[:, :, :n, None] * angle + bend[:, :, n:, None] * rate
        half = self._gauss[0].T @ mixed.reshape(-1, n * n * m)
        return half.reshape(m, n, n * m).swapaxes(0, 1).reshape(n * m, n * m)

    def _moved(self, influence: Array) -> Array:
        """Later displacement (2 K, 6, n m) of the base through each Gauss point, by the coordinates."""
        n = self._n
        angle, rate = self._gauss[:, :, None, None]
        moved = influence[..., :n, None] * angle + influence[..., n:, None] * rate
        return moved.reshape(-1, 6, self.size)

    def displacement(self, influence: Array) -> Array:
        """Displacement (S, 6, n m) of the base at the end by the coordinates."""
        s, n, points = len(influence), self._n, 2 * INTERVALS
        columns = influence.reshape(s, points, 12 * n).swapaxes(1, 2).reshape(s, 6, 2, n, points)
        angle, rate = self._gauss
        return (columns[:, :, 0] @ angle + columns[:, :, 1] @ rate).reshape(s, 6, self.size)

    def displacements(self, influence: Array) -> Array:
        """Displacements (S, K + 1, 6, n m) of the base at the ends of all intervals by the coordinates."""
        s, n = len(influence), self._n
        by_interval = influence.reshape(s, INTERVALS, 2, 6, 2, n).transpose(0, 1, 3, 5, 2, 4)
        gauss = self._gauss.reshape(2, INTERVALS, 2, self.free).transpose(1, 2, 0, 3)
        moved = by_interval.reshape(s, INTERVALS, 6 * n, 4) @ gauss.reshape(INTERVALS, 4, self.free)
        moved = moved.reshape(s, INTERVALS, 6, self.size).cumsum(axis=1)
        return np.concatenate([np.zeros((s, 1, 6, self.size)), moved], axis=1)

    def _chain(self, xi: Array) -> list[Array]:
        step = np.full((len(xi), 1), self._step)
        return self.functions.chain(xi.reshape(len(xi), 12 * INTERVALS), step)

    def _ending(self, y: Array, pose: Array) -> list[Array]:
        goal = self._goal[None].repeat(len(y), axis=0)
        return self._ended(self._end_fixed + y @ self._end, pose, goal)


def _pairing(push: Array) -> Array:
    """Matrix (6, 6) M of x' M z = push' [x, z], the commutator of twists [v; w]."""
    linear, angular = (np.cross(np.eye(3), part).T for part in (push[:3], push[3:]))
    return np.block([[np.zeros((3, 3)), linear], [linear, angular]])
