"""`evaluate.py compare`: merge result folders of several people into one leaderboard."""

import argparse
import shlex
from dataclasses import replace
from pathlib import Path

from agents.commands.choice import expert_names
from agents.commands.show import show
from space_envs.errors import ConfigurationError, unknown_name
from space_envs.evaluation.records.episode import RECORDS
from space_envs.evaluation.report.folder import write_report
from space_envs.evaluation.results.folders import read_folder
from space_envs.evaluation.results.merge import Source, merge
from space_envs.registration import find
from space_envs.system.command_line import AppendValues, Parser, exit_status, output_path
from space_envs.system.output import check_free, held
from space_envs.system.provenance import versions

COMPARISON = "comparison"  # kind of the folder
DESCRIPTION = """\
Merge result folders of several people into one leaderboard with a report of its own.

  evaluate.py compare results/mine results/theirs --output results/both
  evaluate.py compare mine theirs --name theirs=Ann --output both

Every record is validated. Records of another version, difficulty, goal or split, or of a task with another
configuration, are refused with what differs; so are records and files that were edited. An episode with the
same result in two folders counts once; one with two different results is an error. Where two people call
different policies by one name, --name appends a name to those of a folder: promp becomes `promp (Ann)`.

Checksums detect accidental edits, not forgery. To verify a folder, repeat the command in its summary.json,
with --time-limit if its policy may need more time than the others.
"""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    out = Parser(
        prog="evaluate.py compare",
        description=DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    add = out.add_argument
    add("results", nargs="+", type=Path, metavar="RESULTS", help="result folders of evaluate.py")
    what = "folder for the merged result"
    add("--output", type=output_path, required=True, metavar="FOLDER", help=what)
    add("--overwrite", action="store_true", help="replace the comparison that the folder holds")
    what = "append NAME to the names of a folder's policies; can be given several times"
    add("--name", action="append", default=[], metavar="RESULTS=NAME", help=what)
    what = "ids of other packages, as module:id; their modules are imported, which replays need"
    add("--env", action=AppendValues, nargs="+", default=[], metavar="ID", help=what)
    what = "accept folders that share no version, difficulty, goal, split or perturbation, as tables of "
    what += "their own"
    add("--separate", action="store_true", help=what)
    return out


def main(arguments: list[str]) -> int:
    """Run the command; returns the exit status."""
    return exit_status("evaluate.py compare", lambda: _run(parser().parse_args(arguments), arguments))


def _run(options: argparse.Namespace, arguments: list[str]) -> None:
    folders = _distinct(options.results)
    for name in options.env:
        find(name)
    names = _names(options.name, folders)
    if options.output.resolve() in [folder.resolve() for folder in folders]:
        raise ConfigurationError(f"--output {options.output} is one of the folders that are merged")
    check_free(options.output, COMPARISON)
    if (options.output / RECORDS).exists() and not options.overwrite:
        raise ConfigurationError(
            f"{options.output} holds a comparison already; --overwrite replaces it, or name another folder"
        )
    sources = [Source(read_folder(path), names.get(path.resolve(), "")) for path in folders]
    about = {
        "command": shlex.join(["evaluate.py", "compare", *arguments]),
        "seeds": sorted({record.seed for source in sources for record in source.folder.records}),
        "versions": versions(),
    }
    result, notes = merge(sources, about, options.separate)
    result = replace(result, experts=expert_names())
    with held(options.output, COMPARISON):
        write_report(result, options.output)
    show(result.records, options.output, result.described, notes=notes)


def _distinct(paths: list[Path]) -> list[Path]:
    places = [path.resolve() for path in paths]
    for path, place in zip(paths, places, strict=True):
        if places.count(place) > 1:
            raise ConfigurationError(f"{path} is given twice")
    return paths


def _names(given: list[str], folders: list[Path]) -> dict[Path, str]:
    """Names to append to the policies, by result folder."""
    names: dict[Path, str] = {}
    for text in given:
        place, equals, name = text.rpartition("=")
        if not (place and equals and name.strip()):
            raise ConfigurationError(f"--name takes RESULTS=NAME, got {text!r}")
        path = Path(place).resolve()
        if path not in [folder.resolve() for folder in folders]:
            raise unknown_name("folder in --name", place, [str(folder) for folder in folders])
        if path in names:
            raise ConfigurationError(f"--name names {place} twice")
        names[path] = name.strip()
    return names
