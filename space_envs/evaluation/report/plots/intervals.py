"""Plots of figures with their intervals."""

import math
from collections.abc import Callable, Mapping, Sequence

from matplotlib.axes import Axes

from space_envs.evaluation.leaderboard.columns import column_named
from space_envs.evaluation.leaderboard.figures import HEADLINE
from space_envs.evaluation.leaderboard.normalised import SCORES, Scores
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.records.names import display_name, figure_name
from space_envs.evaluation.report.drawing.look import Look
from space_envs.evaluation.report.drawing.panel import INK, Panel, draw_panel
from space_envs.evaluation.report.plots.plot import Plot, heading_of, start_at_zero
from space_envs.evaluation.report.tables.wording import row_name
from space_envs.evaluation.statistics.intervals import Estimate


def intervals_plot(rows: Sequence[Row], looks: Mapping[str, Look]) -> Plot:
    """Score, success and final attitude with their 95 % intervals, one line for each row."""
    panels = []
    for key in (HEADLINE, "success", "final_attitude"):
        estimates = [row.figures[key] for row in rows]

        def finish(axes: Axes, key: str = key, estimates: list[Estimate] = estimates) -> None:
            if column_named(key).unit == "%":
                axes.set_xlim(-3, 103)
            else:
                start_at_zero(axes, [estimate.value for estimate in estimates])

        scale = column_named(key).scale
        panels.append(
            _interval_panel(f"intervals-{key}", heading_of(key), rows, estimates, scale, looks, finish)
        )
    caption = (
        "Dots are the figures of the table, bars their 95 % intervals. Failures count in score and success; "
        "the attitude is over captures."
    )
    return Plot("intervals", "Score, success and attitude", caption, tuple(panels))


def scores_plot(rows: Sequence[Row], scores: Scores, looks: Mapping[str, Look]) -> Plot | None:
    """Normalised scores with their 95 % intervals, one panel for each score that exists."""
    panels = []
    scored = [row for row in rows if row.entry in scores]
    for name in SCORES:
        estimates = [scores[row.entry][name].estimate for row in scored]
        found = [estimate for estimate in estimates if estimate is not None]
        if not scored or len(found) < len(scored):
            continue

        def finish(axes: Axes) -> None:
            for reference in (0.0, 1.0):
                axes.axvline(reference, color=INK, lw=0.8, ls=(0, (4, 2)))

        title = f"score in {column_named(name).title}"
        panels.append(_interval_panel(f"scores-{name}", title, scored, found, 1.0, looks, finish))
    caption = "Dashed lines: random has 0, the best expert 1. Bars are 95 % intervals. Failures count."
    return Plot("scores", "Normalised scores", caption, tuple(panels)) if panels else None


def _interval_panel(
    key: str,
    title: str,
    rows: Sequence[Row],
    estimates: Sequence[Estimate],
    scale: float,
    looks: Mapping[str, Look],
    finish: Callable[[Axes], None],
) -> Panel:
    """A dot and a bar for each row; `finish` completes the axes."""
    names = [row_name(row, rows) for row in rows]

    def draw(axes: Axes) -> None:
        for number, (row, estimate) in enumerate(zip(rows, estimates, strict=True)):
            if not math.isfinite(estimate.value):
                continue
            low, high = (scale * end for end in (estimate.low, estimate.high))
            look = looks[row.policy]
            if math.isfinite(low) and math.isfinite(high):
                axes.plot([low, high], [number, number], color=look.color, lw=5, alpha=0.35)
            axes.plot(
                scale * estimate.value, number, look.marker, color=look.color, ms=7, mew=0, clip_on=False
            )
        axes.set_yticks(range(len(rows)), [figure_name(name) for name in names])
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.set_xlabel(title)
        axes.grid(axis="x")
        finish(axes)
        axes.tick_params(axis="y", length=0)

    texts = (f"{display_name(n)} {scale * e.value:.3g}" for n, e in zip(names, estimates, strict=True))
    return draw_panel(key, draw, f"{title}: {', '.join(texts)}", height=0.75 + 0.27 * len(rows))
