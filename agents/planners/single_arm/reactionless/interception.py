"""Interceptions of moving grapples along paths that never rotate the base.

The goal is met before the end of a path: the arm has the pose and, as far as that is possible, the twist of
the grapple after a share of it, and the rest of the path could bring the arm to rest again. At a given time
the six equations of the twist face five unknowns: the arm's rates are in the four-dimensional null space, and
its pose leaves it a motion of one dimension. The twist is therefore matched in the sense of least squares,
and the time of interception, where it is free, is the sixth unknown.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.reactionless.goals import PoseRows
from agents.planners.single_arm.reactionless.improvement import (
    METHOD,
    Candidate,
    Effort,
    PathImprover,
)
from agents.planners.single_arm.reactionless.limits import PathLimits
from agents.planners.single_arm.reactionless.objectives import LeastDisturbance
from agents.planners.single_arm.reactionless.paths import FUNCTIONS, STEPS, PathSpace, Samples, Sensitivities
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, to_matrix

END = 20  # step of a path at which it meets the goal
TIMES = 6  # of interception in a window, that are compared first
NEAREST = 3  # starts that are tried at each of them
HALVINGS = 2  # of the distance to the times next to the best, afterwards
EFFORT = Effort(20, 1e-2, nearly=0.3, clear=False)  # of a search
TOLERANCE = np.repeat([0.01, np.deg2rad(1.0)], 3)  # m/s and rad/s, of the twist relative to the grapple
AIMED = 0.7  # share of it, up to which a plan is searched on for
WEIGHT = 20.0  # of a twist error of the tolerance, next to the root of eq. 20 in its unit


@dataclass(frozen=True, eq=False)
class _Found:
    """A path at a time of interception, and its twist error as a share of the tolerance."""

    time: float
    candidate: Candidate
    error: float

    @property
    def whole(self) -> float:
        """Duration of the path with its braking, s."""
        return whole(self.time)

    @property
    def rank(self) -> tuple[bool, bool, float]:
        """Smaller for better ones."""
        late, wrong = not self.candidate.keeps(self.whole), self.error > AIMED
        return late, wrong, self.error if late or wrong else self.candidate.cost(self.whole)


def whole(time: float) -> float:
    """Duration of a path that meets its goal at a time, s."""
    return time * STEPS / END


class Interceptor:
    """Plans interceptions for one robot.

    Args:
        limits: of paths. starts: gives weights (n, K) to start from for a problem at its duration.
    """

    def __init__(
        self, robot: FloatingRobot, limits: PathLimits, starts: Callable[[Reach], list[Array]]
    ) -> None:
        self._robot, self._limits, self._starts = robot, limits, starts
        self._improver = PathImprover(limits)

    def plan(self, reach: Reach) -> ReachPlan | Failure:
        """The motion from rest of a checked problem."""
        best = min(self._found(reach), key=lambda found: found.rank)
        candidate, duration = best.candidate, best.whole
        if candidate.failure is not None:
            return candidate.failure
        if not candidate.keeps(duration):
            reason = f"the motion found needs {candidate.shortest:.1f} s with braking, not {duration:.1f} s"
            return Failure(METHOD, Cause.INFEASIBLE, reason, candidate.shortest - duration)
        if best.error > 1.0:
            reason = (
                f"motions that do not rotate the base leave {best.error:.2f} times the allowed twist relative"
                f" to the grapple at {best.time:.1f} s; a window of times leaves more choice"
            )
            return Failure(METHOD, Cause.INFEASIBLE, reason, best.error)
        end, path = candidate.path.end + 1, candidate.path
        phase = np.linspace(0.0, 1.0, len(path.angle))[:end]
        rates = path.slope[:end] / duration, path.curve[:end] / duration**2
        notes = f"meets the grapple at {best.time:.2f} s, twist error {best.error:.2f} of the tolerance"
        return ReachPlan(
            METHOD, phase * duration, path.angle[:end], *rates, candidate.cost(duration), notes=notes
        )

    def _found(self, reach: Reach) -> Iterator[_Found]:
        """Paths at several times of interception, the later ones from those found before."""
        if reach.window is None:
            yield from self._from_starts(reach, reach.duration, None)
            return
        times, step = np.linspace(*reach.window, TIMES, retstep=True)
        found = [one for t in times for one in self._from_starts(reach, t, NEAREST)]
        for _ in range(HALVINGS):
            best, step = min(found, key=lambda one: one.rank), 0.5 * step
            near = [
                t for t in (best.time - step, best.time + step) if reach.window[0] <= t <= reach.window[1]
            ]
            found += [self._improved(reach, t, best.candidate.weights) for t in near]
        yield from found

    def _from_starts(self, reach: Reach, time: float, most: int | None) -> Iterator[_Found]:
        """Paths from the first starts until one of them is a plan."""
        for start in self._starts(replace(reach, duration=float(time)))[:most]:
            found = self._improved(reach, float(time), _earlier(start))
            yield found
            if found.rank[:2] == (False, False):
                break

    def _improved(self, reach: Reach, time: float, weights: Array) -> _Found:
        """The path near weights (n, K) that meets the goal at a time."""
        goal, duration = reach.goal.at(time), whole(time)
        rows = PoseRows(self._robot, goal.position, to_matrix(goal.quaternion), reach.kind)
        space = PathSpace(self._robot, reach.start, rows, END)
        objective = MatchedTwist(space, duration, goal.twist)
        candidate = self._improver.least(space, objective, weights, duration, EFFORT)
        error = space.end_twist(candidate.path)[0] / duration - goal.twist
        parts = np.linalg.norm((error / TOLERANCE).reshape(2, 3), axis=1)
        return _Found(time, candidate, float(np.nan_to_num(parts.max(), nan=np.inf)))


class MatchedTwist:
    """Least disturbance with the twist (6,) of a grapple, m/s and rad/s, in the sense of least squares."""

    def __init__(self, space: PathSpace, duration: float, twist: Array) -> None:
        self._space, self._duration, self._twist = space, duration, twist
        self._disturbance, self._scale = LeastDisturbance(space, duration), WEIGHT / TOLERANCE

    def residual(self, path: Samples) -> Array:
        """Residuals (r,) of a path."""
        found, _, _ = self._space.end_twist(path)
        wrong = self._scale * (found / self._duration - self._twist)
        return np.concatenate([self._disturbance.residual(path), wrong])

    def slopes(self, path: Samples, by: Sensitivities) -> Array:
        """Their derivatives by the weights."""
        _, by_angle, by_slope = self._space.end_twist(path)
        by_found = by_angle @ by.angle[path.end] + by_slope @ by.slope[path.end]
        by_wrong = (self._scale / self._duration)[:, None] * by_found
        return np.concatenate([self._disturbance.slopes(path, by), by_wrong])


def _earlier(weights: Array) -> Array:
    """Weights (n, K) of a path that is nearly where another one ends when it is to meet its goal."""
    phase, order = np.linspace(0.0, 1.0, 4 * FUNCTIONS), np.arange(1, FUNCTIONS + 1)
    part = END / STEPS
    faster = np.where(phase[:, None] < part, np.sin(np.pi * np.outer(phase / part, order)), 0.0) / part
    return np.linalg.lstsq(np.sin(np.pi * np.outer(phase, order)), faster @ weights.T, rcond=None)[0].T
