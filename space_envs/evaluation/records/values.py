"""Checks of the values in a record: Python's own types, finite, in range."""

import math
import types
from collections.abc import Collection, Mapping
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

import numpy as np

from space_envs.errors import ConfigurationError, unknown_name
from space_envs.evaluation.records.metrics import metrics_of
from space_envs.evaluation.records.timing import Timing
from space_envs.metric import Metric
from space_envs.registration import ENTRIES


def checked(name: str, value: Any, kind: Any, signed: bool = True, empty: bool = False) -> Any:
    """The value of a field as a plain Python value, also from a NumPy scalar.

    Args:
        kind: bool, int, float, str or a Literal of texts, or its union with None. signed: whether a number
            may be negative. empty: whether a text may be empty.

    Raises:
        ConfigurationError: naming the field.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, str):
        value = str.__str__(value)  # of an enumeration's member, its text
    kind, optional = plain_kind(kind)
    if optional and value is None:
        return None
    if kind is float and type(value) is int:
        value = float(value)
    if type(value) is not kind:
        raise ConfigurationError(f"{name} must be {kind.__name__}, got {abbreviated(value)}")
    if kind is float and not math.isfinite(value):
        raise ConfigurationError(f"{name} must be finite, got {value}; a value that does not exist is null")
    if kind in (int, float) and not signed and value < 0:
        raise ConfigurationError(f"{name} must not be negative, got {value}")
    if kind is str and not (empty or value):
        raise ConfigurationError(f"{name} must not be empty")
    return value


def checked_metrics(
    values: Any, env_id: str, captured: bool, taken: Collection[str]
) -> dict[str, float | int | None]:
    """Values of all metrics of an episode of an id, in the order of the records.

    Where this process does not know the id, numbers under other names may follow: metrics of its own. No name
    may be one of those that are `taken`. Raises ConfigurationError naming the metric.
    """
    if not isinstance(values, Mapping):
        raise ConfigurationError(f"metrics must be an object, got {abbreviated(values)}")
    known = {metric.name: metric for metric in metrics_of(env_id)}
    for name in values:
        if name in taken or (name not in known and env_id in ENTRIES):
            raise unknown_name("field", name, (*taken, *known))
    if missing := [name for name in known if name not in values]:
        raise ConfigurationError(f"missing field {', '.join(missing)}")
    found = {name: _checked_metric(metric, values[name], captured) for name, metric in known.items()}
    others = {name: value for name, value in values.items() if name not in known}
    return found | {name: checked(name, value, float | None) for name, value in others.items()}


def _checked_metric(metric: Metric, value: Any, captured: bool) -> float | int | None:
    found = checked(metric.name, value, int if metric.whole else float | None, metric.signed)
    if metric.of_captures and captured != (found is not None):
        raise ConfigurationError(
            f"captured is {captured} but {metric.name} is {found}; "
            "a captured episode has one, any other has none"
        )
    if captured and found is None and not metric.optional:
        raise ConfigurationError(f"a captured episode lacks {metric.name}")
    return found


def checked_timing(value: Any) -> Timing:
    """The times of a policy. Raises ConfigurationError naming the field."""
    kinds = get_type_hints(Timing)
    if not isinstance(value, Mapping) or set(value) != set(kinds):
        raise ConfigurationError(f"timing must have exactly {', '.join(kinds)}, got {abbreviated(value)}")
    found = {key: checked(f"timing.{key}", value[key], kind, signed=False) for key, kind in kinds.items()}
    return Timing(**found)  # type: ignore[typeddict-item]


def plain_kind(kind: Any) -> tuple[type, bool]:
    """The type in a union with None, and whether None may stand in its place."""
    optional = get_origin(kind) in (types.UnionType, Union)
    if optional:
        (kind,) = (option for option in get_args(kind) if option is not types.NoneType)
    return (str if get_origin(kind) is Literal else kind), optional


def abbreviated(value: Any) -> str:
    """A value for a message, cut short."""
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."
