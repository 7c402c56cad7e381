"""Matrix of the probabilities that one policy is better than another."""

import math
from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.colors import to_rgba
from matplotlib.patches import Rectangle

from space_envs.evaluation.leaderboard.columns import column_named
from space_envs.evaluation.leaderboard.comparison import (
    Improvement,
)
from space_envs.evaluation.leaderboard.figures import HEADLINE
from space_envs.evaluation.leaderboard.row import Row
from space_envs.evaluation.records.names import display_name, figure_name
from space_envs.evaluation.report.drawing.look import BLUE, ORANGE
from space_envs.evaluation.report.drawing.panel import LONE, draw_panel
from space_envs.evaluation.report.plots.plot import Plot
from space_envs.evaluation.report.tables.wording import row_name

FEW_POLICIES = 8  # policies up to which a cell of the matrix has room for its interval
_NAMES = 95.0  # points beside the matrix for the names of its rows


def improvement_plot(rows: Sequence[Row], metric: str, found: Improvement) -> Plot | None:
    """Probability that each policy is better than each other one; None where no two can be compared.

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
    roomy = count <= FEW_POLICIES
    cell = (72 * LONE - _NAMES) / count  # points
    small = min(7.0, 0.18 * cell)  # of characters, nine of which have to fit

    def lines(i: int, j: int) -> list[tuple[str, float, str]]:
        """Text, size and weight of each line of a cell."""
        if not math.isfinite(value[i, j]):
            return [("-", 8, "normal")]
        size = 10 if roomy else min(10.0, 0.42 * cell)  # of bold characters, three of which have to fit
        texts = [(f"{100 * value[i, j]:.0f}", size, "bold" if better[i, j] or worse[i, j] else "normal")]
        texts += [(f"{100 * low[i, j]:.0f} to {100 * high[i, j]:.0f}", small, "normal")] if roomy else []
        return texts + ([(f"of {goals[i, j]}", min(7.0, 0.28 * cell), "normal")] if cost else [])

    def draw(axes: Axes) -> None:
        squares, faces = [], []
        for i, j in zip(*np.nonzero(~np.eye(count, dtype=bool)), strict=True):
            texts = lines(i, j)
            for number, (text, size, weight) in enumerate(texts):
                height = i + (number - 0.5 * (len(texts) - 1)) * 0.9 / len(texts)
                axes.text(j, height, text, ha="center", va="center", size=size, weight=weight)
            if math.isfinite(value[i, j]):
                squares.append(Rectangle((j - 0.47, i - 0.47), 0.94, 0.94))
                # See-through colors keep the numbers readable on light and on dark pages.
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
