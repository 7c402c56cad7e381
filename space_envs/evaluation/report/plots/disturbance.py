"""Plot of the base disturbance against planning time."""

import math
from collections.abc import Mapping, Sequence

from matplotlib.axes import Axes

from space_envs.evaluation.leaderboard.columns import column_named
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.records.names import display_name, figure_name
from space_envs.evaluation.report.drawing.labels import label_points
from space_envs.evaluation.report.drawing.look import Look
from space_envs.evaluation.report.drawing.panel import LONE, draw_panel
from space_envs.evaluation.report.drawing.ticks import log_ticks
from space_envs.evaluation.report.plots.plot import Plot, heading_of
from space_envs.evaluation.report.tables.wording import row_name
from space_envs.evaluation.report.templating import display_unit


def cost_plot(rows: Sequence[Row], looks: Mapping[str, Look]) -> Plot | None:
    """Base disturbance against planning time, both logarithmic; None where no row has both."""
    points = []
    for row, name in zip(rows, (row_name(row, rows) for row in rows), strict=True):
        planning, action = row.timing["planning_ms"], row.timing["action_ms"]
        wait = planning if planning > 0 else action
        if wait > 0 and math.isfinite(row.figures["attitude_cost"].value):
            points.append((name, row, wait, planning > 0))
    positive = [row.figures["attitude_cost"].value for _, row, _, _ in points]
    positive = [value for value in positive if value > 0]
    if not positive:
        return None
    floor = min(positive) / 4
    column = column_named("attitude_cost")

    def draw(axes: Axes) -> None:
        axes.set_xscale("log")
        axes.set_yscale("log")
        labels = []
        for name, row, wait, plans in points:
            cost, look = row.figures["attitude_cost"], looks[row.policy]
            value, low, high = (column.scale * max(end, floor) for end in (cost.value, cost.low, cost.high))
            if math.isfinite(low) and math.isfinite(high):
                axes.plot([wait, wait], [low, high], color=look.color, lw=5, alpha=0.35)
            marker = look.marker if cost.value > 0 else "v"
            face = look.color if plans else "none"
            axes.plot(wait, value, marker, ms=8, color=look.color, mfc=face, mew=1.8)
            labels.append((figure_name(name) + ("" if cost.value > 0 else " (0)"), wait, value))
        axes.margins(x=0.16, y=0.16)
        for axis in (axes.xaxis, axes.yaxis):
            log_ticks(axis, most=7)
        axes.set_xlabel("planning time [ms]")
        axes.set_ylabel(heading_of(column.key))
        axes.grid(which="major")
        label_points(axes, labels)

    alt = "; ".join(
        f"{display_name(name)}: {column.value(row)} {display_unit(column.unit)}, {wait:.3g} ms"
        for name, row, wait, _ in points
    )
    caption = (
        "Filled: the time to make the plan. Hollow: policies without a plan, at the time of one action. "
        "A triangle at the lower edge: none at all. Low and left is better, for policies that capture."
    )
    panel = draw_panel("cost", draw, alt, width=LONE, height=4.0)
    return Plot("cost", "Cost against planning time", caption, (panel,))
