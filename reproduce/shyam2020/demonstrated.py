"""The demonstrations of sec. IV, made with both kinds of elastic bands, and the workspace that they cover."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from agents.demonstrations.controller import Demonstrations, demonstrate
from agents.demonstrations.elastic_bands import end_effector_path
from agents.demonstrations.storage import COUNT
from agents.demonstrations.variations import BANDS, KINDS, DemonstratorConfig
from reproduce.shyam2020.cases import DIFFICULTY, context
from space_envs.dynamics import roll_out_base
from space_envs.dynamics.rotations import Array, rotate
from space_envs.tasks.single_arm import SPLIT_SIZE, SingleArmTask

QUICK = 60  # demonstrations of a quick run
PAPER = "task"  # bands of the paper; the shipped prior has the others


@dataclass(frozen=True, eq=False)
class DemonstratedWorkspace:
    """D demonstrations with each kind of elastic bands, and the goals of the test split.

    Attributes:
        made: by bands, task and joint. end_effector: (D, T, 3) m, inertial frame, likewise.
        goals: (K, 3) m, of the test split.
    """

    made: Mapping[str, Demonstrations]
    end_effector: Mapping[str, Array]
    goals: Array

    def rows(self, name: str) -> tuple[str, NDArray[np.int64]]:
        """Bands, and the rows of their demonstrations, of a variation: a kind, or bands by name."""
        bands = name if name in BANDS else PAPER
        kind = "elastic_band" if name in BANDS else name
        return bands, np.flatnonzero(self.made[bands].kind == KINDS.index(kind))


def cover(seed: int, count: int = COUNT) -> DemonstratedWorkspace:
    """Make demonstrations as the shipped prior's were, with both kinds of elastic bands.

    Raises:
        PlanningError: if one cannot be drawn.
    """
    robot, arm = context().robot, context().arm
    configs = {bands: replace(DemonstratorConfig(), bands=bands) for bands in BANDS}
    made = {bands: demonstrate(robot, config, seed, 0, count) for bands, config in configs.items()}
    paths = {}
    for bands, each in made.items():
        base, attitude = roll_out_base(arm, each.position, each.velocity, float(each.time[1]))
        paths[bands] = base + rotate(attitude, end_effector_path(arm, each.position))
    goals = SingleArmTask(difficulty=DIFFICULTY).goals("test", np.arange(SPLIT_SIZE["test"])).position
    return DemonstratedWorkspace(made, paths, goals)


def distance_to_demonstrated(found: DemonstratedWorkspace) -> Array:
    """Distances (K,) m of test goals from the nearest end of a demonstration with the paper's variations."""
    return KDTree(found.end_effector[PAPER][:, -1]).query(found.goals)[0]


def bends(made: Demonstrations) -> Array:
    """Largest distances (D,) m of the end-effector from its path along the straight joint motion."""
    arm = context().arm
    whole = made.position[:, -1:] - made.position[:, :1]
    along = ((made.position - made.position[:, :1]) * whole).sum(axis=2) / (whole * whole).sum(axis=2)
    straight = made.position[:, :1] + along[..., None] * whole
    apart = end_effector_path(arm, made.position) - end_effector_path(arm, straight)
    return np.linalg.norm(apart, axis=2).max(axis=1)
