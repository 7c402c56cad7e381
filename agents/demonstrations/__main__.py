"""`python -m agents.demonstrations`: demonstrations of the paper's controller, and the prior from them."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from agents.demonstrations.prior import fit_prior, save_prior
from agents.demonstrations.storage import COUNT, generate, provenance
from agents.demonstrations.variations import BANDS, DemonstratorConfig
from space_envs.system.command_line import Parser, check_replaceable, exit_status, output_path
from space_envs.system.output import held
from space_envs.tasks.common import DIFFICULTIES


def parser() -> Parser:
    """The command line."""
    out = Parser(
        prog="python -m agents.demonstrations",
        description="Make demonstrations and learn a ProMP prior from them.",
    )
    out.add_argument("--count", type=int, default=COUNT, help="how many (default %(default)s)")
    out.add_argument(
        "--output", type=output_path, default=Path("demonstrations"), help="folder (default %(default)s)"
    )
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
    out.add_argument(
        "--fit", type=output_path, metavar="PATH", help="write the ProMP prior there (npz and json)"
    )
    out.add_argument("--overwrite", action="store_true", help="replace the prior that is there")
    return out


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    goes_on = "stopped; the same command goes on from here"
    return exit_status(
        "python -m agents.demonstrations", lambda: run(parser().parse_args(arguments)), goes_on
    )


def run(options: argparse.Namespace) -> None:
    """Make demonstrations, and fit the prior if `--fit` is given.

    Raises:
        SpaceEnvsError: as in `generate`, or if a prior exists already.
    """
    config = DemonstratorConfig(difficulty=options.difficulty, bands=options.bands)
    if options.fit is not None:
        for path in (options.fit, options.fit.with_suffix(".json")):
            check_replaceable(path, options.overwrite)
    with held(options.output, "demonstrations"):
        made = generate(
            options.output, options.count, options.seed, config, options.jobs, options.resume, True
        )
    if options.fit is not None:
        save_prior(options.fit, fit_prior(made), provenance(config, options.seed, options.count))
    print(f"{len(made.kind)} demonstrations in {options.output / 'demonstrations.npz'}")
    print(f"{made.attempt.sum()} drawn motions were not usable and were replaced")
    print(f"mean base disturbance (eq. 20): {1e4 * made.cost.mean():.1f} cm^2/s (c = 1 m/rad)")
    if options.fit is not None:
        print(f"prior in {options.fit}")


if __name__ == "__main__":
    sys.exit(main())
