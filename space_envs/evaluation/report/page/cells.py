"""Cells of the table: a figure, its interval, and where both are drawn."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from space_envs.evaluation.leaderboard.columns import Column
from space_envs.evaluation.leaderboard.row import Row


class CellScale(NamedTuple):
    """Ends of the scale that a column's figures are drawn on."""

    start: float
    end: float
    logarithmic: bool = False

    def place(self, value: float) -> float:
        """Percent of the distance from start to end; values beyond them, and NaN, are put at the ends."""
        if math.isnan(value):
            return 0.0
        value, start, end = min(max(value, self.start), self.end), self.start, self.end
        if self.logarithmic:
            value, start, end = (math.log(each) for each in (value, start, end))
        return 100 * (value - start) / (end - start)


def column_scale(column: Column, rows: Sequence[Row]) -> CellScale | None:
    """Scale of a column; None where no figure has an interval."""
    if column.unit == "%":
        return CellScale(0.0, 100.0)
    estimates = [column.estimate(row) for row in rows]
    if all(math.isnan(estimate.low) for estimate in estimates):
        return None
    values = [end for e in estimates for end in (e.value, e.low, e.high) if math.isfinite(end)]
    if not values or max(values) <= 0:
        return None
    positive = [value for value in values if value > 0]
    if max(positive) > 30 * min(positive):
        return CellScale(0.8 * min(positive), 1.05 * max(positive), logarithmic=True)
    return CellScale(0.0, 1.05 * max(values))


def make_cell(column: Column, row: Row, best: bool, scale: CellScale | None) -> dict[str, Any]:
    """Figure and interval as text, and their places in percent of the cell's width."""
    estimate = column.estimate(row)
    marks = None
    if scale and math.isfinite(estimate.value):
        value, low, high = map(scale.place, (estimate.value, estimate.low, estimate.high))
        marks = {"value": f"{value:.1f}", "low": f"{low:.1f}", "width": f"{max(high - low, 0):.1f}"}
    return {
        "value": column.value(row),
        "interval": column.interval(row),
        "best": best,
        # A figure that does not exist is sorted last in either order.
        "sort": repr(estimate.value) if math.isfinite(estimate.value) else "",
        "bar": marks if column.unit == "%" else None,
        "marks": None if column.unit == "%" else marks,
    }
