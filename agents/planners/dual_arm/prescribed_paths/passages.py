"""Motions along prescribed paths past singularities and within joint limits, by a search over zeta.

Where zeta = 0 leads into a singularity, another zeta before it may lead past. A bundle of motions is
integrated side by side: at each step every motion goes on with the slowest joints and with some random zeta;
those that become too fast or leave the joint limits end, and of the others the cheap ones go on and some of
the rest, no two near each other. Where all end no zeta leads on, as far as the bundle is dense.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.plans import Limits
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.problem import Capture
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.reactionless import end_effectors
from space_envs.dynamics.rotations import Array

MOTIONS = 256  # in the bundle
BRANCHES = 6  # of each motion at each step, of which one has the slowest joints
STEPS = 80
FASTEST = 1.0  # rad/s, of a joint; a motion that needs more is near a singularity
SIZES = (1e-3, 0.5)  # rad/s, least and greatest scale of random zeta
CELL = 0.06  # rad, side of the cells of which each keeps its cheapest motion
CHEAP = 4  # one motion in so many is kept for its cost, the others are drawn
CORRECTION = 0.5  # 1/s, of the end-effectors' distance from their paths


@dataclass(frozen=True, eq=False)
class _Bundle:
    """Motions at one time: joint angles (K, n) rad, integrals (K,) of the squared rates, and the numbers (K,)
    of the motions before that they continue."""

    angles: Array
    cost: Array
    parents: NDArray[np.int64]


def passages(
    robot: FloatingRobot, path: PolynomialPath, capture: Capture, limits: Limits, most: int
) -> list[Array]:
    """Joint angles (STEPS + 1, n) rad at equal times of at most `most` motions, cheap ones first.

    Of each of them the path is followed to about a millimetre; always the same ones.
    """
    rng, h = np.random.default_rng(0), capture.duration / STEPS
    bundles = [_Bundle(capture.start[None], np.zeros(1), np.zeros(1, dtype=np.int64))]
    for step in range(STEPS):
        following = _continued(robot, path, limits, bundles[-1], step * h, h, rng)
        if not len(following.cost):
            return []
        bundles.append(following)
    return [_traced(bundles, int(k)) for k in _apart(bundles[-1], most)]


def _continued(
    robot: FloatingRobot,
    path: PolynomialPath,
    limits: Limits,
    before: _Bundle,
    time: float,
    h: float,
    rng: np.random.Generator,
) -> _Bundle:
    """The bundle after a step of the midpoint rule."""
    branches = max(BRANCHES, MOTIONS // (4 * len(before.cost)))
    parents = np.repeat(np.arange(len(before.cost)), branches)
    low, high = np.log(SIZES)
    size = np.exp(rng.uniform(low, high, len(parents)))
    zeta = size[:, None] * rng.normal(size=(len(parents), robot.n_joints))
    zeta[::branches] = 0.0
    q = before.angles[parents]
    first = _rates(robot, path, q, time, zeta)
    rate = _rates(robot, path, q + 0.5 * h * first, time + 0.5 * h, zeta)
    q = q + h * rate
    fastest = np.maximum(np.abs(first), np.abs(rate)).max(axis=1)
    going = np.flatnonzero((fastest < FASTEST) & (limits.beyond_angles(q).max(axis=1) < 0.0))
    cost = before.cost[parents] + h * (rate * rate).sum(axis=1)
    kept = going[np.argsort(cost[going], kind="stable")]
    _, own = np.unique(np.round(q[kept] / CELL).astype(np.int64), axis=0, return_index=True)
    own.sort()
    if len(own) > MOTIONS:
        cheap = MOTIONS // CHEAP
        own = np.append(own[:cheap], rng.choice(own[cheap:], MOTIONS - cheap, replace=False))
    kept = kept[own]
    return _Bundle(q[kept], cost[kept], parents[kept])


def _rates(robot: FloatingRobot, path: PolynomialPath, q: Array, time: float, zeta: Array) -> Array:
    """Reactionless joint rates (K, n), rad/s, along the path.

    Args:
        q: (K, n) rad. zeta: (K, n) rad/s, of which the part in the null space has an effect.
    """
    kinematics = robot.kinematics(q)
    now, d = end_effectors(robot, q, kinematics), path.start.size // 2
    place = (now.position - robot.centre_of_mass(kinematics)[:, None])[..., :d].reshape(len(q), -1)
    turning = now.base_angular if d == 3 else now.base_angular[:, 2:]
    rows = np.concatenate([now.linear[..., :d, :].reshape(len(q), 2 * d, -1), turning], axis=1)
    velocity = np.zeros((len(q), rows.shape[1]))
    velocity[:, : 2 * d] = path.velocity(time) + CORRECTION * (path.position(time) - place)
    missing = velocity - (rows @ zeta[..., None])[..., 0]
    left, size, right = np.linalg.svd(rows, full_matrices=False)
    along = (left.swapaxes(-1, -2) @ missing[..., None])[..., 0] / np.maximum(size, 1e-12)
    return zeta + (right.swapaxes(-1, -2) @ along[..., None])[..., 0]


def _apart(bundle: _Bundle, most: int) -> list[int]:
    """Numbers of the cheapest motion and of those that end farthest from the ones before."""
    chosen = [int(bundle.cost.argmin())]
    distance = np.linalg.norm(bundle.angles - bundle.angles[chosen[0]], axis=1)
    while len(chosen) < min(most, len(bundle.cost)):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(bundle.angles - bundle.angles[chosen[-1]], axis=1))
    return chosen


def _traced(bundles: list[_Bundle], number: int) -> Array:
    """Joint angles of one motion at all times."""
    angles = []
    for bundle in reversed(bundles):
        angles.append(bundle.angles[number])
        number = int(bundle.parents[number])
    return np.array(angles[::-1])
