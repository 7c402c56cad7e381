"""Metric: a number per episode, defined by one row: function, unit and display.

`space_envs.evaluation.records.metrics` has the table of the common ones. A task adds its own by a
class attribute `metrics: ClassVar[tuple[Metric, ...]]`; their keys follow the built-in ones in
its records, and their columns appear in its tables.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Literal

from space_envs.errors import ConfigurationError, unknown_name

Better = Literal["higher", "lower"]
STATISTICS = ("interquartile mean", "median", "mean", "largest")
ROOMS = ("full", "readme", "paper")
_NAME = re.compile(r"[a-z][a-z0-9_]*")
_MARKUP = re.compile(r"[\x00-\x1f\x7f|<>`$\[\]{}\\#&~]")


@dataclass(frozen=True)
class Display:
    """Figure of a metric in tables: statistic over all episodes, and format.

    Attributes:
        title: heading of its column; without one the figure is in leaderboard.csv and summary.json alone.
        better: whether a higher or a lower figure is better, None where neither is.
        statistic: one of STATISTICS; `largest` has no interval. over: episodes that it is of.
        unit, scale: shown, and the factor from the metric's unit to it; empty where it is the metric's.
        key: of the figure, where it is not the metric's name.
        decimals: None for as many as the interval supports.
        room: smallest table that has the column: the full one, that of the README, or that of a paper.
        priority: columns with larger numbers are dropped first in a narrow terminal.
        order: among the figures; those of a task stand last.
    """

    title: str = ""
    better: Better | None = None
    statistic: str = "interquartile mean"
    over: Literal["captures", "all"] = "captures"
    unit: str = ""
    scale: float = 1.0
    key: str = ""
    decimals: int | None = None
    room: str = "full"
    priority: int = 17
    order: int = 100

    def __post_init__(self) -> None:
        check_plain("title of a display", self.title)
        check_plain("unit of a display", self.unit)
        for kind, value, valid in (
            ("better", self.better or "higher", ("higher", "lower")),
            ("statistic", self.statistic, STATISTICS),
            ("over", self.over, ("captures", "all")),
            ("room", self.room, ROOMS),
        ):
            if value not in valid:
                raise unknown_name(f"{kind} of a display", value, valid)


@dataclass(frozen=True)
class Metric:
    """Number per episode, with its unit, function and display.

    Attributes:
        name: key in the records: lower case, digits and underscores.
        unit: in the records, empty for a number without one.
        meaning: in a clause, for the schema, the tables and the docs.
        of: function of K recorded episodes (`space_envs.evaluation.play.rollout.Rollout`) and their task;
            returns (K,) numbers, NaN where an episode has none.
        display: its figure in tables; None for a metric of the records alone.
        whole: whether it is a whole number, which every episode has.
        signed: whether it may be negative. optional: whether a capture may have none.
        of_captures: whether a capture has one and no other episode.
    """

    name: str
    unit: str
    meaning: str
    of: Callable[[Any, Any], Any]
    display: Display | None = None
    whole: bool = False
    signed: bool = False
    optional: bool = False
    of_captures: bool = False

    def __post_init__(self) -> None:
        check_plain("unit of a metric", self.unit)
        if not _NAME.fullmatch(self.name):
            raise ConfigurationError(
                f"a metric's name has lower-case letters, digits and underscores, got {self.name!r}"
            )

    @property
    def key(self) -> str:
        """Name of its figure in tables."""
        return (self.display and self.display.key) or self.name

    @property
    def description(self) -> str:
        """Unit and meaning in a sentence."""
        text = f"{self.unit}, {self.meaning}" if self.unit else self.meaning[:1].upper() + self.meaning[1:]
        return f"{text}; null without a capture." if self.of_captures else f"{text}."


def check_plain(kind: str, text: str) -> None:
    """Refuse text that would be markup in some table. Raises ConfigurationError."""
    if _MARKUP.search(text):
        raise ConfigurationError(f"{kind} must be plain text on one line, got {text!r}")
