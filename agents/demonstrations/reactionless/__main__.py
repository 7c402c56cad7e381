"""`python -m agents.demonstrations.reactionless`: the library of motions that never rotate the base."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from agents.demonstrations.optimal.library import COUNTS, goal_counts
from agents.demonstrations.reactionless.library import generate
from agents.demonstrations.robots import add_robot_options, chosen_robot, print_use
from agents.planners.common.robot_files import robot_folder
from agents.planners.single_arm.library import REACTIONLESS
from space_envs.system.command_line import Parser, exit_status

NAME = "python -m agents.demonstrations.reactionless"


def parser() -> Parser:
    """The command line."""
    out = Parser(prog=NAME, description="Make the library of motions that never rotate the base.")
    add_robot_options(out)
    text = "folder (default: that of the robot, where the policies find its libraries)"
    out.add_argument("--output", type=Path, metavar="FOLDER", help=text)
    text = "about how many goals of the train split (default %(default)s)"
    out.add_argument("--goals", type=int, default=sum(COUNTS.values()), metavar="N", help=text)
    out.add_argument("--jobs", type=int, default=1, help="processes (default %(default)s)")
    out.add_argument("--seed", type=int, default=0, help="default %(default)s")
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    goes_on = "stopped; the same command goes on from here"
    return exit_status(NAME, lambda: run(parser().parse_args(arguments)), goes_on)


def run(options: argparse.Namespace) -> None:
    """Make the library that the options name; errors as in `generate` and `chosen_robot`."""
    robot = chosen_robot(options)
    folder = options.output or robot_folder(robot)
    counts = goal_counts(options.goals)
    made = generate(folder, robot, counts, options.seed, jobs=options.jobs, progress=True)
    cost = f"median base disturbance (eq. 20) {1e4 * np.median(made.cost):.2f} cm^2/s"
    print(f"{folder / REACTIONLESS}: {len(made.cost)} motions, {cost}")
    print_use(robot)


if __name__ == "__main__":
    sys.exit(main())
