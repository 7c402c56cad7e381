"""Columns of a leaderboard: name, unit and digits of each figure, for every table, page and plot."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from space_envs.errors import unknown_name
from space_envs.evaluation.leaderboard.figures import BUILT_IN, HEADLINE, TIMINGS, MetricFigure
from space_envs.evaluation.leaderboard.rounding import interval, rounded, supported_decimals
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.statistics.intervals import Estimate
from space_envs.evaluation.statistics.resampling import CONFIDENCE
from space_envs.metric import Better, Display

KNOWLEDGE = "knowledge"  # heading of the column next to the policies' names
ABLE = 0.9  # success from which a policy competes for the gentlest and the fastest capture
RULES = (
    "Ranked by the kept-attitude score: the mean over all episodes of captured / (1 + peak attitude / 1 deg),"
    " so that a failure counts 0 and a capture that never rotates the satellite 1.",
    "Attitude, base disturbance, time and errors are over captures alone, whose number stands in a column of "
    "its own; hold, random and policies without a capture have no rank and are never marked best.",
    "The base disturbance (eq. 20 of Shyam et al. 2020) falls with slowness: the same path in twice the time "
    "has half of it. Disturbance x duration, with the time until the envelope is entered, does not.",
)  # stand under every table
NOTE = (
    f"Brackets: {100 * CONFIDENCE:.0f} % intervals (Wilson for rates, stratified bootstrap for the others, "
    "both together for the score). Figures over captures are interquartile means, the time to capture is the "
    "median; of policies that captured different goals, they are of different goals. Figures have the digits "
    "that their interval supports, three at most. A figure that does not exist is shown as -."
)


@dataclass(frozen=True)
class Column:
    """Column of a leaderboard: a figure of each row, and how it is displayed."""

    key: str
    meaning: str
    display: Display

    @property
    def title(self) -> str:
        """Heading without its unit."""
        return self.display.title

    @property
    def unit(self) -> str:
        """Unit of the numbers shown."""
        return self.display.unit

    @property
    def scale(self) -> float:
        """Factor from the unit of the records to the one shown."""
        return self.display.scale

    @property
    def better(self) -> Better | None:
        """Whether a higher or a lower figure is better."""
        return self.display.better

    @property
    def heading(self) -> str:
        """Title with its unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    @property
    def share(self) -> bool:
        """Whether failures count in it: a share of all episodes, the score, or a metric of all episodes."""
        return self.unit == "%" or self.key == HEADLINE or self.display.over == "all"

    def estimate(self, row: Row) -> Estimate:
        """The figure in the unit shown; what does not exist, and ends where there is no interval, are NaN."""
        if self.key in row.figures:
            raw = row.figures[self.key]
            return Estimate(*(self.scale * end for end in (raw.value, raw.low, raw.high)))
        if self.key in row.largest:
            return Estimate(self.scale * row.largest[self.key], math.nan, math.nan)
        if self.key in TIMINGS:
            return Estimate(row.timing[self.key], math.nan, math.nan)
        number = getattr(row, self.key, None)
        return Estimate(math.nan if number is None else float(number), math.nan, math.nan)

    def digits(self, estimate: Estimate) -> int:
        """Decimals with which a figure and its interval are shown."""
        decimals = self.display.decimals
        return supported_decimals(estimate) if decimals is None else decimals

    def value(self, row: Row) -> str:
        """The figure alone."""
        estimate = self.estimate(row)
        return rounded(estimate.value, self.digits(estimate))

    def interval(self, row: Row) -> str:
        """`[low, high]`, or nothing where the figure has no interval."""
        return interval(self.estimate(row), self.display.decimals)


def _share(key: str, meaning: str, priority: int = 0, room: str = "full") -> Column:
    """A share of all episodes."""
    display = Display(key, "higher", unit="%", scale=100.0, decimals=0, priority=priority, room=room)
    return Column(key, meaning, display)


def _number(key: str, meaning: str, better: Better | None, priority: int, room: str = "readme") -> Column:
    return Column(key, meaning, Display(key, better, decimals=0, priority=priority, room=room))


RANK = _number("rank", "by the kept-attitude score", "lower", -2)
_FIRST = (
    RANK,
    Column(
        HEADLINE,
        "mean of captured / (1 + peak attitude / 1 deg) over all episodes",
        Display("kept-attitude score", "higher", room="paper", priority=-1),
    ),
    _share("success", "share of all episodes that captured", room="paper"),
    _share("capture@5deg", "captured, final attitude at most 5 deg", 12),
    _share("capture@1deg", "captured, final attitude at most 1 deg", 9),
    _share("capture@0.1deg", "captured, final attitude at most 0.1 deg", 5),
    _share("kept@5deg", "captured, peak attitude at most 5 deg", 16),
    _share("kept@1deg", "captured, peak attitude at most 1 deg", 3, "readme"),
    _share("kept@0.1deg", "captured, peak attitude at most 0.1 deg", 6),
)
_LAST = (
    Column(
        "planning_ms",
        "median, - without a plan",
        Display("planning", "lower", unit="ms", priority=7, room="readme"),
    ),
    Column(
        "action_ms",
        "median time to choose one action",
        Display("per action", "lower", unit="ms", priority=13, room="readme"),
    ),
    _number("captures", "number of captures", None, 1, "paper"),
    _number("episodes", "number of episodes", None, 14, "full"),
)


def columns_of(metrics: Sequence[MetricFigure]) -> tuple[Column, ...]:
    """All columns of a table whose task has these figures."""
    shown = [figure for figure in metrics if figure.display.title]
    return (*_FIRST, *(Column(each.key, _meaning(each), each.display) for each in shown), *_LAST)


def _meaning(figure: MetricFigure) -> str:
    statistic = figure.display.statistic
    return figure.meaning + ("" if statistic == "interquartile mean" else f"; {statistic}")


COLUMNS = columns_of(BUILT_IN)  # of every task


def column_named(name: str, columns: Sequence[Column] = COLUMNS) -> Column:
    """The column of a key or a title; ConfigurationError with the nearest key if there is none."""
    for column in columns:
        if name in (column.key, column.title):
            return column
    raise unknown_name("column", name, [column.key for column in columns])


def leaders(column: Column, rows: Sequence[Row]) -> list[Row]:
    """The rows of one task with the best figure, as far as the digits shown tell them apart.

    Baselines and policies without a capture do not compete. For what is over captures alone only those
    compete that capture at least ABLE of their goals, since who captures the easy ones alone is gentle.
    Nobody leads with a share of zero, nor in a column without better and worse.
    """
    able = [row for row in rows if row.competes and math.isfinite(column.estimate(row).value)]
    if column.share:
        able = [row for row in able if column.estimate(row).value > 0]
    else:
        able = [row for row in able if column.key == "rank" or row.figures["success"].value >= ABLE]
    if not able or column.better is None:
        return []
    sign = -1 if column.better == "higher" else 1
    best = min(able, key=lambda row: sign * column.estimate(row).value)
    digits = column.digits(column.estimate(best))
    shown = rounded(column.estimate(best).value, digits)
    return [row for row in able if rounded(column.estimate(row).value, digits) == shown]
