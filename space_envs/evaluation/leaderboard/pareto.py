"""Pareto front of the kept-attitude score and the waiting time."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from space_envs.errors import ConfigurationError
from space_envs.evaluation.leaderboard.comparison import check_one_task
from space_envs.evaluation.leaderboard.figures import HEADLINE
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.play.entry import LeaderboardEntry

FRONT = (
    "A policy is on the Pareto front where no other has at least its kept-attitude score and takes at most as"
    " long from the goal to the first action, and is better in one of the two. hold, random and policies "
    "without a capture are never on it."
)


@dataclass(frozen=True)
class Standing:
    """Kept-attitude score and waiting time of a policy, and the policies that dominate it."""

    entry: LeaderboardEntry
    score: float  # 0..1
    success: float  # 0..1
    wait: float  # ms from goal to first action: planning and one action; +infinity where nothing was timed
    competes: bool  # as `Row.competes`
    dominated_by: tuple[LeaderboardEntry, ...]  # those of what competes

    @property
    def on_front(self) -> bool:
        """Whether it is on the Pareto front, as FRONT says in words."""
        return self.competes and not self.dominated_by


def dominance(costs: np.ndarray) -> np.ndarray:
    """Dominance bool (n, n) among n points of k costs (n, k), which may be +infinity.

    [i, j] is True where i is nowhere worse than j and somewhere better; equal points do not dominate each
    other.
    """
    costs = np.asarray(costs, dtype=np.float64)
    if costs.ndim != 2 or np.isnan(costs).any():
        raise ConfigurationError(f"expected costs (n, k) without NaN, got {costs.shape}")
    one, other = costs[:, None], costs[None]
    return np.logical_and((one <= other).all(axis=-1), (one < other).any(axis=-1))


def pareto_front(rows: Sequence[Row]) -> list[Standing]:
    """Kept-attitude score (more is better) and waiting time (less is better) of the rows of one task.

    In the order of the rows; FRONT says in words who is on the front. A policy that makes no plan waits for
    its action alone.
    """
    check_one_task([row.entry for row in rows])
    score = np.array([row.figures[HEADLINE].value for row in rows])
    times = [[value for value in row.timing.values() if not math.isnan(value)] for row in rows]
    wait = np.array([sum(known) if known else math.inf for known in times])
    competes = np.array([row.competes for row in rows], dtype=bool)
    better = dominance(np.stack([-score, wait], axis=1)) & competes[:, None]
    return [
        Standing(
            row.entry,
            float(score[number]),
            row.figures["success"].value,
            float(wait[number]),
            row.competes,
            tuple(other.entry for other, above in zip(rows, better[:, number], strict=True) if above),
        )
        for number, row in enumerate(rows)
    ]
