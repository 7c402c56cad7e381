"""Figures of all robots of the zoo, as the check of a robot measures them, and what looks implausible."""

import sys

import numpy as np
from tqdm import tqdm

from benchmarks.machine import markdown_table
from space_envs.robots.check.figures.robot_figures import RobotFigures, robot_figures
from space_envs.robots.check.implausible import implausible
from space_envs.robots.zoo import find_robot, robot_names
from space_envs.system.command_line import Parser, exit_status

HEAD = (
    *(
        "robot",
        "satellite, kg",
        "joints",
        "arms, kg",
        "reach from the centre of mass, m",
        "smallest singular value, home",
        "5 %",
    ),
    *("reaction null space", "attitude, joint_velocity, deg", "reactionless, deg", "time step, ms"),
    *("momentum drift", "rate error", "implausible"),
)


def cells(name: str, figures: RobotFigures) -> list[str]:
    """Cells of a robot's row."""
    masses, found, attitude = figures.masses, figures.conditioning, figures.attitude
    findings = sorted({finding.rule for finding in implausible(figures)})
    return [
        name,
        f"{masses.satellite:.4g}",
        str(figures.robot.n_joints),
        f"{masses.arms:.4g}",
        ", ".join(f"{reach:.2f}" for reach in masses.reach),
        f"{found.smallest.home:.3f}",
        f"{found.smallest.low:.3f}",
        f"{found.null_space} of {figures.robot.n_joints}",
        f"{np.rad2deg(attitude.joint_velocity):.1f}",
        f"{np.rad2deg(attitude.reactionless):.2g}",
        f"{1e3 * figures.robot.steps.default_timestep:g}",
        f"{figures.drift:.0e}",
        f"{figures.tracking.rate:.0e}",
        ", ".join(findings) or "-",
    ]


def main() -> None:
    """Measure all robots and print the table."""
    parser = Parser(prog="python -m benchmarks.robot_figures", description=__doc__)
    parser.add_argument(
        "--robots", nargs="+", default=list(robot_names()), metavar="NAME", help="default: all"
    )
    options = parser.parse_args()
    names = tqdm(options.robots, unit="robot", leave=False)
    print(markdown_table(list(HEAD), [cells(name, robot_figures(find_robot(name))) for name in names]))


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.robot_figures", main))
