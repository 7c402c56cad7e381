"""Plot of the kept-attitude score against the time to the first action."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import NamedTuple

import matplotlib
from matplotlib.axes import Axes

from space_envs.evaluation.leaderboard.pareto import FRONT, Standing, pareto_front
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.records.names import display_name, figure_name
from space_envs.evaluation.report.drawing.labels import label_points
from space_envs.evaluation.report.drawing.look import Look
from space_envs.evaluation.report.drawing.panel import INK, LONE, draw_panel
from space_envs.evaluation.report.drawing.ticks import log_ticks
from space_envs.evaluation.report.plots.improvement import FEW_POLICIES
from space_envs.evaluation.report.plots.plot import Plot
from space_envs.evaluation.report.tables.wording import row_name


class ParetoPoint(NamedTuple):
    """Policy in the plot of the Pareto front."""

    name: str
    look: Look
    standing: Standing

    @property
    def missing(self) -> float:
        """One minus its score."""
        return 1 - self.standing.score


def pareto_plot(rows: Sequence[Row], looks: Mapping[str, Look]) -> Plot | None:
    """One minus the kept-attitude score against the time to the first action, both logarithmic; None where
    nothing that captured was timed."""
    names, standings = [row_name(row, rows) for row in rows], pareto_front(rows)
    points = [
        ParetoPoint(name, looks[standing.entry.policy], standing)
        for name, standing in zip(names, standings, strict=True)
        if 0 < standing.wait < math.inf and standing.score > 0
    ]
    if not points:
        return None
    by_name = {row.entry: display_name(name) for row, name in zip(rows, names, strict=True)}
    left = [by_name[each.entry] for each in standings if each.score > 0 and not math.isfinite(each.wait)]
    caption = (
        f"{FRONT} Filled and joined: the front. Larger marks capture more; those with failures have their "
        "success next to them. Lower and more left is better. A triangle at the lower edge: nothing missing."
        + (f" Not timed and not shown: {', '.join(left)}." if left else "")
    )
    panel = draw_panel("pareto", partial(_draw, points), _alt(points, by_name), width=LONE, height=4.6)
    return Plot("pareto", "Kept-attitude score and planning time", caption, (panel,))


def _draw(points: Sequence[ParetoPoint], axes: Axes) -> None:
    floor = min([0.1, *(point.missing for point in points if point.missing > 0)]) / 4
    axes.set_xscale("log")
    axes.set_yscale("log")
    labels, joined = [], []
    for point in points:
        name, look, standing = point
        height = max(point.missing, floor)
        axes.plot(
            standing.wait,
            height,
            look.marker if point.missing > 0 else "v",
            ms=4 + 6 * standing.success,
            color=look.color,
            mfc=look.color if standing.on_front else "none",
            mew=1.6,
            zorder=3,
        )
        joined += [(standing.wait, height)] if standing.on_front else []
        success = "" if standing.success > 0.995 else f" {100 * standing.success:.0f} %"
        labels.append((figure_name(name) + success, standing.wait, height))
    if len(joined) > 1:
        axes.plot(*zip(*sorted(joined), strict=True), color=INK, lw=1.1, ls=(0, (4, 2)), alpha=0.6)
    axes.margins(x=0.2, y=0.14)
    for axis in (axes.xaxis, axes.yaxis):
        log_ticks(axis, most=7)
    axes.set_xlabel("planning time and one action [ms]")
    axes.set_ylabel("1 - kept-attitude score")
    axes.grid(which="major")
    with matplotlib.rc_context({"font.size": 10 if len(labels) <= FEW_POLICIES else 8.5}):
        label_points(axes, labels)


def _alt(points: Sequence[ParetoPoint], by_name: Mapping[LeaderboardEntry, str]) -> str:
    def place(standing: Standing) -> str:
        if standing.on_front:
            return "on the front"
        if standing.dominated_by:
            return "dominated by " + ", ".join(by_name[other] for other in standing.dominated_by)
        return "not on the front"

    return "; ".join(
        f"{display_name(name)}: score {standing.score:.3g}, {standing.wait:.3g} ms, "
        f"{100 * standing.success:.0f} % captured, {place(standing)}"
        for name, _, standing in points
    )
