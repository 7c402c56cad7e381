"""The columns of a leaderboard: the one definition of each figure's name, unit and digits, for every table,
page and plot."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from space_envs.errors import unknown_name
from space_envs.evaluation.statistics.intervals import CONFIDENCE, Estimate
from space_envs.evaluation.statistics.leaderboard import HEADLINE, TIMINGS, Row

ABLE = 0.9  # success from which a policy competes for the gentlest and the fastest capture
RULES = (
    "Ranked by the kept-attitude score: the mean over all episodes of captured / (1 + peak attitude / 1 deg),"
    " so that a failure counts 0 and a capture that never turns the satellite 1.",
    "Attitude, cost, time and errors are over captures alone, whose number stands in a column of its own; "
    "hold, random and policies without a capture have no rank and are never marked best.",
    "The eq. 20 cost falls with slowness: the same path in twice the time costs half. Cost x duration, with "
    "the time until the envelope is entered, does not.",
)  # stand under every table
NOTE = (
    f"Brackets: {100 * CONFIDENCE:.0f} % intervals (Wilson for rates, stratified bootstrap for the others, "
    "both together for the score). Figures over captures are interquartile means, the time to capture is the "
    "median; of policies that captured different goals, they are of different goals. Figures have the digits "
    "that their interval supports, three at most. A figure that does not exist is shown as -."
)


@dataclass(frozen=True)
class Column:
    """A column of the leaderboard: `scale` takes the figure from the record's unit to the one shown."""

    key: str
    title: str
    unit: str
    better: Literal["higher", "lower"] | None
    meaning: str
    scale: float = 1.0
    decimals: int | None = None  # None: as many as the interval supports
    priority: int = 0  # columns with larger numbers leave a narrow terminal first
    brief: bool = False  # whether the README has room for it

    @property
    def heading(self) -> str:
        """Title with its unit."""
        return f"{self.title} [{self.unit}]" if self.unit else self.title

    @property
    def share(self) -> bool:
        """Whether failures count in it: a share of all episodes, or the score."""
        return self.unit == "%" or self.key == HEADLINE

    def estimate(self, row: Row) -> Estimate:
        """The figure in the unit shown; what does not exist, and ends where there is no interval, are NaN."""
        if self.key in row.figures:
            raw = row.figures[self.key]
            return Estimate(*(self.scale * end for end in (raw.value, raw.low, raw.high)))
        if self.key in TIMINGS:
            return Estimate(row.timing[self.key], math.nan, math.nan)
        number = getattr(row, self.key)
        return Estimate(math.nan if number is None else float(number), math.nan, math.nan)

    def digits(self, estimate: Estimate) -> int:
        """Decimals with which a figure and its interval are shown."""
        return supported_decimals(estimate) if self.decimals is None else self.decimals

    def value(self, row: Row) -> str:
        """The figure alone."""
        estimate = self.estimate(row)
        return rounded(estimate.value, self.digits(estimate))

    def interval(self, row: Row) -> str:
        """`[low, high]`, or nothing where the figure has no interval."""
        return interval(self.estimate(row), self.decimals)


def interval(estimate: Estimate, decimals: int | None = None) -> str:
    """`[low, high]` with such decimals, or those supported; nothing where an end does not exist."""
    if not all(map(math.isfinite, (estimate.value, estimate.low, estimate.high))):
        return ""
    decimals = supported_decimals(estimate) if decimals is None else decimals
    return f"[{rounded(estimate.low, decimals)}, {rounded(estimate.high, decimals)}]"


def supported_decimals(estimate: Estimate) -> int:
    """Decimals that a figure's interval supports; negative to round to tens.

    The last digit shown is the first of half the interval's width, or its second where the first is 1 or 2.
    At least one significant digit of the figure is shown, and three at most; two where it has no interval.
    """
    half = (estimate.high - estimate.low) / 2
    if estimate.value == 0 or not math.isfinite(estimate.value):
        first = 0 if not 0 < half < math.inf else math.floor(math.log10(half))
        return 1 - first
    size = math.floor(math.log10(abs(estimate.value)))
    if not math.isfinite(half):
        return 1 - size
    if half <= 0:
        return 2 - size
    first = math.floor(math.log10(half))
    by_interval = -first + (half < 3 * 10.0**first)
    return min(max(by_interval, -size), 2 - size)


def rounded(value: float, decimals: int) -> str:
    """A number with such decimals, with an exponent where they are more than six; - if it is not finite."""
    if not math.isfinite(value):
        return "-"
    near = round(value, decimals)
    if near == 0:
        return "0"
    if decimals > 6 or abs(near) >= 1e6:
        return f"{near:.{max(0, math.floor(math.log10(abs(near))) + decimals)}e}"
    return f"{near:.{max(0, decimals)}f}"


def _share(key: str, meaning: str, priority: int = 0, brief: bool = False) -> Column:
    """A share of all episodes."""
    return Column(key, key, "%", "higher", meaning, 100.0, 0, priority, brief)


COLUMNS: tuple[Column, ...] = (
    Column("rank", "rank", "", "lower", "by the kept-attitude score", decimals=0, priority=-2, brief=True),
    Column(
        HEADLINE,
        "kept-attitude score",
        "",
        "higher",
        "mean of captured / (1 + peak attitude / 1 deg) over all episodes",
        priority=-1,
        brief=True,
    ),
    _share("success", "share of all episodes that captured", brief=True),
    _share("capture@5deg", "captured, at most 5 deg left at the end", priority=12),
    _share("capture@1deg", "captured, at most 1 deg left at the end", priority=9),
    _share("capture@0.1deg", "captured, at most 0.1 deg left at the end", priority=5),
    _share("kept@5deg", "captured, never turned by more than 5 deg", priority=16),
    _share("kept@1deg", "captured, never turned by more than 1 deg", priority=3, brief=True),
    _share("kept@0.1deg", "captured, never turned by more than 0.1 deg", priority=6),
    Column(
        "final_attitude",
        "final attitude",
        "deg",
        "lower",
        "of the base from where it started, at the end",
        priority=4,
        brief=True,
    ),
    Column(
        "peak_attitude",
        "peak attitude",
        "deg",
        "lower",
        "of the base from where it started, the largest",
        priority=2,
        brief=True,
    ),
    Column(
        "attitude_cost",
        "eq. 20 cost",
        "cm^2/s",
        "lower",
        "eq. 20 of shyam2020 times dt; falls with slowness",
        scale=10000.0,
        priority=8,
        brief=True,
    ),
    Column(
        "cost_times_duration",
        "cost x duration",
        "m^2",
        "lower",
        "eq. 20 cost times the time until the envelope is entered",
        priority=10,
        brief=True,
    ),
    Column("time_to_capture", "time to capture", "s", "lower", "median", priority=11, brief=True),
    Column(
        "position_error_at_capture",
        "position error at capture",
        "mm",
        "lower",
        "a policy may settle nearer later",
        scale=1000,
        priority=15,
    ),
    Column("planning_ms", "planning", "ms", "lower", "median, - without a plan", priority=7, brief=True),
    Column(
        "action_ms", "per action", "ms", "lower", "median time to choose one action", priority=13, brief=True
    ),
    Column("captures", "captures", "", None, "number of captures", decimals=0, priority=1, brief=True),
    Column("episodes", "episodes", "", None, "number of episodes", decimals=0, priority=14),
)


def column_named(name: str) -> Column:
    """The column of a key or a title; ConfigurationError with the nearest key if there is none."""
    for column in COLUMNS:
        if name in (column.key, column.title):
            return column
    raise unknown_name("column", name, [column.key for column in COLUMNS])


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
