"""Figures of methods that planned the same case.

A record's `methods` holds the figures by method, or `cause` and `reason` where a method found no plan.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import numpy as np

from reproduce.claims import CaseRecord
from space_envs.dynamics.rotations import Array


def figures_of(record: CaseRecord, key: str) -> Mapping[str, Any] | None:
    """Figures of a method; None where it found no plan."""
    found = record["methods"][key]
    return None if "cause" in found else found


def ratio(record: CaseRecord, name: str, key: str, *others: str) -> float | None:
    """A figure of one method over the least of the others'; None where one of them found no plan."""
    found = [figures_of(record, each) for each in (key, *others)]
    values = [each[name] for each in found if each]
    return values[0] / min(values[1:]) if len(values) == len(found) else None


def ratios(records: Iterable[CaseRecord], name: str, key: str, *others: str) -> Array:
    """`ratio` of every record that has one."""
    found = [ratio(record, name, key, *others) for record in records]
    return np.array([value for value in found if value is not None])


def at_most(record: CaseRecord, name: str, key: str, *others: str, bound: float) -> bool | None:
    """Whether a figure of one method is at most `bound` times the least of the others'."""
    found = ratio(record, name, key, *others)
    return None if found is None else found <= bound


def comparison(
    record: CaseRecord,
    name: str,
    key: str,
    *others: str,
    names: Mapping[str, str],
    shown: Callable[[float], str],
    unit: str,
) -> str:
    """A sentence with a figure of one method and of others, and the change against the least of them.

    Args:
        names: of the methods. shown: the figure as text, in `unit`.
    """
    values = {each: figures_of(record, each) for each in (key, *others)}
    listed = ", ".join(
        f"{names[each]} {shown(found[name]) if found else 'none'}" for each, found in values.items()
    )
    change = ratio(record, name, key, *others)
    last = "" if change is None else f": {percent(100 * (change - 1.0))} %"
    return f"{listed} {unit}{last}."


def percent(change: float) -> str:
    """Text of a change in percent with its sign: one decimal, or one digit where that would be none."""
    return f"{change:+.1f}" if abs(change) >= 0.1 else f"{change:+.1g}"


def short(value: float) -> str:
    """Text of a number with three digits, large ones without a power of ten."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"
