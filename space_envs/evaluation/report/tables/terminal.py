"""The leaderboard in a terminal."""

import io
from collections.abc import Sequence
from textwrap import wrap
from typing import Literal, cast

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from space_envs.evaluation.leaderboard.columns import KNOWLEDGE, NOTE, RULES, Column, columns_of
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.records.names import display_name
from space_envs.evaluation.report.tables.markdown import WITH_INTERVALS
from space_envs.evaluation.report.tables.wording import (
    by_task,
    counts_summary,
    failure_summaries,
    modes_summary,
    row_name,
)

_TERMINAL_NAME, _NARROW_NAME = 40, 24  # characters of a policy's name that a terminal shows


_NARROW = 100  # columns below which a terminal is narrow
_PIPE_WIDTH = 400
_TITLE = 9  # characters of a line of a column's head, unless a word is longer


def to_terminal(rows: Sequence[Row], console: Console | None = None) -> None:
    """Print one table for each task; a narrow terminal gets fewer columns, a pipe all and no colors."""
    console = Console() if console is None else console
    words = console.width if console.is_terminal else 100
    for task, group in by_task(rows):
        width = width_of(console)
        longest = _TERMINAL_NAME if width >= _NARROW else _NARROW_NAME
        everything = columns_of(group[0].metrics)
        columns, table = list(everything), _rich_table(group, everything, longest)
        options = console.options.update(max_width=_PIPE_WIDTH)
        while console.measure(table, options=options).maximum > width and len(columns) > 1:
            columns.remove(max(columns, key=lambda column: column.display.priority))
            table = _rich_table(group, columns, longest)
        summary = f"{task}, {modes_summary(group)}; {counts_summary(group)}"
        print_at(console, Text(display_name(summary, 200), style="bold"), width)
        print_at(console, table, width)
        hidden = [column.title for column in everything if column not in columns]
        if hidden:
            print_at(console, Text(f"Not shown at this width: {', '.join(hidden)}.", style="dim"), width)
        for name, failures in failure_summaries(group):
            print_at(console, Text(f"Failed: {display_name(name)}, {failures}", style="dim"), width)
        for rule in RULES:
            print_at(console, Text(rule, style="dim"), words)
        print_at(console, Text(""), words)
    print_at(console, Text(NOTE, style="dim"), words)


def _rich_table(rows: Sequence[Row], columns: Sequence[Column], longest: int) -> Table:
    table = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False)
    rank, *others = columns
    table.add_column(rank.title, justify="right", vertical="bottom", no_wrap=True)
    table.add_column("policy", vertical="bottom", no_wrap=True)
    if longest == _TERMINAL_NAME:
        table.add_column(KNOWLEDGE, vertical="bottom", no_wrap=True)
    for column in others:
        lines = [*wrap(column.title, _TITLE, break_long_words=False, break_on_hyphens=False), column.unit]
        table.add_column(Text("\n".join(lines)), justify="right", vertical="bottom", no_wrap=True)
    for number, row in enumerate(rows):
        name = Text(display_name(row_name(row, rows), longest), style="bold" if number == 0 else "")
        knowledge = [Text(row.knowledge, style="dim")] if longest == _TERMINAL_NAME else []
        cells = [Text(rank.value(row)), name, *knowledge]
        for column in others:
            # Two intervals are what a terminal has room for; the files have all of them.
            interval = column.interval(row) if column.key in WITH_INTERVALS else ""
            cells.append(Text.assemble(column.value(row), (f" {interval}" if interval else "", "dim")))
        table.add_row(*cells)
    return table


def width_of(console: Console) -> int:
    """Columns that a table may take: those of a terminal; a file has no width, and rows stay on one line."""
    return console.width if console.is_terminal else _PIPE_WIDTH


def print_at(console: Console, renderable: Text | Table, width: int) -> None:
    """Print at a given width, in characters that the output's encoding has."""
    rendered = io.StringIO()
    # A console prints no wider than itself, and one that writes to a pipe believes to have 80 columns.
    color_system = cast(Literal["standard", "256", "truecolor", "windows"] | None, console.color_system)
    Console(
        file=rendered,
        width=width,
        force_terminal=console.is_terminal,
        color_system=color_system,
        no_color=console.no_color,
        legacy_windows=False,
    ).print(renderable)
    text = "\n".join(line.rstrip() for line in rendered.getvalue().splitlines())
    encoding = console.encoding or "utf-8"
    console.file.write(text.encode(encoding, "replace").decode(encoding) + "\n")
