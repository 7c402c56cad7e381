"""Paths in the reaction null space from one start towards one goal, with derivatives by their weights."""

from dataclasses import dataclass

import numpy as np

from agents.planners.single_arm.reactionless.functions import FINER, FlowFunctions
from agents.planners.single_arm.reactionless.series import Series
from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.shapes import INTERVALS
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

FUNCTIONS = 10  # sines that drive each joint
STEPS = 24  # of a roll-out in the search
STEEPEST = 1e6  # derivative of an angle by a weight; beyond it a path is lost near a singular configuration
KEPT = 4  # paths of a search whose derivatives are kept: it returns to the starts that it compares


@dataclass(frozen=True, eq=False)
class Samples:
    """A path at even phases, in units of the phase.

    Attributes:
        angle, slope, curve: (M + 1, n) q rad, dq/ds and d2q/ds2.
        drift: (M + 1, 3) m, velocity of the base by s.
        miss: (6,) position m and rotation rad of the end-effector from its goal, at the end.
    """

    angle: Array
    slope: Array
    curve: Array
    drift: Array
    miss: Array


@dataclass(frozen=True, eq=False)
class Sensitivities:
    """Derivatives of a path's samples by its weights, flattened (m,) function by function.

    Attributes:
        angle, slope, curve: (N + 1, n, m). drift: (N + 1, 3, m). miss: (6, m).
    """

    angle: Array
    slope: Array
    curve: Array
    drift: Array
    miss: Array

    @property
    def usable(self) -> bool:
        """Whether they are finite and small enough to search by."""
        return bool(np.abs(self.angle).max() < STEEPEST)


class PathSpace:
    """Paths dq/ds = P(q) v(s) with v a sum of sines: weights (n, K) are the amplitudes, rad.

    The frame is that of the base, which does not rotate.

    Args:
        start: (n,) rad. position, rotation: (3,) m and (3, 3) of the end-effector at the end.
    """

    def __init__(self, robot: FloatingRobot, start: Array, position: Array, rotation: Array) -> None:
        self._functions = FlowFunctions.of(robot, FUNCTIONS, STEPS)
        self.arm = ArmFunctions.of(robot, INTERVALS)
        self.series, self.fine_series = Series.of(FUNCTIONS, STEPS), Series.of(FUNCTIONS, FINER * STEPS)
        self._start, self.n, self.size = start, robot.n_joints, robot.n_joints * FUNCTIONS
        self._goal = np.concatenate([position, rotation.T.ravel(), np.eye(3).ravel()])
        self._centre = self._functions.centre(start)[0]
        self._shape = self.series.points.ravel()
        self._known: dict[bytes, tuple[Samples, Sensitivities]] = {}

    def samples(self, weights: Array) -> Samples:
        """The path of weights (n, K), rolled out finely."""
        series = self.fine_series
        angle, slope = self._rolled(self._functions.fine(self._start, self._velocity(weights, series)))
        centre = self._functions.centre(angle)[0]
        miss, _ = self._ending(angle[-1], centre[-1])
        return Samples(angle, slope, series.odd @ slope, -(series.even @ centre), miss)

    def missed(self, weights: Array) -> Array:
        """Pose error (6,) at the end of a path in the search, as in `Samples`."""
        angle = self._functions.path(self._start, self._velocity(weights, self.series))[0][-1]
        return self._ending(angle, self._functions.centre(angle)[0])[0]

    def sensitive(self, weights: Array) -> tuple[Samples, Sensitivities]:
        """The path of weights (n, K) in the search, with its derivatives; the last few are kept."""
        key = weights.tobytes()
        if key not in self._known:
            if len(self._known) == KEPT:
                self._known.pop(next(iter(self._known)))
            self._known[key] = self._sensitive(weights)
        return self._known[key]

    def _sensitive(self, weights: Array) -> tuple[Samples, Sensitivities]:
        n, m, series = self.n, self.size, self.series
        found = self._functions.sensitive(self._start, self._velocity(weights, series), self._shape)
        angle, slope = self._rolled(found[:2])
        by_angle, by_slope = np.zeros((2, STEPS + 1, n, m))
        by_angle[1:] = found[2].reshape(STEPS, n, m)
        by_slope[:-1] = found[3].reshape(STEPS, n, m)
        by_curve = (series.odd @ by_slope.reshape(STEPS + 1, n * m)).reshape(by_slope.shape)
        centre, by_q = self._functions.centre(angle)
        moved = by_q @ by_angle
        by_drift = -(series.even @ moved.reshape(STEPS + 1, 3 * m)).reshape(moved.shape)
        miss, ending = self._ending(angle[-1], centre[-1])
        by_miss = (ending[:, 6:] - ending[:, :3] @ by_q[-1]) @ by_angle[-1]
        samples = Samples(angle, slope, series.odd @ slope, -(series.even @ centre), miss)
        return samples, Sensitivities(by_angle, by_slope, by_curve, by_drift, by_miss)

    def _velocity(self, weights: Array, series: Series) -> Array:
        return (series.points @ weights.T).ravel()

    def _rolled(self, found: list[Array]) -> tuple[Array, Array]:
        """Angles and slopes (M + 1, n) with those of the start and the end."""
        angle = np.concatenate([self._start[None], found[0]])
        return angle, np.concatenate([found[1], np.zeros((1, self.n))])

    def _ending(self, angle: Array, centre: Array) -> tuple[Array, Array]:
        """Pose error (6,) and its derivative (6, 6 + n) by the base's displacement and q, at an end."""
        pose = np.concatenate([self._centre - centre, np.eye(3).ravel()])
        miss, slope = self.arm.ending(angle, pose, self._goal)
        return miss[:6], slope[:6]
