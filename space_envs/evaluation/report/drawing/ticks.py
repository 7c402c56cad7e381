"""Axes over many powers of ten, with so few labels that none touches another.

Call these functions once the limits of the axis stand; they leave them as they are.
"""

import math
from collections.abc import Iterable, Sequence

from matplotlib.axis import Axis
from matplotlib.ticker import MaxNLocator

_WIDE = 30.0  # times the least positive value, from which on a linear axis hides it beside its zero
_NEGLIGIBLE = 1e-8  # of the largest value, below which a value is as good as zero
_ROUND = ((1, 2, 3, 5, 7), (1, 2, 5))
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def is_wide(values: Iterable[float]) -> bool:
    """Whether a linear axis would push some of the values onto its zero."""
    positive = _positive(values)
    return bool(positive) and max(positive) > _WIDE * min(positive)


def wide_scale(axis: Axis, values: Iterable[float], most: int = 5) -> None:
    """Let an axis whose lower limit is 0 go up logarithmically from the least of the values.

    Between 0 and the power of ten below that value it is linear, so that zero has its place. At most `most`
    ticks are labelled. Values that are not positive and finite are ignored; there has to be another.
    """
    start = 10.0 ** math.floor(math.log10(min(_positive(values))))
    high = axis.get_view_interval()[1]
    set_scale = axis.axes.set_xscale if axis is axis.axes.xaxis else axis.axes.set_yscale
    set_scale("symlog", linthresh=start, linscale=0.5)
    ticks = _powers(10 * start, high, most - 1)  # a label at `start` would touch that at 0
    axis.set_ticks([0.0, *ticks], labels=["0", *map(tick_label, ticks)])
    axis.set_ticks([], minor=True)
    axis.set_view_interval(0.0, high, ignore=True)


def log_ticks(axis: Axis, most: int = 5) -> None:
    """Label at most `most` ticks of a logarithmic axis, at round numbers or at powers of ten."""
    low, high = axis.get_view_interval()
    choices = (*(_multiples(low, high, round_ones) for round_ones in _ROUND), _powers(low, high, most))
    ticks = next(choice for choice in choices if len(choice) <= most)
    if len(ticks) < 2:
        steps = MaxNLocator(most - 1).tick_values(low, high)
        ticks = [step for step in steps if low <= step <= high]
    axis.set_ticks(ticks, labels=[tick_label(tick) for tick in ticks])
    axis.set_ticks([], minor=True)
    axis.set_view_interval(low, high, ignore=True)


def tick_label(value: float) -> str:
    """A positive number as short as it can be read; with a raised exponent where it has many zeros."""
    if 1e-3 <= value < 2e4:
        return f"{value:g}"
    exponent = math.floor(math.log10(value) + 1e-9)
    factor = f"{value / 10.0**exponent:.3g}"
    power = "10" + str(exponent).translate(_RAISED)
    return power if factor == "1" else f"{factor}·{power}"


def _positive(values: Iterable[float]) -> list[float]:
    """Positive values that are not negligible against the largest."""
    positive = [value for value in values if 0.0 < value < math.inf]
    return [value for value in positive if value >= _NEGLIGIBLE * max(positive)]


def _multiples(low: float, high: float, factors: Sequence[int]) -> list[float]:
    """Powers of ten times the factors, from low to high."""
    exponents = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    ticks = [factor * 10.0**exponent for exponent in exponents for factor in factors]
    return [tick for tick in ticks if low <= tick <= high]


def _powers(low: float, high: float, most: int) -> Sequence[float]:
    """Powers of ten, equally far apart, at most so many; the largest one is among them."""
    exponents = range(math.ceil(math.log10(low) - 1e-9), math.floor(math.log10(high) + 1e-9) + 1)
    stride = max(1, math.ceil(len(exponents) / most))
    return [10.0**exponent for exponent in reversed(exponents[::-1][::stride])]
