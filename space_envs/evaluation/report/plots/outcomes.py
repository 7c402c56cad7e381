"""Plot of how episodes ended."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.records.names import display_name, figure_name
from space_envs.evaluation.report.drawing.look import GREEN, ORANGE, PURPLE, SKY, VERMILION
from space_envs.evaluation.report.drawing.panel import INK, LONE, draw_panel
from space_envs.evaluation.report.plots.plot import Plot
from space_envs.evaluation.report.tables.wording import row_name
from space_envs.tasks.outcome import Outcome


def outcomes_plot(rows: Sequence[Row]) -> Plot:
    """Outcomes of the episodes of each policy, as stacked bars."""
    colors = {
        Outcome.CAPTURED: GREEN,
        Outcome.TIMEOUT: SKY,
        Outcome.ATTITUDE_LOST: ORANGE,
        Outcome.DIVERGED: PURPLE,
        Outcome.COLLISION: VERMILION,
        Outcome.POLICY_ERROR: INK,
    }
    hatches = {Outcome.ATTITUDE_LOST: "//", Outcome.DIVERGED: "xx", Outcome.COLLISION: ".."}
    names = [row_name(row, rows) for row in rows]
    seen = [outcome for outcome in colors if any(row.outcomes[outcome] for row in rows)]

    def draw(axes: Axes) -> None:
        left = np.zeros(len(rows))
        for outcome in seen:
            share = np.array([100 * row.outcomes[outcome] / row.episodes for row in rows])
            axes.barh(
                range(len(rows)),
                share,
                left=left,
                height=0.62,
                color=colors[outcome],
                alpha=0.85,
                hatch=hatches.get(outcome, ""),
                edgecolor=INK if hatches.get(outcome) else colors[outcome],
                linewidth=0,
                label=outcome.label,
            )
            left += share
        axes.set_yticks(range(len(rows)), [figure_name(name) for name in names])
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.set_xlim(0, 100)
        axes.set_xlabel("episodes [%]")
        axes.tick_params(axis="y", length=0)
        axes.legend(loc="lower left", bbox_to_anchor=(0, 1), ncols=4, borderaxespad=0.2)

    alt = "; ".join(
        f"{display_name(name)}: " + ", ".join(f"{row.outcomes[o]} {o}" for o in seen if row.outcomes[o])
        for name, row in zip(names, rows, strict=True)
    )
    panel = draw_panel("outcomes", draw, alt, width=LONE, height=1.1 + 0.27 * len(rows))
    return Plot("outcomes", "How episodes ended", "Every episode counts once.", (panel,))
