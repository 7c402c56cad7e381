"""Figures of methods that planned the same case, from records whose `methods` hold the figures by method, or
`cause` and `reason` where a method found no plan."""

from collections.abc import Callable, Mapping
from typing import Any

Figures = Mapping[str, Any]
Record = Mapping[str, Any]


def figures_of(record: Record, key: str) -> Figures | None:
    """Figures of a method; None where it found no plan."""
    found = record["methods"][key]
    return None if "cause" in found else found


def ratio(record: Record, key: str, others: tuple[str, ...], name: str) -> float | None:
    """A figure of one method over the least of the others'; None where one of them found no plan."""
    found = [figures_of(record, each) for each in (key, *others)]
    if not all(found):
        return None
    values = [each[name] for each in found if each]
    return values[0] / min(values[1:])


def below(key: str, others: tuple[str, ...], most: float, name: str) -> Callable[[Record], bool | None]:
    """Test whether a figure of one method is at most `most` times the least of the others'."""

    def test(record: Record) -> bool | None:
        found = ratio(record, key, others, name)
        return None if found is None else found <= most

    return test


def comparison(
    record: Record,
    key: str,
    others: tuple[str, ...],
    name: str,
    names: Mapping[str, str],
    shown: Callable[[float], str],
    unit: str,
) -> str:
    """A sentence with a figure of one method and of others, and the change against the least of them.

    Args:
        names: of the methods. shown: the figure as text, in `unit`.
    """
    values = {each: figures_of(record, each) for each in (key, *others)}
    told = ", ".join(
        f"{names[each]} {shown(found[name])}" if found else f"{names[each]} none"
        for each, found in values.items()
    )
    change = ratio(record, key, others, name)
    last = "" if change is None else f": {percent(100 * (change - 1.0))} %"
    return f"{told} {unit}{last}."


def percent(change: float) -> str:
    """A change in percent with its sign: one decimal, or one digit where that would be none."""
    return f"{change:+.1f}" if abs(change) >= 0.1 else f"{change:+.1g}"
