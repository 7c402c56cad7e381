"""A plot of the report, and axes that several plots share."""

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.axes import Axes

from space_envs.evaluation.leaderboard.columns import column_named
from space_envs.evaluation.report.drawing.panel import Panel
from space_envs.evaluation.report.drawing.ticks import is_wide, wide_scale
from space_envs.evaluation.report.templating import display_unit


@dataclass(frozen=True)
class Plot:
    """A figure of the report: panels side by side, or below each other on a narrow page."""

    key: str
    title: str
    caption: str
    panels: tuple[Panel, ...]


def heading_of(key: str) -> str:
    """Label of an axis for a figure of the leaderboard."""
    return display_unit(column_named(key).heading)


def start_at_zero(axes: Axes, values: Sequence[float]) -> None:
    """Start the horizontal axis at 0; logarithmic above the least value where they differ by much."""
    if is_wide(values):
        axes.set_xlim(left=0.0)
        wide_scale(axes.xaxis, values)
    else:
        axes.set_xlim(left=-0.03 * axes.get_xlim()[1])
