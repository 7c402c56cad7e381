"""The leaderboard as a terminal table, Markdown, CSV and LaTeX."""

import csv
import io
import math
from collections import Counter
from collections.abc import Sequence
from itertools import chain, groupby
from textwrap import wrap
from typing import Literal, cast

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from space_envs.evaluation.play.causes import CAUSES, OUTCOMES
from space_envs.evaluation.play.entry import EvaluatedTask
from space_envs.evaluation.records.names import csv_name, display_name, latex_name, markdown_name
from space_envs.evaluation.statistics.columns import NOTE, RANK, RULES, Column, columns_of, leaders
from space_envs.evaluation.statistics.figures import FIGURES, HEADLINE, TIMINGS
from space_envs.evaluation.statistics.intervals import MISSING
from space_envs.evaluation.statistics.row import Row
from space_envs.tasks.outcome import Outcome

_TERMINAL_NAME, _NARROW_NAME = 40, 24  # letters of a policy's name that a terminal shows
_NARROW = 100  # columns below which a terminal is narrow
_PIPE_WIDTH = 400
_TITLE = 9  # letters of a line of a column's head, unless a word is longer
_WITH_INTERVALS = (HEADLINE, "success")  # where there is no room for all
# Words for causes in a count, of one and of several.
_CALLED = {outcome.value: (outcome.label, outcome.plural) for outcome in Outcome}


def by_task(rows: Sequence[Row]) -> list[tuple[EvaluatedTask, list[Row]]]:
    """Rows of each task together, in the order of `build_rows`."""
    return [(task, list(group)) for task, group in groupby(rows, key=lambda row: row.task)]


def row_name(row: Row, rows: Sequence[Row]) -> str:
    """The policy's name, with its control mode where that is not the one of most rows shown together."""
    usual = usual_mode(rows)
    return row.policy if row.control_mode == usual else f"{row.policy} ({row.control_mode})"


def usual_mode(rows: Sequence[Row]) -> str:
    """The control mode of most rows; of several, the first in the alphabet."""
    count = Counter(row.control_mode for row in rows)
    return min(count, key=lambda mode: (-count[mode], mode))


def modes_told(rows: Sequence[Row]) -> str:
    """The control mode of the rows, in words."""
    several = len({row.control_mode for row in rows}) > 1
    return usual_mode(rows) + (" where no other is named" if several else "")


def failures_told(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Each policy that failed, and all its failed episodes by their cause, such as "18 of 100: 10 infeasible,
    6 timeouts, 2 singular"; the same words wherever a table stands."""
    told = []
    for row in rows:
        if row.failures:
            failed = sum(each.count for each in row.failures)
            causes = ", ".join(f"{e.count} {cause_called(e.cause, e.count)}" for e in row.failures)
            told.append((row_name(row, rows), f"{failed} of {row.episodes}: {causes}"))
    return told


def cause_called(cause: str, count: int) -> str:
    """A cause of failure in words, after a number."""
    one, several = _CALLED.get(cause, (cause.replace("_", " "),) * 2)
    return one if count == 1 else several


def counts_told(rows: Sequence[Row]) -> str:
    """Number of episodes and seeds of the rows of a task, in words."""
    episodes = sorted({row.episodes for row in rows})
    seeds = len({seed for row in rows for seed in row.seeds})
    ends = " to ".join(map(str, dict.fromkeys((episodes[0], episodes[-1]))))
    return f"{ends} episodes a policy, {seeds} seed{'s' if seeds > 1 else ''}"


def to_terminal(rows: Sequence[Row], console: Console | None = None) -> None:
    """Print one table for each task; a narrow terminal gets fewer columns, a pipe all and no colours."""
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
        told = f"{task}, {modes_told(group)}; {counts_told(group)}"
        print_at(console, Text(display_name(told, 200), style="bold"), width)
        print_at(console, table, width)
        hidden = [column.title for column in everything if column not in columns]
        if hidden:
            print_at(console, Text(f"Not shown at this width: {', '.join(hidden)}.", style="dim"), width)
        for name, failures in failures_told(group):
            print_at(console, Text(f"Failed: {display_name(name)}, {failures}", style="dim"), width)
        for rule in RULES:
            print_at(console, Text(rule, style="dim"), words)
        print_at(console, Text(""), words)
    print_at(console, Text(NOTE, style="dim"), words)


def to_markdown(rows: Sequence[Row]) -> str:
    """One table for each task, with intervals, failures and rules; names are escaped."""
    parts = ["# Leaderboard\n"]
    for task, group in by_task(rows):
        told = markdown_name(f"{counts_told(group)}. Control mode: {modes_told(group)}.", 200)
        parts.append(f"\n## {markdown_name(str(task), 200)}\n\n{told}\n\n{markdown_table(group)}")
    parts.append(f"\n{NOTE}\n")
    return "".join(parts)


def markdown_table(rows: Sequence[Row], brief: bool = False) -> str:
    """The table of one task, its failures and the rules under it; all columns and intervals, or a few."""
    every = columns_of(rows[0].metrics)
    rank, *others = [column for column in every if not brief or column.display.room != "full"]
    heads = [rank.heading, "policy", *(column.heading for column in others)]
    parts = [f"| {' | '.join(heads)} |\n", "| ---: | --- |" + " ---: |" * len(others) + "\n"]
    for row in rows:
        bare = {column.key for column in others if brief and column.key not in _WITH_INTERVALS}
        cells = [f"{c.value(row)} {'' if c.key in bare else c.interval(row)}".strip() for c in others]
        parts.append(f"| {' | '.join([rank.value(row), markdown_name(row_name(row, rows)), *cells])} |\n")
    failed = failures_told(rows)
    parts.append("\nFailed:\n\n" if failed else "")
    parts += [f"- {markdown_name(name)}, {failures}\n" for name, failures in failed]
    return "".join(parts) + f"\n{' '.join(RULES)}\n"


def to_csv(rows: Sequence[Row]) -> str:
    """Every figure with its interval in the units of the records; rates in 0..1, empty where none exists."""
    head = ["rank", "env_id", "difficulty", "split", "policy", "control_mode", "config_hash", "task_version"]
    head += ["episodes", "captures", "seeds"]
    figures = dict.fromkeys(chain(FIGURES, *(row.figures for row in rows)))
    largest = dict.fromkeys(chain.from_iterable(row.largest for row in rows))
    for key in figures:
        head += [key, f"{key}_low", f"{key}_high"]
    head += [*(f"{key}_max" for key in largest), *OUTCOMES, *(f"cause_{cause}" for cause in CAUSES)]
    head += [f"timing_{key}" for key in TIMINGS]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    for row in rows:
        numbers = [end for key in figures for end in vars(row.figures.get(key, MISSING)).values()]
        numbers += [row.largest.get(key, math.nan) for key in largest]
        names = (row.task.env_id, row.task.difficulty, row.task.split, row.policy, row.control_mode)
        cells: list[object] = ["" if row.rank is None else row.rank, *map(csv_name, names)]
        cells += [csv_name(row.config_hash), row.task_version, row.episodes, row.captures, len(row.seeds)]
        cells += [repr(number) if math.isfinite(number) else "" for number in numbers]
        cells += [row.outcomes[outcome] for outcome in OUTCOMES]
        causes = {each.cause: each.count for each in row.failures}
        cells += [causes.get(cause, 0) for cause in CAUSES]
        cells += [repr(row.timing[key]) if math.isfinite(row.timing[key]) else "" for key in TIMINGS]
        writer.writerow(cells)
    return text.getvalue()


def to_latex(rows: Sequence[Row]) -> str:
    """One table (booktabs) for each task to \\input into a paper, the best figures of each column bold."""
    parts = ["% \\usepackage{booktabs} in the preamble.\n"]
    for task, group in by_task(rows):
        columns = [c for c in columns_of(group[0].metrics) if c.display.room == "paper"]
        caption = f"{latex_name(str(task))}: {counts_told(group)}, 95\\,\\% intervals in brackets. "
        caption += f"Control mode: {latex_name(modes_told(group))}."
        heads = [latex_name(column.title) for column in columns]
        units = [f"[{_latex_unit(column.unit)}]" if column.unit else "" for column in columns]
        parts += [
            "\\begin{table}\n  \\centering\\small\n",
            f"  \\caption{{{caption}}}\n",
            f"  \\begin{{tabular}}{{rl{'r' * len(columns)}}}\n    \\toprule\n",
            f"    {RANK.title} & policy & {' & '.join(heads)} \\\\\n",
            f"    & & {' & '.join(units)} \\\\\n    \\midrule\n",
        ]
        for row in group:
            cells = [_latex_cell(column, row, group) for column in columns]
            cells = [RANK.value(row), latex_name(row_name(row, group)), *cells]
            parts.append(f"    {' & '.join(cells)} \\\\\n")
        parts.append("    \\bottomrule\n  \\end{tabular}\n")
        parts.append(f"  \\par\\smallskip\\footnotesize {' '.join(RULES)}\n\\end{{table}}\n")
    return "".join(parts)


def _latex_unit(unit: str) -> str:
    return unit.replace("%", r"\%").replace("^2", r"\textsuperscript{2}")


def _latex_cell(column: Column, row: Row, rows: Sequence[Row]) -> str:
    value = column.value(row)
    shown = f"\\textbf{{{value}}}" if row in leaders(column, rows) else value
    interval = column.interval(row).replace("[", "{[}").replace("]", "{]}")
    return f"{shown} {{\\footnotesize {interval}}}" if interval else shown


def _rich_table(rows: Sequence[Row], columns: Sequence[Column], longest: int) -> Table:
    table = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False)
    rank, *others = columns
    table.add_column(rank.title, justify="right", vertical="bottom", no_wrap=True)
    table.add_column("policy", vertical="bottom", no_wrap=True)
    for column in others:
        lines = [*wrap(column.title, _TITLE, break_long_words=False, break_on_hyphens=False), column.unit]
        table.add_column(Text("\n".join(lines)), justify="right", vertical="bottom", no_wrap=True)
    for number, row in enumerate(rows):
        name = Text(display_name(row_name(row, rows), longest), style="bold" if number == 0 else "")
        cells = [Text(rank.value(row)), name]
        for column in others:
            # Two intervals are what a terminal has room for; the files have all of them.
            interval = column.interval(row) if column.key in _WITH_INTERVALS else ""
            cells.append(Text.assemble(column.value(row), (f" {interval}" if interval else "", "dim")))
        table.add_row(*cells)
    return table


def width_of(console: Console) -> int:
    """Columns that a table may take: those of a terminal; a file has no width, and rows stay on one line."""
    return console.width if console.is_terminal else _PIPE_WIDTH


def print_at(console: Console, renderable: Text | Table, width: int) -> None:
    """Print at a width of our own, in characters that the output's encoding has."""
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
