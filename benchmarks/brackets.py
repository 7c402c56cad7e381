"""Whether joint motions that do not rotate the satellite lead everywhere: growth of their distribution."""

import sys

import numpy as np

from benchmarks.arguments import seed, whole
from benchmarks.machine import markdown_table
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.robots.models import robot_mechanics
from space_envs.robots.robot import Robot
from space_envs.robots.zoo import find_robot, robot_names
from space_envs.system.command_line import Parser, exit_status

SMALLEST = 1e-8  # rad^-1, of a bracket that counts: differences are accurate to about 1e-9
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


def row(robot: Robot, configurations: int, rng: np.random.Generator) -> list[str]:
    """Cells of the table for one robot."""
    mechanics, rank = robot_mechanics(robot), 1 if robot.planar else 3
    low, high = np.maximum(robot.joint_range[:, 0], -np.pi), np.minimum(robot.joint_range[:, 1], np.pi)
    angles = rng.uniform(low, high, (configurations, robot.n_joints))
    home, drawn = (bracket_singular_values(mechanics, q) for q in (mechanics.home, angles))
    n, free = robot.n_joints, robot.n_joints - rank
    grown = free + int((drawn.min(axis=0) > SMALLEST).sum())
    return [
        robot.name,
        str(n),
        f"({free}, {grown})",
        *(f"{v.min():.2g}" for v in (home, drawn)),
        f"{np.median(drawn[:, -1]):.2g}",
    ]


def main() -> None:
    """Print the table."""
    parser = Parser(prog="python -m benchmarks.brackets", description=__doc__)
    parser.add_argument(
        "--robot", nargs="+", default=robot_names(), help="names or files (default: built in)"
    )
    parser.add_argument(
        "--configurations", type=whole, default=1000, help="drawn for each robot (default %(default)s)"
    )
    parser.add_argument("--seed", type=seed, default=0, help="of the configurations (default %(default)s)")
    options = parser.parse_args()
    rng = np.random.default_rng(options.seed)
    table = [row(find_robot(name), options.configurations, rng) for name in options.robot]
    head = ["robot", "joints", "growth", "smallest bracket at home, 1/rad", "least", "median"]
    print(markdown_table(head, table))
    print(
        f"\nGrowth: dimension of the null space, and with its first brackets. Least and median are over "
        f"{options.configurations:,} configurations drawn evenly from the joint ranges, at most one turn, "
        f"seed {options.seed}."
    )


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.brackets", main))
