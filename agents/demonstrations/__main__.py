"""`python -m agents.demonstrations`: demonstrations of the paper's controller, and the prior from them."""

import argparse
import sys
from collections.abc import Sequence

from agents.demonstrations.prior import fit_prior, save_prior
from agents.demonstrations.robots import add_robot_options, chosen_robot, print_use
from agents.demonstrations.storage import COUNT, generate, provenance
from agents.demonstrations.variations import BANDS, DemonstratorConfig
from agents.planners.common.robot_files import robot_folder
from agents.policies.single_arm.promp import PRIOR
from space_envs.system.command_line import Parser, check_replaceable, exit_status, output_path
from space_envs.system.output import held
from space_envs.tasks.common import DIFFICULTIES


def parser() -> Parser:
    """The command line."""
    out = Parser(
        prog="python -m agents.demonstrations",
        description="Make demonstrations and learn a ProMP prior from them.",
    )
    add_robot_options(out)
    out.add_argument("--count", type=int, default=COUNT, help="how many (default %(default)s)")
    text = "folder of the demonstrations (default: in that of the robot, where the policies find the prior)"
    out.add_argument("--output", type=output_path, metavar="FOLDER", help=text)
    out.add_argument("--jobs", type=int, default=1, help="processes (default %(default)s)")
    out.add_argument("--seed", type=int, default=0, help="default %(default)s")
    out.add_argument("--difficulty", choices=DIFFICULTIES, default="medium", help="of the goals")
    text = "space of the elastic bands' obstacles: the paper's is task; the shipped prior has %(default)s"
    out.add_argument("--bands", choices=BANDS, default=DemonstratorConfig().bands, help=text)
    out.add_argument(
        "--resume",
        action=argparse.BooleanOptionalAction,
        default=True,
        help="continue from existing demonstrations",
    )
    text = "write the ProMP prior there, npz and json (default: to the robot's folder)"
    out.add_argument("--fit", type=output_path, metavar="PATH", help=text)
    out.add_argument("--overwrite", action="store_true", help="replace the prior that is there")
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    goes_on = "stopped; the same command goes on from here"
    return exit_status(
        "python -m agents.demonstrations", lambda: run(parser().parse_args(arguments)), goes_on
    )


def run(options: argparse.Namespace) -> None:
    """Make demonstrations of a robot, and fit its prior.

    Raises:
        SpaceEnvsError: as in `generate`, for a robot that is not found or has two arms, or if a prior exists
            already.
    """
    robot = chosen_robot(options)
    config = DemonstratorConfig(difficulty=options.difficulty, bands=options.bands)
    folder = options.output or robot_folder(robot) / "demonstrations"
    prior = options.fit or robot_folder(robot) / PRIOR
    for path in (prior, prior.with_suffix(".json")):
        check_replaceable(path, options.overwrite)
    with held(folder, "demonstrations"):
        made = generate(
            folder, robot, options.count, options.seed, config, options.jobs, options.resume, True
        )
    save_prior(prior, fit_prior(made), provenance(robot, config, options.seed, options.count))
    print(f"{len(made.kind)} demonstrations of {robot.name} in {folder / 'demonstrations.npz'}")
    print(f"{made.attempt.sum()} drawn motions were not usable and were replaced")
    print(f"mean base disturbance (eq. 20): {1e4 * made.cost.mean():.1f} cm^2/s (c = 1 m/rad)")
    print(f"prior in {prior}")
    print_use(robot)


if __name__ == "__main__":
    sys.exit(main())
