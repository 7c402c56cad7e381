"""Figures as text, with the digits that their intervals support."""

import math

from space_envs.evaluation.statistics.intervals import Estimate


def interval(estimate: Estimate, decimals: int | None = None) -> str:
    """`[low, high]` with such decimals, or those supported; nothing where an end does not exist."""
    if not all(map(math.isfinite, (estimate.value, estimate.low, estimate.high))):
        return ""
    decimals = supported_decimals(estimate) if decimals is None else decimals
    return f"[{rounded(estimate.low, decimals)}, {rounded(estimate.high, decimals)}]"


def supported_decimals(estimate: Estimate) -> int:
    """Decimals that a figure's interval supports; negative to round to tens.

    The last digit shown is the first of half the interval's width, or its second where the first is 1 or 2.
    At least one significant digit of the figure is shown, and three at most; two where it has no interval.
    """
    half = (estimate.high - estimate.low) / 2
    if estimate.value == 0 or not math.isfinite(estimate.value):
        first = 0 if not 0 < half < math.inf else math.floor(math.log10(half))
        return 1 - first
    size = math.floor(math.log10(abs(estimate.value)))
    if not math.isfinite(half):
        return 1 - size
    if half <= 0:
        return 2 - size
    first = math.floor(math.log10(half))
    by_interval = -first + (half < 3 * 10.0**first)
    return min(max(by_interval, -size), 2 - size)


def rounded(value: float, decimals: int) -> str:
    """A number with such decimals, with an exponent where they are more than six; - if it is not finite."""
    if not math.isfinite(value):
        return "-"
    near = round(value, decimals)
    if near == 0:
        return "0"
    if decimals > 6 or abs(near) >= 1e6:
        return f"{near:.{max(0, math.floor(math.log10(abs(near))) + decimals)}e}"
    return f"{near:.{max(0, decimals)}f}"
