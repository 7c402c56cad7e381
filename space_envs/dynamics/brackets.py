"""Where joint motions that do not rotate the base lead: Lie brackets of the reaction null space, batched."""

import numpy as np

from space_envs.dynamics.floating import FloatingRobot
from space_envs.dynamics.rotations import Array

_STEP = 1e-5  # rad, of central differences
_RELATIVE = 1e-9  # singular values below this share of the largest are zero


def null_space(matrix: Array, rank: int) -> Array:
    """Orthonormal basis (..., n, n - rank) of the vectors that matrices (..., m, n) of a rank map to zero."""
    _, _, right = np.linalg.svd(matrix)
    return right[..., rank:, :].swapaxes(-1, -2)


def bracket_singular_values(robot: FloatingRobot, q: Array) -> Array:
    """Singular values (..., r), rad^-1, of the brackets of the reaction null space at q (..., n) rad.

    A loop along null vectors a, b, -a, -b of length e ends e^2 [a, b] from where it began. The part of a
    bracket that leaves the null space is, with W from joint rates to the base's angular velocity,

        W [a, b] = -sum_jk (d_j W_k - d_k W_j) a_j b_k,

    since W a = W b = 0 along the fields. The values are those of W+ W [a, b] over all pairs of an orthonormal
    basis: r = min(rank of W, number of pairs) of them. If the last one is positive, null-space motions reach
    every direction of joint space that they do not have themselves (Chow's theorem).
    """
    q = np.asarray(q, dtype=float)
    n = robot.n_joints
    by_q = np.stack(
        [
            (_angular(robot, q + step) - _angular(robot, q - step)) / (2.0 * _STEP)
            for step in _STEP * np.eye(n)
        ],
        axis=-1,
    )  # (..., 3, n, n): of column k by angle j
    angular = _angular(robot, q)
    values = np.linalg.svd(angular, compute_uv=False)
    rank = int((values > _RELATIVE * values[..., :1]).sum(axis=-1).min())
    basis = null_space(angular, rank)
    curl = by_q - by_q.swapaxes(-1, -2)  # [k, j] = d_j W_k - d_k W_j
    first, second = np.triu_indices(n - rank, 1)
    turned = np.einsum("...ikj,...jp,...kp->...ip", curl, basis[..., first], basis[..., second])
    leaving = -np.linalg.pinv(angular) @ turned
    return np.linalg.svd(leaving, compute_uv=False)[..., : min(rank, len(first))]


def _angular(robot: FloatingRobot, q: Array) -> Array:
    return robot.base_map(q)[..., 3:, :]
