"""Paths in the reaction null space from one start towards one goal, with derivatives by their weights."""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.planners.single_arm.reactionless.flow.functions import FINER, FlowFunctions
from agents.planners.single_arm.reactionless.flow.series import Series
from agents.planners.single_arm.reactionless.goals import GoalRows, PathEnd
from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.shapes import INTERVALS
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

Index = NDArray[np.intp]
Quantity = Literal["angle", "slope", "curve", "shift"]
FUNCTIONS = 10  # sines that drive each joint
STEPS = 24  # of a roll-out in the search
STEEPEST = 1e6  # derivative of an angle by a weight; beyond it a path is lost near a singular configuration


@dataclass(frozen=True, eq=False)
class Samples:
    """A path at even phases, in units of the phase.

    Attributes:
        angle, slope, curve: (M + 1, n) q rad, dq/ds and d2q/ds2.
        shift, drift: (M + 1, 3) m, displacement of the base since the start and its derivative by s.
        miss: (r,) goal error at the end, m and rad. end: sample at which the goal is to be met; the rest of
            the path brakes the arm.
    """

    angle: Array
    slope: Array
    curve: Array
    shift: Array
    drift: Array
    miss: Array
    end: int


class Sensitivities:
    """Derivatives of a path's samples by its weights, flattened (m,) function by function.

    Attributes:
        angle, slope: (N + 1, n, m). miss: (r, m).
    """

    def __init__(self, series: Series, angle: Array, slope: Array, centre: Array, miss: Array) -> None:
        self.angle, self.slope, self.miss = angle, slope, miss
        self._series, self._centre = series, centre

    @property
    def usable(self) -> bool:
        """Whether they are finite and small enough to search by."""
        return bool(np.abs(self.angle).max() < STEEPEST)

    @cached_property
    def shift(self) -> Array:
        """Of the displacement of the base, (N + 1, 3, m)."""
        return -self._centre @ self.angle

    @cached_property
    def curve(self) -> Array:
        """Of d2q/ds2, (N + 1, n, m)."""
        return (self._series.odd @ self.slope.reshape(len(self.slope), -1)).reshape(self.slope.shape)

    def between(self, name: Quantity, time: Index, part: Index) -> Array:
        """Derivatives (k, m) of components of a quantity, at samples of `PathRollout.dense`."""
        matrix, values = self._between(name)
        out = np.empty((len(time), values.shape[2]))
        for column in np.unique(part):
            at = part == column
            out[at] = matrix[time[at]] @ values[:, column]
        return out

    def between_all(self, name: Quantity, time: Index) -> Array:
        """Derivatives (k, n, m) of all components of a quantity, at samples of `PathRollout.dense`."""
        matrix, values = self._between(name)
        return (matrix[time] @ values.reshape(len(values), -1)).reshape(-1, *values.shape[1:])

    def _between(self, name: Quantity) -> tuple[Array, Array]:
        between = self._series.between
        return {
            "angle": (between.even, self.angle),
            "slope": (between.odd, self.slope),
            "curve": (between.odd_slope, self.slope),
            "shift": (between.even, self.shift),
        }[name]


class PathRollout(NamedTuple):
    """A path in the search with what its derivatives need.

    Attributes:
        path, dense: at the ends of its steps, and in the middle between them as well.
        velocity: (3 n N,) v at the points of the steps. points: (N, 4 n) rad, at which slopes were taken.
        centre_slope: (N + 1, 3, n) m, derivatives of the centre of mass by the angles.
    """

    path: Samples
    dense: Samples
    velocity: Array
    points: Array
    centre_slope: Array


class PathSpace:
    """Paths dq/ds = P(q) v(s) with v a sum of sines: weights (n, K) are the amplitudes, rad.

    The frame is that of the base, which does not rotate.

    Args:
        start: (n,) rad. goal: equations for the end. end: step of the search after which they are to hold.
    """

    def __init__(self, robot: FloatingRobot, start: Array, goal: GoalRows, end: int = STEPS) -> None:
        self._functions = FlowFunctions.of(robot, FUNCTIONS, STEPS)
        self.arm = ArmFunctions.of(robot, INTERVALS)
        self.series, self.fine_series = Series.of(FUNCTIONS, STEPS), Series.of(FUNCTIONS, FINER * STEPS)
        self._start, self.n, self.size = start, robot.n_joints, robot.n_joints * FUNCTIONS
        self._goal, self.end = goal, end
        self._centre = self._functions.centre(start)[0]

    def samples(self, weights: Array) -> Samples:
        """The path of weights (n, K), rolled out finely."""
        series = self.fine_series
        angle, slope = self._rolled(self._functions.fine(self._start, self._velocity(weights, series))[:2])
        shift = self._centre - self._functions.centre(angle)[0]
        end = FINER * self.end
        miss = self._goal(PathEnd(angle[end], shift[end])).miss
        return Samples(angle, slope, series.odd @ slope, shift, series.even @ shift, miss, end)

    def missed(self, weights: Array) -> Array:
        """Goal error (r,) at the end of a path in the search, as in `Samples`."""
        angle = self._functions.path(self._start, self._velocity(weights, self.series))[0][self.end - 1]
        return self._goal(PathEnd(angle, self._centre - self._functions.centre(angle)[0])).miss

    def rollout(self, weights: Array) -> "PathRollout":
        """The path of weights (n, K) in the search."""
        series = self.series
        velocity = self._velocity(weights, series)
        *found, points = self._functions.path(self._start, velocity)
        angle, slope = self._rolled(found)
        centre, by_angle = self._functions.centre(angle)
        shift = self._centre - centre
        miss = self._goal(PathEnd(angle[self.end], shift[self.end])).miss
        path = Samples(angle, slope, series.odd @ slope, shift, series.even @ shift, miss, self.end)
        return PathRollout(path, self._dense(path), velocity, points, by_angle)

    def _dense(self, path: Samples) -> Samples:
        """A path at twice as many samples."""
        to, end = self.series.between, 2 * path.end
        slope, shift = path.slope, path.shift
        rates = to.odd @ slope, to.odd_slope @ slope
        moved = to.even @ shift, to.even_slope @ shift
        return Samples(to.even @ path.angle, *rates, *moved, path.miss, end)

    def sensitivities(self, rollout: "PathRollout") -> Sensitivities:
        """Derivatives of a path in the search."""
        (path, _, velocity, points, by_q), n, functions = rollout, self.n, self._functions
        at_points = velocity.reshape(STEPS, 3, n)[:, [0, 1, 1, 2]].reshape(-1, n)
        slopes = functions.slopes(points.reshape(-1, n), at_points)
        transfer = functions.transfer(*[x.reshape(STEPS, -1) for x in slopes])
        by_angle, by_slope = functions.chain(transfer, self.series.points)
        end = self.end
        _, slope_angle, slope_shift = self._goal(PathEnd(path.angle[end], path.shift[end]))
        by_miss = (slope_angle - slope_shift @ by_q[end]) @ by_angle[end]
        return Sensitivities(self.series, by_angle, by_slope, by_q, by_miss)

    def sensitive(self, weights: Array) -> tuple[Samples, Sensitivities]:
        """The path of weights (n, K) in the search, with its derivatives."""
        found = self.rollout(weights)
        return found.path, self.sensitivities(found)

    def end_twist(self, path: Samples) -> tuple[Array, Array, Array]:
        """Twist (6,) [v; w] of the end-effector at the goal by the phase, m and rad, and its slopes (6, n) by
        angle and dq/ds there."""
        twist, by_angle, by_slope = self._functions.twist(path.angle[path.end], path.slope[path.end])
        return twist, by_angle, by_slope

    def _velocity(self, weights: Array, series: Series) -> Array:
        return (series.points @ weights.T).ravel()

    def _rolled(self, found: list[Array]) -> tuple[Array, Array]:
        """Angles and slopes (M + 1, n) with those of the start and the end."""
        angle = np.concatenate([self._start[None], found[0]])
        return angle, np.concatenate([found[1], np.zeros((1, self.n))])
