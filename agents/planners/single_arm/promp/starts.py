"""Solutions from several initial guesses, of which those that approach the goal go on first."""

from collections.abc import Sequence

import numpy as np

from agents.planners.single_arm.weights.bounds import Bounds
from agents.planners.single_arm.weights.sqp import (
    GOAL_TOLERANCE,
    ITERATIONS,
    Descent,
    Ending,
    Rows,
    SqpResult,
    minimise,
)
from agents.planners.single_arm.weights.weight_space import WeightSpace
from space_envs.dynamics.rotations import Array

VIOLATION_TOLERANCE = 1e-2  # fraction of a torque, or m, of a solution in sum over the motion
TRIAL = 6  # iterations after which a motion far from the goal waits for the others
# m or rad, of the error then, above which it waits: on validation goals nine of ten motions that led
# to the goal were nearer, and nine of ten others were not.
HOPEFUL = 0.06
RESUMED = 4  # motions that go on where none of the others leads to the goal
RACE = 4  # iterations after which motions without limits are compared
RACE_PENALTY = 3e-3  # m^2/s per m or rad, of the terminal errors that are left then

Problem = tuple[WeightSpace, Bounds, tuple[Rows, ...]]
"""Motions, bounds on them and nonlinear inequalities."""


class Starts:
    """Solutions of one problem from one initial guess after the other.

    Args:
        problem: whose solutions are sought. keep_attitude: whether the final attitude is constrained.
        in_stages: whether motions that are still far from the goal after a few iterations wait, and nonlinear
            inequalities are imposed after the goal has been reached without them.

    Attributes:
        found: ends of the iterations from all guesses that do not wait.
    """

    def __init__(self, problem: Problem, keep_attitude: bool, in_stages: bool) -> None:
        self._problem, self._keep_attitude, self._in_stages = problem, keep_attitude, in_stages
        self._waiting: list[tuple[float, int, Descent]] = []
        self.found: list[SqpResult] = []

    @property
    def best(self) -> SqpResult | None:
        """Solution of least cost, if any."""
        return best_solution(self.found)

    @property
    def ends(self) -> list[SqpResult]:
        """Last iterates of all guesses, also of those that wait, nearest to the goal first."""
        waiting = [descent.run(TRIAL) for _, _, descent in self._waiting]
        return sorted([*self.found, *waiting], key=lambda end: end.goal_error)

    def add(self, guess: Array) -> None:
        """Improve coordinates (n, m), or let them wait."""
        space, bounds, rows = self._problem
        descent = Descent(space, bounds, guess, self._keep_attitude, () if self._in_stages else rows)
        if self._in_stages:
            end = descent.run(TRIAL)
            if end.ending is Ending.ITERATIONS and end.goal_error > HOPEFUL:
                self._waiting.append((end.goal_error, len(self._waiting), descent))
                return
        self._finish(descent)

    def resume(self) -> None:
        """Go on with those that wait, nearest to the goal first, until one leads there."""
        self._waiting.sort()
        for _ in range(RESUMED):
            if not self._waiting or self.best is not None:
                return
            self._finish(self._waiting.pop(0)[2])

    def _finish(self, descent: Descent) -> None:
        space, bounds, rows = self._problem
        end = descent.run(ITERATIONS)
        if self._in_stages and end.goal_error < GOAL_TOLERANCE:
            if sum(row.violation(end.y) for row in rows) > 0.0:
                end = minimise(space, bounds, end.y, self._keep_attitude, rows)
        self.found.append(end)


def raced(problem: Problem, guesses: Array, keep_attitude: bool) -> Array:
    """Coordinates (S, n, m) after a few iterations, the most promising first.

    Without limits motions run so far from their initial guesses that predictions of one step mislead.
    """
    space, bounds, _ = problem
    ends = [minimise(space, bounds, guess, keep_attitude, iterations=RACE) for guess in guesses]
    ends.sort(key=lambda end: end.cost + RACE_PENALTY * end.goal_error)
    return np.stack([end.y for end in ends])


def best_solution(found: Sequence[SqpResult]) -> SqpResult | None:
    """Solution of least cost that reaches its goal."""
    usable = [
        one for one in found if one.goal_error < 10.0 * GOAL_TOLERANCE and one.violation < VIOLATION_TOLERANCE
    ]
    return min(usable, key=lambda solution: solution.cost, default=None)
