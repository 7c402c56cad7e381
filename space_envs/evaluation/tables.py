"""The leaderboard as a terminal table, Markdown, CSV and LaTeX. Columns are defined here, for HTML too."""

import csv
import io
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal, cast

from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from space_envs.evaluation.leaderboard import DRIFTS, FIGURES, TIMINGS, Row, Task
from space_envs.evaluation.names import csv_name, display_name, latex_name, markdown_name
from space_envs.evaluation.records import OUTCOMES
from space_envs.evaluation.statistics import CONFIDENCE, Estimate

NOTE = (
    f"Brackets: {100 * CONFIDENCE:.0f} % intervals (Wilson for rates, stratified bootstrap for the others). "
    "Failed episodes count in every figure; attitude, cost and errors are interquartile means over "
    "all episodes, time to capture is the median with a failure later than any capture. "
    "A figure that does not exist is shown as -."
)

ABLE = 0.9  # success from which a policy competes for the gentlest and the fastest capture
_TERMINAL_NAME = 40  # letters of a policy's name that a terminal shows
# What a page of a paper has room for.
_IN_PAPERS = (
    "success",
    "capture@1deg",
    "final_attitude",
    "attitude_cost",
    "time_to_capture",
    "planning_ms",
)
_PIPE_WIDTH = 400


@dataclass(frozen=True)
class Column:
    """A column of the leaderboard: `scale` takes the figure from the record's unit to the one shown."""

    key: str
    title: str
    unit: str
    better: Literal["higher", "lower"] | None
    scale: float = 1.0
    decimals: int | None = None  # None: three significant digits
    priority: int = 0  # columns with larger numbers leave a narrow terminal first
    meaning: str = ""

    @property
    def heading(self) -> str:
        """Title with its unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    def estimate(self, row: Row) -> Estimate:
        """The figure in the unit shown; NaN ends where a figure has no interval."""
        if self.key in row.figures:
            raw = row.figures[self.key]
            return Estimate(*(self.scale * end for end in (raw.value, raw.low, raw.high)))
        value = row.timing[self.key] if self.key in TIMINGS else float(row.episodes)
        return Estimate(value, math.nan, math.nan)

    def number(self, value: float) -> str:
        """A number as this column shows it."""
        if not math.isfinite(value):
            return "-"
        return f"{value:.{self.decimals}f}" if self.decimals is not None else _significant(value)

    def interval(self, row: Row) -> str:
        """`[low, high]`, or nothing where the figure has no interval."""
        estimate = self.estimate(row)
        if math.isnan(estimate.low) or math.isinf(estimate.value):
            return ""
        return f"[{self.number(estimate.low)}, {self.number(estimate.high)}]"

    def value(self, row: Row) -> str:
        """The figure alone."""
        return self.number(self.estimate(row).value)


COLUMNS: tuple[Column, ...] = (
    Column("success", "success", "%", "higher", 100, 0, 0, "share of all episodes that captured"),
    Column("capture@5deg", "capture@5deg", "%", "higher", 100, 0, 7, "captured, with at most 5 deg left"),
    Column("capture@1deg", "capture@1deg", "%", "higher", 100, 0, 6, "captured, with at most 1 deg left"),
    Column("capture@0.1deg", "capture@0.1deg", "%", "higher", 100, 0, 2, "captured, at most 0.1 deg left"),
    Column("final_attitude", "final attitude", "deg", "lower", priority=1, meaning="of the base, at the end"),
    Column("peak_attitude", "peak attitude", "deg", "lower", priority=7, meaning="largest of the base"),
    Column("attitude_cost", "eq. 20 cost", "cm^2/s", "lower", 1e4, priority=5, meaning="shyam2020, times dt"),
    Column("time_to_capture", "time to capture", "s", "lower", priority=8, meaning="median, failures last"),
    Column("position_error", "position error", "mm", "lower", 1000, priority=9, meaning="at the end"),
    Column("planning_ms", "planning", "ms", "lower", priority=3, meaning="median, - without a plan"),
    Column("action_ms", "per action", "ms", "lower", priority=4, meaning="median time to choose one action"),
    Column("episodes", "episodes", "", None, decimals=0, priority=10, meaning="number of episodes"),
)  # fmt: skip


def by_task(rows: Sequence[Row]) -> list[tuple[Task, list[Row]]]:
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


def reasons_told(rows: Sequence[Row]) -> list[tuple[str, str]]:
    """Policies whose episodes failed for a reason that is known: how many, and the most frequent."""
    told = []
    for row in rows:
        if row.reasons:
            count, more = sum(count for _, count in row.reasons), len(row.reasons) - 1
            others = f", and {more} other reason{'s' if more > 1 else ''}" if more else ""
            reason = display_name(row.reasons[0][0], 200)
            told.append((row_name(row, rows), f"{count} of {row.episodes}: {reason}{others}"))
    return told


def leaders(column: Column, rows: Sequence[Row]) -> list[Row]:
    """The rows of one task with the best figure, as far as the digits shown tell them apart.

    All rows compete for rates; for anything else only those that capture at least ABLE of their goals, since
    who does nothing keeps its attitude. Nobody leads with a rate of zero, nor in a column without better and
    worse.
    """
    able = [row for row in rows if column.unit == "%" or row.figures["success"].value >= ABLE]
    able = [row for row in able if math.isfinite(column.estimate(row).value)]
    if column.unit == "%":
        able = [row for row in able if column.estimate(row).value > 0]
    if not able or column.better is None:
        return []
    sign = -1 if column.better == "higher" else 1
    best = min(able, key=lambda row: sign * column.estimate(row).value)
    return [row for row in able if column.value(row) == column.value(best)]


def to_terminal(rows: Sequence[Row], console: Console | None = None) -> None:
    """Print one table for each task; a narrow terminal gets fewer columns, a pipe all and no colours."""
    console = Console() if console is None else console
    for task, group in by_task(rows):
        columns, table = list(COLUMNS), _rich_table(group, COLUMNS)
        width = width_of(console)
        options = console.options.update(max_width=_PIPE_WIDTH)
        while console.measure(table, options=options).maximum > width and len(columns) > 1:
            columns.remove(max(columns, key=lambda column: column.priority))
            table = _rich_table(group, columns)
        print_at(console, Text(display_name(f"{task}, {modes_told(group)}", 200), style="bold"), width)
        print_at(console, table, width)
        hidden = [column.title for column in COLUMNS if column not in columns]
        if hidden:
            print_at(console, Text(f"Not shown at this width: {', '.join(hidden)}.", style="dim"), width)
        for name, reasons in reasons_told(group):
            print_at(console, Text(f"Failed: {display_name(name)}, {reasons}", style="dim"), width)
    print_at(console, Text(NOTE, style="dim"), console.width if console.is_terminal else 100)


def to_markdown(rows: Sequence[Row]) -> str:
    """One table for each task, with intervals; names are escaped."""
    parts = ["# Leaderboard\n"]
    for task, group in by_task(rows):
        told = markdown_name(modes_told(group), 200)
        parts.append(f"\n## {markdown_name(str(task), 200)}\n\nControl mode: {told}.\n\n")
        parts.append("| policy | " + " | ".join(column.heading for column in COLUMNS) + " |\n")
        parts.append("| --- |" + " ---: |" * len(COLUMNS) + "\n")
        for row in group:
            cells = [f"{column.value(row)} {column.interval(row)}".strip() for column in COLUMNS]
            parts.append(f"| {markdown_name(row_name(row, group))} | " + " | ".join(cells) + " |\n")
        failed = reasons_told(group)
        parts.append("\nFailed:\n\n" if failed else "")
        parts += [f"- {markdown_name(name)}, {markdown_name(reasons, 300)}\n" for name, reasons in failed]
    parts.append(f"\n{NOTE}\n")
    return "".join(parts)


def to_csv(rows: Sequence[Row]) -> str:
    """Every figure with its interval in the units of the records; rates in 0..1, empty where none exists."""
    head = ["env_id", "difficulty", "split", "policy", "control_mode", "config_hash", "episodes", "seeds"]
    for key in FIGURES:
        head += [key, f"{key}_low", f"{key}_high"]
    head += [*(f"{key}_max" for key in DRIFTS), *OUTCOMES, *(f"timing_{key}" for key in TIMINGS)]
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(head)
    for row in rows:
        numbers = [end for key in FIGURES for end in vars(row.figures[key]).values()]
        numbers += [row.drift[key] for key in DRIFTS]
        names = (row.task.env_id, row.task.difficulty, row.task.split, row.policy, row.control_mode)
        cells: list[object] = [*map(csv_name, names), csv_name(row.config_hash), row.episodes, len(row.seeds)]
        cells += [repr(number) if math.isfinite(number) else "" for number in numbers]
        cells += [row.outcomes[outcome] for outcome in OUTCOMES]
        cells += [repr(row.timing[key]) if math.isfinite(row.timing[key]) else "" for key in TIMINGS]
        writer.writerow(cells)
    return text.getvalue()


def to_latex(rows: Sequence[Row]) -> str:
    """One table (booktabs) for each task to \\input into a paper, the best figures of each column bold."""
    columns = [column for column in COLUMNS if column.key in _IN_PAPERS]
    parts = ["% \\usepackage{booktabs} in the preamble.\n"]
    for task, group in by_task(rows):
        episodes = ", ".join(str(count) for count in sorted({row.episodes for row in group}))
        caption = f"{latex_name(str(task))}: {episodes} episodes a policy, 95\\,\\% intervals in brackets. "
        caption += f"Control mode: {latex_name(modes_told(group))}."
        heads = [latex_name(column.title) for column in columns]
        units = [f"[{_latex_unit(column.unit)}]" for column in columns]
        parts += [
            "\\begin{table}\n  \\centering\\small\n",
            f"  \\caption{{{caption}}}\n",
            f"  \\begin{{tabular}}{{l{'r' * len(columns)}}}\n    \\toprule\n",
            f"    policy & {' & '.join(heads)} \\\\\n",
            f"    & {' & '.join(units)} \\\\\n    \\midrule\n",
        ]
        for row in group:
            cells = [_latex_cell(column, row, group) for column in columns]
            parts.append(f"    {latex_name(row_name(row, group))} & {' & '.join(cells)} \\\\\n")
        parts.append("    \\bottomrule\n  \\end{tabular}\n\\end{table}\n")
    return "".join(parts)


def _latex_unit(unit: str) -> str:
    return unit.replace("%", r"\%").replace("^2", r"\textsuperscript{2}")


def _latex_cell(column: Column, row: Row, rows: Sequence[Row]) -> str:
    value = column.value(row)
    shown = f"\\textbf{{{value}}}" if row in leaders(column, rows) else value
    interval = column.interval(row).replace("[", "{[}").replace("]", "{]}")
    return f"{shown} {{\\footnotesize {interval}}}" if interval else shown


def _rich_table(rows: Sequence[Row], columns: Sequence[Column]) -> Table:
    table = Table(box=box.SIMPLE_HEAD, header_style="bold", pad_edge=False)
    table.add_column("policy", no_wrap=True)
    for column in columns:
        table.add_column(Text(f"{column.title}\n{column.unit}"), justify="right", no_wrap=True)
    for number, row in enumerate(rows):
        cells = [Text(display_name(row_name(row, rows), _TERMINAL_NAME), style="bold" if number == 0 else "")]
        for column in columns:
            # Two intervals are what a terminal has room for; the files have all of them.
            interval = column.interval(row) if column.key in ("success", "final_attitude") else ""
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


def _significant(value: float) -> str:
    """Three significant digits, without an exponent between 1e-4 and 1e6."""
    if value == 0:
        return "0"
    if not 1e-4 <= abs(value) < 1e6:
        return f"{value:.2e}"
    return f"{value:.{max(0, 2 - math.floor(math.log10(abs(value))))}f}"
