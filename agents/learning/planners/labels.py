"""Labels of training goals: plans of a network after a Gauss-Newton step, for each kind of plans."""

import numpy as np
from numpy.typing import NDArray

from agents.learning.planners.self_labelled import Labels
from agents.learning.runs.hyperparameters import Planner
from agents.planners.single_arm.amortised.motions import MotionBatch, Problems
from agents.planners.single_arm.amortised.path_steps import PathLoss
from agents.planners.single_arm.amortised.paths import PathBatch
from agents.planners.single_arm.amortised.planner import BASIS
from agents.planners.single_arm.amortised.steps import MotionLoss, Penalties
from agents.planners.single_arm.reactionless.planner import random_starts
from agents.policies.learned.planner_network import problems_at
from agents.policies.single_arm.optimal import drive_limits
from space_envs.dynamics.rotations import Array
from space_envs.policy import PolicyContext

SPREAD = 0.03  # standard deviation of the coordinates that all plans start from: at zero there is no way out
ANGLE_SHARE = 0.98  # of half the joints' ranges
CHUNK = 64  # paths whose derivatives are in memory at once
STARTS, SOLVED = 48, 40  # random starts, and steps of each to a goal of its own
RATED, GOALS, TRIED = 20, 60, 15  # of the best results, goals that each is rated by, and steps to these
LONGEST = 3.0  # rad, of steps while starts are rated
WORST = 0.05  # m^2/s, of a loss that counts in the rating


def penalties_of(parameters: Planner) -> Penalties:
    """Weights of the loss that a run trains with."""
    return Penalties(
        parameters.position_weight,
        parameters.rotation_weight,
        parameters.attitude_weight,
        parameters.limit_weight,
        (ANGLE_SHARE, parameters.rate_share, parameters.acceleration_share),
    )


class KeptLabels:
    """Labels of motions in weight space that end with the initial attitude.

    Args:
        context: of the task. observations: (G, size) at the start of the training episodes. features: (G, F).
        duration: of motions, s.
    """

    longest_step = 1.0

    def __init__(
        self,
        context: PolicyContext,
        observations: Array,
        features: NDArray[np.float32],
        parameters: Planner,
        duration: float,
    ) -> None:
        self.features, self._context, self._damping = features, context, parameters.damping
        self._problems = problems_at(context, observations, duration)
        penalties = penalties_of(parameters)
        self._objective = MotionLoss(drive_limits(context), context.arm.n_joints, penalties)
        self._scale = np.sqrt(penalties.of_errors)[:, None]
        self.outputs = self.batch(self._problems.rows(np.arange(1))).size

    def batch(self, problems: Problems) -> MotionBatch:
        """Motions of problems."""
        return MotionBatch(self._context.arm, BASIS, problems, self._context.c)

    def __call__(self, rows: NDArray[np.int64], output: Array) -> Labels:
        """Labels of the goals in rows (S,), at the network's outputs (S, n m)."""
        batch = self.batch(self._problems.rows(rows))
        y = output.reshape(len(rows), batch.joints, batch.free)
        at = batch.linearised(y)
        better = y + self._objective.step(batch, y, at, self._damping)
        return Labels(better.reshape(output.shape), at.error_by * self._scale)

    def start(self, rng: np.random.Generator) -> Array:
        """Coordinates (n m,) at which all plans start."""
        return SPREAD * rng.standard_normal(self.outputs)


class ReactionlessLabels:
    """Labels of paths in the reaction null space; arguments as of `KeptLabels`."""

    longest_step = 2.0

    def __init__(
        self,
        context: PolicyContext,
        observations: Array,
        features: NDArray[np.float32],
        parameters: Planner,
        duration: float,
    ) -> None:
        self.features, self._context, self._damping = features, context, parameters.damping
        self._problems = problems_at(context, observations, duration)
        penalties = penalties_of(parameters)
        self._loss = PathLoss(drive_limits(context), context.arm.n_joints, penalties)
        self._scale = np.sqrt(penalties.of_errors[:6])[:, None]
        self.outputs = PathBatch(context.arm, self._problems.rows(np.arange(1))).size

    def __call__(self, rows: NDArray[np.int64], output: Array) -> Labels:
        """Labels of the goals in rows (S,), at the network's outputs (S, m)."""
        better, error_by = np.empty_like(output), np.empty((len(rows), 6, self.outputs))
        for first in range(0, len(rows), CHUNK):
            some = slice(first, first + CHUNK)
            at = PathBatch(self._context.arm, self._problems.rows(rows[some])).linearised(output[some])
            better[some] = output[some] + self._loss.step(at, output[some], self._damping)
            error_by[some] = at.error_by * self._scale
        return Labels(better, error_by)

    def start(self, rng: np.random.Generator) -> Array:
        """Weights (m,) at which all plans start: a solution of one goal from which others are near.

        At zero weights there is no way out, and paths from different random starts cost differently.
        """
        own = rng.integers(len(self.features), size=STARTS)
        starts = np.stack([w.T.ravel() for w in random_starts(rng, self._context.arm.n_joints, STARTS)])
        solved, loss = self._solved(own, starts, SOLVED)
        shared = rng.integers(len(self.features), size=GOALS)
        ratings = {}
        for number in np.argsort(loss)[:RATED]:
            _, found = self._solved(shared, np.tile(solved[number], (len(shared), 1)), TRIED)
            ratings[number] = np.minimum(found, WORST).mean()
        return solved[min(ratings, key=lambda number: ratings[number])]

    def _solved(self, rows: NDArray[np.int64], weights: Array, steps: int) -> tuple[Array, Array]:
        """Weights after steps of Gauss and Newton, and their losses (S,)."""
        batch = PathBatch(self._context.arm, self._problems.rows(rows))
        for _ in range(steps):
            step = self._loss.step(batch.linearised(weights), weights, self._damping)
            length = np.linalg.norm(step, axis=1, keepdims=True)
            weights = weights + step * np.minimum(1.0, LONGEST / np.maximum(length, 1e-12))
        return weights, self._loss.value(batch.linearised(weights), weights)
