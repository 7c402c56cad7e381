"""`evaluate.py show`: print the table of a result folder again."""

import argparse
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from space_envs.errors import unknown_name
from space_envs.evaluation.leaderboard.build import build_rows
from space_envs.evaluation.leaderboard.columns import COLUMNS, column_named, columns_of
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.records.episode import RECORDS, REPORT, EpisodeRecord
from space_envs.evaluation.records.metrics import Described
from space_envs.evaluation.report.folder import BOOTSTRAP_SEED
from space_envs.evaluation.report.tables.terminal import to_terminal
from space_envs.evaluation.report.tables.wording import by_task
from space_envs.evaluation.results.folders import read_folder
from space_envs.system.command_line import AppendValues, Parser, exit_status

DESCRIPTION = "Print the table of a result folder of evaluate.py or evaluate.py compare."


def parser() -> argparse.ArgumentParser:
    """The command line."""
    out = Parser(prog="evaluate.py show", description=DESCRIPTION)
    out.add_argument("results", type=Path, metavar="RESULTS", help="folder")
    what = f"{', '.join(column.key for column in COLUMNS)}: best first (default: as in the report)"
    out.add_argument("--sort", metavar="COLUMN", help=what)
    what = "only tables of these ids, robots, difficulties, splits or goals, such as SingleArm-v0 test"
    out.add_argument("--task", action=AppendValues, nargs="+", default=[], metavar="WORD", help=what)
    return out


def main(arguments: list[str]) -> int:
    """Run the command; returns the exit status."""
    return exit_status("evaluate.py show", lambda: _run(parser().parse_args(arguments)))


def _run(options: argparse.Namespace) -> None:
    folder = read_folder(options.results)
    records = of_tasks(folder.records, options.task)
    show(records, folder.path, folder.described, options.sort, folder.notes)


def show(
    records: Sequence[EpisodeRecord],
    folder: Path,
    described: Described,
    sort: str | None = None,
    notes: Sequence[str] = (),
) -> None:
    """Print the table of records and the paths of the report and the records; notes go to standard error.

    Metrics of tasks of other packages are shown as they are `described`.

    Raises:
        ConfigurationError: for an unknown column.
    """
    rows = build_rows(records, np.random.default_rng(BOOTSTRAP_SEED), described=described)
    if sort is not None:
        rows = sorted_rows(rows, sort)
    console = Console()
    to_terminal(rows, console)
    console.print()
    for label, name in (("Report", REPORT), ("Records", RECORDS)):
        if (folder / name).is_file():
            console.print(f"{label + ':':9}{folder / name}", highlight=False, soft_wrap=True, markup=False)
    for note in notes:
        print(f"note: {note}", file=sys.stderr)


def sorted_rows(rows: Sequence[Row], name: str) -> list[Row]:
    """Rows of each task in the order of a column, best first and missing values last; ties by rank.

    Args:
        name: of the column, its key or its title.

    Raises:
        ConfigurationError: for an unknown column.
    """
    column = column_named(name, columns_of(rows[0].metrics) if rows else COLUMNS)
    sign = 1 if column.better == "lower" else -1

    def place(row: Row) -> tuple[bool, float]:
        value = column.estimate(row).value
        return (False, sign * value) if math.isfinite(value) else (True, 0.0)

    return [row for _, group in by_task(rows) for row in sorted(group, key=place)]


def of_tasks(records: Sequence[EpisodeRecord], words: Sequence[str]) -> list[EpisodeRecord]:
    """Records of the named tasks: words of one kind are alternatives, and all kinds must match.

    Args:
        words: ids, with or without the part before the slash, robots, difficulties, splits, goals and
            perturbations.

    Raises:
        ConfigurationError: for a word that is not in the records, or if no record matches.
    """
    kinds: tuple[dict[str, set[Any]], ...] = ({}, {}, {}, {}, {}, {})
    for record in records:
        ids, robots, difficulties, splits, goals, perturbations = kinds
        for word in (record.env_id, record.env_id.rpartition("/")[2]):
            ids.setdefault(word, set()).add(record.env_id)
        robots.setdefault(record.robot, set()).add(record.robot)
        difficulties.setdefault(record.difficulty, set()).add(record.difficulty)
        splits.setdefault(record.split, set()).add(record.split)
        goals.setdefault(record.goal, set()).add(record.goal)
        perturbations.setdefault(record.perturbation, set()).add(record.perturbation)
    for word in words:
        if not any(word in kind for kind in kinds):
            raise unknown_name("task", word, dict.fromkeys(name for kind in kinds for name in kind))
    selected = [{value for word in words for value in kind.get(word, ())} for kind in kinds]
    found = [
        record
        for record in records
        if all(not values or value in values for values, value in zip(selected, _words(record), strict=True))
    ]
    if not found:
        tasks = dict.fromkeys(str(record.entry.task) for record in records)
        raise unknown_name("task", " ".join(words), tasks)
    return found


def _words(record: EpisodeRecord) -> tuple[str, ...]:
    goals = record.difficulty, record.split, record.goal
    return record.env_id, record.robot, *goals, record.perturbation
