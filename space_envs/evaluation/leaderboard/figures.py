"""Figures of a leaderboard: what each is computed from, and how it is displayed."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.metrics import Described, metrics_of
from space_envs.evaluation.statistics.scores import ATTITUDE_LIMITS
from space_envs.metric import Display, Metric

HEADLINE = "kept_attitude_score"  # what the leaderboard is ranked by
TIMINGS = ("planning_ms", "action_ms")


@dataclass(frozen=True)
class MetricFigure:
    """Figure that is made of one value of each episode.

    Attributes:
        key: its name. unit: of the values. meaning: in a clause. display: its statistic, and how it is shown.
        value: of a record, None where the episode has none.
    """

    key: str
    unit: str
    meaning: str
    display: Display
    value: Callable[[EpisodeRecord], float | None] = field(compare=False)

    @property
    def largest(self) -> bool:
        """Whether it is the largest value, which has no interval."""
        return self.display.statistic == "largest"


def cost_times_duration(record: EpisodeRecord) -> float | None:
    """Base disturbance (eq. 20) times the time until the envelope is entered, m^2; None without a capture.

    The cost of a path falls with the time that it takes, this does not: it is the least for a path that is
    run at an even pace, the square of its length in the metric of eq. 20.
    """
    cost, time = record.metrics["attitude_cost"], record.metrics["time_to_envelope"]
    return None if cost is None or time is None else cost * time


COST_TIMES_DURATION = MetricFigure(
    "cost_times_duration",
    "m^2",
    "base disturbance times the time until the envelope is entered",
    Display("disturbance x duration", "lower", unit="m^2", room="paper", priority=10, order=4),
    cost_times_duration,
)


def figures_of(
    env_id: str, names: Iterable[str] = (), described: Described = MappingProxyType({})
) -> tuple[MetricFigure, ...]:
    """Figures that are made of the metrics of an id's records, in the order of the tables.

    Args:
        names: of the records' metrics; one that nothing explains is shown as a plain number.
        described: metrics of the results' tasks, where they say so.
    """
    metrics = metrics_of(env_id, described)
    known = {metric.name for metric in metrics}
    found = [figure for metric in metrics if (figure := _figure(metric)) is not None]
    found += [_unknown(name) for name in names if name not in known]
    return tuple(sorted([*found, COST_TIMES_DURATION], key=lambda figure: figure.display.order))


def _figure(metric: Metric) -> MetricFigure | None:
    if metric.display is None:
        return None
    display = replace(metric.display, unit=metric.display.unit or metric.unit)
    return MetricFigure(metric.key, metric.unit, metric.meaning, display, _value(metric.name))


def _unknown(name: str) -> MetricFigure:
    meaning = "a metric that these results do not describe"
    return MetricFigure(name, "", meaning, Display(name.replace("_", " ")), _value(name))


def _value(name: str) -> Callable[[EpisodeRecord], float | None]:
    return lambda record: record.metrics.get(name)


def metric_values(records: Sequence[EpisodeRecord], name: str) -> NDArray[np.float64]:
    """Values (n,) of a metric of each record, +infinity where an episode has none."""
    values = (record.metrics[name] for record in records)
    return np.array([math.inf if value is None else value for value in values], dtype=np.float64)


def capture_key(limit: float) -> str:
    """Name of the figure for captures under an attitude limit [deg], such as capture@0.1deg."""
    return f"capture@{limit:g}deg"


def kept_key(limit: float) -> str:
    """Name of the figure for captures under a limit [deg] of the peak attitude, such as kept@0.1deg."""
    return f"kept@{limit:g}deg"


SHARES = ("success", *map(capture_key, ATTITUDE_LIMITS), *map(kept_key, ATTITUDE_LIMITS))
BUILT_IN = figures_of("")  # of every task
FIGURES = (HEADLINE, *SHARES, *(figure.key for figure in BUILT_IN if not figure.largest))
