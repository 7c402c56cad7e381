"""Whether joint motions that do not rotate the satellite lead everywhere: growth of their distribution."""

import sys

import numpy as np

from benchmarks.arguments import seed, whole
from benchmarks.machine import markdown_table
from space_envs.dynamics.brackets import bracket_singular_values
from space_envs.robots.models import robot_mechanics
from space_envs.robots.robot import Robot
from space_envs.robots.zoo import find_robot, robot_names
from space_envs.system.command_line import Parser, exit_status

SMALLEST = 1e-8  # rad^-1, of a bracket that counts: differences are accurate to about 1e-9


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
    parser.add_argument("--configurations", type=whole, default=1000, help="default %(default)s")
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
