"""The report's figures that set the policies of one task against each other."""

import math
from collections.abc import Mapping, Sequence
from typing import cast

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.names import display_name, figure_name
from space_envs.evaluation.report.drawing import INK, LONE, Panel, draw_panel, label_points
from space_envs.evaluation.report.figures import BLUE, ORANGE, Look, Plot, heading_of
from space_envs.evaluation.report.tables import row_name
from space_envs.evaluation.report.templating import shown_unit
from space_envs.evaluation.report.ticks import log_ticks
from space_envs.evaluation.statistics.columns import column_named
from space_envs.evaluation.statistics.comparison import (
    COSTS,
    FRONT,
    Improvement,
    Standing,
    by_entry,
    episode_costs,
    improvements,
    pareto_front,
    profiles,
)
from space_envs.evaluation.statistics.figures import HEADLINE
from space_envs.evaluation.statistics.intervals import Estimates
from space_envs.evaluation.statistics.row import Row

_POINTS = 81  # of a profile
_ROOMY = 8  # policies up to which a cell of the matrix has room for its interval
_NAMES = 95.0  # points beside the matrix for the names of its rows
IMPROVED = (HEADLINE, "attitude_cost")  # of `comparison.COMPARED`, those with a plot of who improves on whom


def comparison_plots(
    rows: Sequence[Row],
    records: Sequence[EpisodeRecord],
    shade: Mapping[str, Look],
    generator: np.random.Generator,
    resamples: int = 2000,
) -> list[Plot]:
    """Performance profiles, probabilities of improvement and Pareto front of one task.

    `rows` and `records` are of the same policies, `shade` gives each its look. A plot for which there are
    no data is left out. Raises ConfigurationError where they are of several tasks.
    """
    plots = (
        profiles_plot(rows, records, shade, generator, resamples),
        *(improvement_plot(rows, m, improvements(records, m, generator, resamples)) for m in IMPROVED),
        pareto_plot(rows, shade),
    )
    return [plot for plot in plots if plot]


def profiles_plot(
    rows: Sequence[Row],
    records: Sequence[EpisodeRecord],
    shade: Mapping[str, Look],
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
            panels.append(_profile_panel(rows, metric, tau, [found[row.entry] for row in rows], shade))
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
    shade: Mapping[str, Look],
) -> Panel:
    column = column_named(metric)
    names = [row_name(row, rows) for row in rows]
    order = sorted(range(len(rows)), key=lambda number: -found[number].value.mean())
    wide = tau[0] > 0 and tau[-1] > 30 * tau[0]

    def draw(axes: Axes) -> None:
        lines = []
        for row, name, share in zip(rows, names, found, strict=True):
            look = shade[row.policy]
            low, value, high = (100 * end for end in (share.low, share.value, share.high))
            axes.fill_between(
                column.scale * tau,
                low,
                high,
                color=look.colour,
                alpha=min(0.2, 0.7 / len(rows)),
                lw=0,
            )
            lines += axes.plot(
                column.scale * tau,
                value,
                color=look.colour,
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
    at = f"{column.scale * tau[middle]:.2g} {shown_unit(column.unit)}"
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


def improvement_plot(rows: Sequence[Row], metric: str, found: Improvement) -> Plot | None:
    """How often each policy is better than each other one; None where there are no two to compare.

    `found` is in the metric, one of IMPROVED. Cells of a cost have the number of goals that both captured.
    """
    count = len(rows)
    place = np.array([found.entries.index(row.entry) for row in rows])
    cells = np.ix_(place, place)
    value, low, high = (
        end[cells] for end in (found.probability.value, found.probability.low, found.probability.high)
    )
    if np.isfinite(value).sum() == count:  # the diagonal alone
        return None
    goals, cost = found.count[cells], metric != HEADLINE
    better, worse = low > 0.5, high < 0.5
    names = [row_name(row, rows) for row in rows]
    roomy = count <= _ROOMY
    cell = (72 * LONE - _NAMES) / count  # points
    small = min(7.0, 0.18 * cell)  # of letters, nine of which have to fit

    def lines(i: int, j: int) -> list[tuple[str, float, str]]:
        """Text, size and weight of each line of a cell."""
        if not math.isfinite(value[i, j]):
            return [("-", 8, "normal")]
        size = 10 if roomy else min(10.0, 0.42 * cell)  # of bold letters, three of which have to fit
        told = [(f"{100 * value[i, j]:.0f}", size, "bold" if better[i, j] or worse[i, j] else "normal")]
        told += [(f"{100 * low[i, j]:.0f} to {100 * high[i, j]:.0f}", small, "normal")] if roomy else []
        return told + ([(f"of {goals[i, j]}", min(7.0, 0.28 * cell), "normal")] if cost else [])

    def draw(axes: Axes) -> None:
        squares, faces = [], []
        for i, j in zip(*np.nonzero(~np.eye(count, dtype=bool)), strict=True):
            told = lines(i, j)
            for number, (text, size, weight) in enumerate(told):
                height = i + (number - 0.5 * (len(told) - 1)) * 0.9 / len(told)
                axes.text(j, height, text, ha="center", va="center", size=size, weight=weight)
            if math.isfinite(value[i, j]):
                squares.append(Rectangle((j - 0.47, i - 0.47), 0.94, 0.94))
                # See-through colours keep the numbers readable on light and on dark pages.
                strength = 1.2 * abs(float(value[i, j]) - 0.5)
                faces.append(to_rgba(BLUE if value[i, j] > 0.5 else ORANGE, strength))
        axes.add_collection(PatchCollection(squares, facecolors=faces, edgecolors="none"))
        labels = [figure_name(name) for name in names]
        axes.set_yticks(range(count), labels)
        axes.set_xticks(range(count), labels, rotation=90)
        axes.tick_params(length=0, labeltop=True, labelbottom=False, labelsize=10 if roomy else 8)
        axes.spines[:].set_visible(False)
        axes.set(xlim=(-0.5, count - 0.5), ylim=(count - 0.5, -0.5))

    alt = "; ".join(
        f"{display_name(name)}: clearly better than {better[i].sum()}, clearly worse than {worse[i].sum()} "
        f"of {np.isfinite(value[i]).sum() - 1}"
        for i, name in enumerate(names)
    )
    paired = found.paired[cells] | np.eye(count, dtype=bool)
    how = "Goal by goal" if paired.any() else "Over all pairs of episodes"
    column = column_named(metric)
    caption = (
        f"Chance in percent that the row's policy has a better {column.title} than the column's. Bold: the "
        f"95 % interval leaves out 50. {how}, over "
        + ("those that both captured, whose number stands in each cell." if cost else "all that were played.")
    )
    lined = 1 + roomy + cost
    panel = draw_panel(
        f"improvement-{metric}",
        draw,
        alt,
        width=LONE,
        height=1.3 + (0.1 + 0.15 * lined) * count,
    )
    title = f"Probability of improvement: {column.title}"
    return Plot("improvement_cost" if cost else "improvement", title, caption, (panel,))


def pareto_plot(rows: Sequence[Row], shade: Mapping[str, Look]) -> Plot | None:
    """What is missing from the best kept-attitude score against the time to the first action, both
    logarithmic; None where nothing that captured was timed."""
    names, standings = [row_name(row, rows) for row in rows], pareto_front(rows)
    shown = [
        (name, shade[standing.entry.policy], standing)
        for name, standing in zip(names, standings, strict=True)
        if 0 < standing.wait < math.inf and standing.score > 0
    ]
    if not shown:
        return None
    missing = [1 - standing.score for *_, standing in shown]
    floor = min([0.1, *(each for each in missing if each > 0)]) / 4

    def draw(axes: Axes) -> None:
        axes.set_xscale("log")
        axes.set_yscale("log")
        labels, joined = [], []
        for (name, look, standing), height in zip(shown, missing, strict=True):
            axes.plot(
                standing.wait,
                max(height, floor),
                look.marker if height > 0 else "v",
                ms=4 + 6 * standing.success,
                color=look.colour,
                mfc=look.colour if standing.on_front else "none",
                mew=1.6,
                zorder=3,
            )
            joined += [(standing.wait, max(height, floor))] if standing.on_front else []
            success = "" if standing.success > 0.995 else f" {100 * standing.success:.0f} %"
            labels.append((figure_name(name) + success, standing.wait, max(height, floor)))
        if len(joined) > 1:
            axes.plot(*zip(*sorted(joined), strict=True), color=INK, lw=1.1, ls=(0, (4, 2)), alpha=0.6)
        axes.margins(x=0.2, y=0.14)
        for axis in (axes.xaxis, axes.yaxis):
            log_ticks(axis, most=7)
        axes.set_xlabel("planning time and one action [ms]")
        axes.set_ylabel("1 - kept-attitude score")
        axes.grid(which="major")
        with matplotlib.rc_context({"font.size": 10 if len(labels) <= _ROOMY else 8.5}):
            label_points(axes, labels)

    by_name = {row.entry: display_name(name) for row, name in zip(rows, names, strict=True)}

    def place(standing: Standing) -> str:
        if standing.on_front:
            return "on the front"
        if standing.dominated_by:
            return "dominated by " + ", ".join(by_name[other] for other in standing.dominated_by)
        return "not on the front"

    alt = "; ".join(
        f"{display_name(name)}: score {standing.score:.3g}, {standing.wait:.3g} ms, "
        f"{100 * standing.success:.0f} % captured, {place(standing)}"
        for name, _, standing in shown
    )
    left = [by_name[each.entry] for each in standings if each.score > 0 and not math.isfinite(each.wait)]
    caption = (
        f"{FRONT} Filled and joined: the front. Larger marks capture more; those that miss some have their "
        "success beside them. Lower and more left is better. A triangle at the lower edge: nothing missing."
        + (f" Not timed and not shown: {', '.join(left)}." if left else "")
    )
    panel = draw_panel("pareto", draw, alt, width=LONE, height=4.6)
    return Plot("pareto", "Kept-attitude score and planning time", caption, (panel,))
