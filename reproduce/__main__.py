"""`python -m reproduce PAPER`: a paper's figures, tables and claims from our own runs, as one page."""

import argparse
import importlib
import os
import shlex
import sys
from pathlib import Path
from time import perf_counter

from rich.console import Console

from reproduce.page.writing import write_docs, write_page
from reproduce.study import STUDIES, StudyOptions
from space_envs.errors import ConfigurationError, unknown_name
from space_envs.system.command_line import Parser, exit_status, output_path
from space_envs.system.output import held


def parser() -> argparse.ArgumentParser:
    """The command line."""
    out = Parser(
        prog="python -m reproduce",
        description="Reproduce a paper: its figures, its tables and its claims, each tested on the paper's "
        "own case and on many. Writes one self-contained HTML page, the same as Markdown, the figures "
        "and the numbers. A run that was stopped goes on where it was.",
        epilog="Example: python -m reproduce shah2013 --quick",
    )
    out.add_argument("paper", help=", ".join(STUDIES))
    out.add_argument("--quick", action="store_true", help="few cases; the page says so")
    out.add_argument("--output", type=output_path, metavar="DIR", help="folder (default results/PAPER)")
    every = ", ".join(
        f"{study.name} {study.cases} {study.of}, quick {study.quick}" for study in STUDIES.values()
    )
    out.add_argument("--cases", type=int, metavar="N", help=f"number of cases (default: {every})")
    out.add_argument(
        "--seed", type=int, default=0, metavar="S", help="of everything that is drawn (default 0)"
    )
    out.add_argument(
        "--jobs", type=int, default=os.cpu_count() or 1, metavar="J", help="processes (default: all cores)"
    )
    out.add_argument(
        "--docs", type=Path, metavar="DIR", help="also write the lasting part as DIR/PAPER.md with DIR/images"
    )
    return out


def main(arguments: list[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    goes_on = "stopped; finished cases are kept, the same command goes on"
    return exit_status("python -m reproduce", lambda: run(parser().parse_args(arguments)), goes_on)


def command_of(options: argparse.Namespace) -> str:
    """The command with what determines a page: neither folders nor the number of processes."""
    words = ["python", "-m", "reproduce", options.paper]
    words += ["--quick"] if options.quick else []
    words += [] if options.cases is None else ["--cases", str(options.cases)]
    return shlex.join(words + ([] if options.seed == 0 else ["--seed", str(options.seed)]))


def run(options: argparse.Namespace) -> None:
    """Compute the cases of a paper and write its page.

    Raises:
        SpaceEnvsError: for options that are not valid, before anything is computed.
    """
    if options.paper not in STUDIES:
        raise unknown_name("paper", options.paper, STUDIES)
    study = STUDIES[options.paper]
    cases = options.cases if options.cases is not None else study.quick if options.quick else study.cases
    for name, value, least in (("cases", cases, 1), ("seed", options.seed, 0), ("jobs", options.jobs, 1)):
        if value < least:
            raise ConfigurationError(f"{name} must be at least {least}, got {value}")
    if options.docs is not None and not options.docs.is_dir():
        raise ConfigurationError(f"--docs must name a folder that is there, got {options.docs}")
    output = (options.output or Path("results") / study.name).absolute()
    started = perf_counter()
    asked = StudyOptions(
        output=output,
        cases=cases,
        seed=options.seed,
        jobs=options.jobs,
        quick=options.quick,
        command=command_of(options),
    )
    with held(output, f"reproduction of {study.name}"):
        page = importlib.import_module(f"reproduce.{study.name}").reproduce(asked)
        paths = write_page(page, output)
    if options.docs is not None:
        paths["Documentation"] = write_docs(page, options.docs)
    console = Console()
    console.print(f"{study.name}: {perf_counter() - started:.0f} s", highlight=False)
    for label, path in paths.items():
        console.print(f"{label + ':':15}{path}", highlight=False, soft_wrap=True, markup=False)


if __name__ == "__main__":
    sys.exit(main())
