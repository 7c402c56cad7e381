"""Conditioning of a robot's generalised Jacobian and its reaction null space, at home and at random."""

from dataclasses import dataclass

import numpy as np

from space_envs.drives import STOP_MARGIN
from space_envs.dynamics.rotations import Array
from space_envs.robots.models.mechanics import robot_mechanics
from space_envs.robots.robot import Robot

QUANTILES = (0.05, 0.5, 0.95)
CONFIGURATIONS = 1000
_PLANE = [0, 1, 5]  # components of a twist in the plane
_RANK = 1e-6  # of the largest singular value; smaller ones are zero


@dataclass(frozen=True)
class Spread:
    """A figure at home, and its quantiles 5 %, 50 % and 95 % over random configurations."""

    home: float
    low: float
    median: float
    high: float


@dataclass(frozen=True)
class ConditioningFigures:
    """Conditioning of the maps from joint rates, over random configurations.

    The generalised Jacobian maps them to the twists of all end-effectors, lengths in units of the reach.

    Attributes:
        smallest: singular value of the generalised Jacobian. condition: its condition number.
        rank: of it at home. commanded: its number of rows.
        disturbance: largest singular value of the map to the angular velocity of the satellite.
        null_space: dimension of the reaction null space at home. null_spaces: least and largest at random.
    """

    smallest: Spread
    condition: Spread
    rank: int
    commanded: int
    disturbance: Spread
    null_space: int
    null_spaces: tuple[int, int]


def random_configurations(robot: Robot, count: int = CONFIGURATIONS, seed: int = 0) -> Array:
    """Joint angles (count, n), uniform within the ranges that the drives allow, rad."""
    ends = robot.joint_range
    margin = np.minimum(STOP_MARGIN, 0.4 * (ends[:, 1] - ends[:, 0]))
    return np.random.default_rng(seed).uniform(
        ends[:, 0] + margin, ends[:, 1] - margin, (count, robot.n_joints)
    )


def conditioning(robot: Robot) -> ConditioningFigures:
    """Conditioning of a robot."""
    q = np.concatenate([robot.home[None], random_configurations(robot)])
    jacobian = scaled_jacobian(robot, q)
    values = np.linalg.svd(jacobian, compute_uv=False)
    rotation = np.linalg.svd(robot_mechanics(robot).base_map(q)[:, 3:], compute_uv=False)
    free = robot.n_joints - (rotation > _RANK * rotation[:, :1]).sum(axis=1)
    return ConditioningFigures(
        _spread(values[:, -1]),
        _spread(values[:, 0] / np.maximum(values[:, -1], 1e-12)),
        int((values[0] > _RANK * values[0, 0]).sum()),
        jacobian.shape[1],
        _spread(rotation[:, 0]),
        int(free[0]),
        (int(free[1:].min()), int(free[1:].max())),
    )


def scaled_jacobian(robot: Robot, q: Array) -> Array:
    """Generalised Jacobian (..., m, n) of all end-effectors, lengths in units of the longest reach."""
    tree, arms = robot_mechanics(robot), range(len(robot.arms))
    scale = np.repeat([1.0 / max(tree.reach(arm) for arm in arms), 1.0], 3)[:, None]
    parts = [scale * tree.generalized_jacobian(q, arm) for arm in arms]
    rows = _PLANE if robot.planar else list(range(6))
    return np.concatenate([part[..., rows, :] for part in parts], axis=-2)


def _spread(values: Array) -> Spread:
    """Spread of values (1 + K,), the first of them at home."""
    return Spread(float(values[0]), *np.quantile(values[1:], QUANTILES).tolist())
