"""Performance profiles: share of episodes that captured with at most a cost."""

import math
from collections.abc import Mapping, Sequence
from typing import cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from space_envs.evaluation.leaderboard.columns import column_named
from space_envs.evaluation.leaderboard.comparison import (
    COSTS,
    by_entry,
    episode_costs,
    profiles,
)
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.names import display_name, figure_name
from space_envs.evaluation.report.drawing.look import Look
from space_envs.evaluation.report.drawing.panel import Panel, draw_panel
from space_envs.evaluation.report.drawing.ticks import log_ticks
from space_envs.evaluation.report.plots.plot import Plot, heading_of
from space_envs.evaluation.report.tables.wording import row_name
from space_envs.evaluation.report.templating import display_unit
from space_envs.evaluation.statistics.intervals import Estimates

_POINTS = 81  # of a profile


def profiles_plot(
    rows: Sequence[Row],
    records: Sequence[EpisodeRecord],
    looks: Mapping[str, Look],
    generator: np.random.Generator,
    resamples: int = 2000,
) -> Plot | None:
    """Share of episodes that captured with at most a cost, against that cost; None where nobody captured."""
    panels = []
    for metric in COSTS:
        costs = np.concatenate([episode_costs(played, metric) for played in by_entry(records).values()])
        tau = _grid(costs)
        if tau is not None:
            found = profiles(records, metric, tau, generator, resamples)
            panels.append(_profile_panel(rows, metric, tau, [found[row.entry] for row in rows], looks))
    caption = (
        "Share of all episodes that captured with at most the value below; higher and more left is better. "
        "A curve ends at the policy's success. Bands are pointwise 95 % intervals. "
        "The legends are in the order of the areas under the curves."
    )
    return Plot("profiles", "Performance profiles", caption, tuple(panels)) if panels else None


def _profile_panel(
    rows: Sequence[Row],
    metric: str,
    tau: np.ndarray,
    found: Sequence[Estimates],
    looks: Mapping[str, Look],
) -> Panel:
    column = column_named(metric)
    names = [row_name(row, rows) for row in rows]
    order = sorted(range(len(rows)), key=lambda number: -found[number].value.mean())
    wide = tau[0] > 0 and tau[-1] > 30 * tau[0]

    def draw(axes: Axes) -> None:
        lines = []
        for row, name, share in zip(rows, names, found, strict=True):
            look = looks[row.policy]
            low, value, high = (100 * end for end in (share.low, share.value, share.high))
            axes.fill_between(
                column.scale * tau,
                low,
                high,
                color=look.color,
                alpha=min(0.2, 0.7 / len(rows)),
                lw=0,
            )
            lines += axes.plot(
                column.scale * tau,
                value,
                color=look.color,
                ls=look.dash,
                lw=1.8,
                label=figure_name(name),
            )
        axes.set(xscale="log" if wide else "linear", xlim=column.scale * tau[[0, -1]], ylim=(-2, 102))
        if wide:
            log_ticks(axes.xaxis)
        axes.set(xlabel=heading_of(metric), ylabel="episodes [%]")
        axes.grid()
        cast(Figure, axes.get_figure(root=True)).legend(
            handles=[lines[number] for number in order],
            loc="outside lower center",
            ncols=2,
            fontsize=8.5,
            handlelength=2.4,
            labelspacing=0.3,
        )

    middle = len(tau) // 2
    figures = ", ".join(
        f"{display_name(names[number])} {100 * found[number].value[middle]:.0f} %" for number in order
    )
    at = f"{column.scale * tau[middle]:.2g} {display_unit(column.unit)}"
    alt = f"Episodes with a {column.title} of at most {at}: {figures}"
    return draw_panel(f"profiles-{metric}", draw, alt, height=2.95 + 0.175 * math.ceil(len(rows) / 2))


def _grid(costs: np.ndarray) -> np.ndarray | None:
    """Costs at which profiles are drawn, logarithmic where they differ by much; None where there are none."""
    finite = costs[np.isfinite(costs)]
    if not finite.size:
        return None
    positive = finite[finite > 0]
    # One value next to zero must not push all others to the side.
    least = np.quantile(positive, 0.005, method="lower") if positive.size else 0.0
    most = finite.max()
    if positive.size and most > 30 * least:
        return np.geomspace(least, most, _POINTS)
    margin = 0.04 * (most - finite.min()) or max(most, 1.0)
    return np.linspace(max(0.0, finite.min() - margin), most + margin, _POINTS)
