"""`python -m agents.demonstrations.optimal`: the libraries of optimal motions that planners start from."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from agents.demonstrations.optimal.library import COUNTS, LibraryRecipe, generate, goal_counts
from agents.demonstrations.robots import add_robot_options, chosen_robot, print_use
from agents.planners.common.robot_files import robot_folder
from space_envs.system.command_line import AppendValues, Parser, exit_status

ATTITUDES = ("unconstrained", "constrained")  # final base attitudes


def parser() -> Parser:
    """The command line."""
    out = Parser(
        prog="python -m agents.demonstrations.optimal", description="Make the libraries of optimal motions."
    )
    add_robot_options(out)
    text = "folder (default: that of the robot, where the policies find its libraries)"
    out.add_argument("--output", type=Path, metavar="FOLDER", help=text)
    text = "about how many goals of the train split (default %(default)s)"
    out.add_argument("--goals", type=int, default=sum(COUNTS.values()), metavar="N", help=text)
    out.add_argument("--jobs", type=int, default=1, help="processes (default %(default)s)")
    out.add_argument("--seed", type=int, default=0, help="default %(default)s")
    out.add_argument(
        "--attitude",
        choices=ATTITUDES,
        action=AppendValues,
        nargs="+",
        default=list(ATTITUDES),
        help="at the end: unconstrained, or constrained to the initial one (default both)",
    )
    out.add_argument(
        "--limits",
        choices=("limited", "wide"),
        action=AppendValues,
        nargs="+",
        default=["limited", "wide"],
        help="the robot's limits, or none (default both)",
    )
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    goes_on = "stopped; the same command goes on from here"
    name = "python -m agents.demonstrations.optimal"
    return exit_status(name, lambda: run(parser().parse_args(arguments)), goes_on)


def run(options: argparse.Namespace) -> None:
    """Make the libraries that the options name; errors as in `generate` and `chosen_robot`."""
    robot, counts = chosen_robot(options), goal_counts(options.goals)
    folder = options.output or robot_folder(robot)
    for limits in options.limits:
        for attitude in options.attitude:
            recipe = LibraryRecipe(robot, attitude == "constrained", limits == "limited", options.seed)
            made = generate(folder, recipe, counts, jobs=options.jobs, progress=True)
            cost = f"median base disturbance (eq. 20) {1e4 * np.median(made.cost):.2f} cm^2/s"
            print(f"{folder / recipe.name}: {len(made.cost)} motions, {cost}")
    print_use(robot)


if __name__ == "__main__":
    sys.exit(main())
