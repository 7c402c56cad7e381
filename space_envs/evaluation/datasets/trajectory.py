"""Trajectories: single episodes of a dataset, as views of a rollout."""

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.evaluation.play.rollout import Rollout


@dataclass(frozen=True, eq=False)
class Trajectory:
    """One episode of T steps.

    Attributes:
        episode: its number in what was asked for. index: of its goal in the split. seed: of its `reset`.
        outcome: how it ended.
        observations: (T + 1, size), the first from `reset`. actions: (T, m) float32 in [-1, 1].
        rewards: (T,). terminations, truncations: (T,) bool, true in the last step at most: one of the
            two, or both where a capture comes at the horizon.
    """

    episode: int
    index: int
    seed: int
    outcome: str
    observations: Array
    actions: NDArray[np.float32]
    rewards: Array
    terminations: NDArray[np.bool_]
    truncations: NDArray[np.bool_]

    @property
    def captured(self) -> bool:
        """Whether it ended with a capture."""
        return self.outcome == "captured"


def trajectory_of(rollout: Rollout, row: int) -> Trajectory:
    """Trajectory of an episode that was played with actions of 32 bits."""
    end = int(rollout.length[row])
    last = np.arange(1, end + 1) == end
    return Trajectory(
        episode=int(rollout.episode[row]),
        index=int(rollout.index[row]),
        seed=int(rollout.seed[row] + rollout.episode[row]),
        outcome=str(rollout.outcome[row]),
        observations=rollout.observation[row, : end + 1],
        actions=rollout.action[row, :end].astype(np.float32),
        rewards=rollout.reward[row, :end],
        terminations=last & (rollout.outcome[row] != "timeout"),
        truncations=last & (end == rollout.reward.shape[1]),
    )


def first_difference(one: Trajectory, other: Trajectory) -> str | None:
    """First difference of another trajectory from one, in any bit, in words; None if there is none."""
    values = {item.name: (getattr(one, item.name), getattr(other, item.name)) for item in fields(Trajectory)}
    arrays = {name: pair for name, pair in values.items() if isinstance(pair[0], np.ndarray)}
    for name, (was, found) in arrays.items():
        shared = min(len(was), len(found))
        differ = (was[:shared] != found[:shared]).reshape(shared, -1).any(axis=1)
        if differ.any():
            change = np.abs(found[:shared].astype(np.float64) - was[:shared].astype(np.float64)).max()
            return f"{name} differ from row {int(differ.argmax())} on, by up to {change:.3g}"
    for name, (was, found) in values.items():
        if name in arrays and len(was) != len(found):
            return f"there are {len(found)} {name}, there were {len(was)}"
        if name not in arrays and was != found:
            return f"{name} is {found}, was {was}"
    return None
