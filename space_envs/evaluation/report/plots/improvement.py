"""Matrix of the probabilities that one policy is better than another."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.colors import to_rgba
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

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


@dataclass(frozen=True, eq=False)
class ImprovementMatrix:
    """Probabilities (p, p) that the row's policy is better than the column's, as cells of a plot.

    Attributes:
        names: of the p policies. value, low, high: (p, p) probabilities, NaN where nothing can be compared.
        goals: (p, p) int, number of goals that are compared; shown where `cost`, since failures have no cost.
    """

    names: Sequence[str]
    value: NDArray[np.float64]
    low: NDArray[np.float64]
    high: NDArray[np.float64]
    goals: NDArray[np.int64]
    cost: bool

    @property
    def roomy(self) -> bool:
        """Whether cells have room for their intervals."""
        return len(self.names) <= FEW_POLICIES

    @property
    def lines(self) -> int:
        """Number of lines of a cell."""
        return 1 + self.roomy + self.cost

    def cell(self, i: int, j: int) -> list[tuple[str, float, str]]:
        """Text, size in points and weight of each line of a cell."""
        value, low, high = (100 * float(end[i, j]) for end in (self.value, self.low, self.high))
        if not math.isfinite(value):
            return [("-", 8, "normal")]
        width = (72 * LONE - _NAMES) / len(self.names)  # points
        # Of bold characters three have to fit, of small ones nine.
        size, small = 10 if self.roomy else min(10.0, 0.42 * width), min(7.0, 0.18 * width)
        texts = [(f"{value:.0f}", size, "bold" if low > 50 or high < 50 else "normal")]
        texts += [(f"{low:.0f} to {high:.0f}", small, "normal")] if self.roomy else []
        return texts + ([(f"of {self.goals[i, j]}", min(7.0, 0.28 * width), "normal")] if self.cost else [])

    def draw(self, axes: Axes) -> None:
        """Draw all cells; the diagonal is empty."""
        count = len(self.names)
        squares, faces = [], []
        for i, j in zip(*np.nonzero(~np.eye(count, dtype=bool)), strict=True):
            texts = self.cell(i, j)
            for number, (text, size, weight) in enumerate(texts):
                height = i + (number - 0.5 * (len(texts) - 1)) * 0.9 / len(texts)
                axes.text(j, height, text, ha="center", va="center", size=size, weight=weight)
            if math.isfinite(self.value[i, j]):
                squares.append(Rectangle((j - 0.47, i - 0.47), 0.94, 0.94))
                # See-through colors keep the numbers readable on light and on dark pages.
                strength = 1.2 * abs(float(self.value[i, j]) - 0.5)
                faces.append(to_rgba(BLUE if self.value[i, j] > 0.5 else ORANGE, strength))
        axes.add_collection(PatchCollection(squares, facecolors=faces, edgecolors="none"))
        labels = [figure_name(name) for name in self.names]
        axes.set_yticks(range(count), labels)
        axes.set_xticks(range(count), labels, rotation=90)
        axes.tick_params(length=0, labeltop=True, labelbottom=False, labelsize=10 if self.roomy else 8)
        axes.spines[:].set_visible(False)
        axes.set(xlim=(-0.5, count - 0.5), ylim=(count - 0.5, -0.5))

    def alt(self) -> str:
        """Sentence for each policy: how many others it is clearly better and worse than."""
        return "; ".join(
            f"{display_name(name)}: clearly better than {(self.low[i] > 0.5).sum()}, clearly worse than "
            f"{(self.high[i] < 0.5).sum()} of {np.isfinite(self.value[i]).sum() - 1}"
            for i, name in enumerate(self.names)
        )


def improvement_plot(rows: Sequence[Row], metric: str, found: Improvement) -> Plot | None:
    """Probability that each policy is better than each other one; None where no two can be compared.

    `found` is in the metric, one of IMPROVED. Cells of a cost have the number of goals that both captured.
    """
    count, cost, column = len(rows), metric != HEADLINE, column_named(metric)
    place = np.array([found.entries.index(row.entry) for row in rows])
    cells = np.ix_(place, place)
    value, low, high = (getattr(found.probability, end)[cells] for end in ("value", "low", "high"))
    if np.isfinite(value).sum() == count:  # the diagonal alone
        return None
    names = [row_name(row, rows) for row in rows]
    matrix = ImprovementMatrix(names, value, low, high, found.count[cells], cost)
    paired = found.paired[cells] | np.eye(count, dtype=bool)
    how = "Goal by goal" if paired.any() else "Over all pairs of episodes"
    caption = (
        f"Probability in percent that the row's policy has a better {column.title} than the column's. Bold: "
        f"the 95 % interval excludes 50. {how}, over "
        + ("those that both captured, whose number stands in each cell." if cost else "all of them.")
    )
    height = 1.3 + (0.1 + 0.15 * matrix.lines) * count
    panel = draw_panel(f"improvement-{metric}", matrix.draw, matrix.alt(), width=LONE, height=height)
    title = f"Probability of improvement: {column.title}"
    return Plot("improvement_cost" if cost else "improvement", title, caption, (panel,))
