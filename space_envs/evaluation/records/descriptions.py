"""Descriptions of a task's own metrics in summary.json.

Tables of results are made from them, so that nobody needs the package of the task to read its results.
"""

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, get_type_hints

from space_envs.errors import ConfigurationError
from space_envs.evaluation.records.values import abbreviated, checked
from space_envs.metric import Display, Metric


def description(metric: Metric) -> dict[str, Any]:
    """Everything about a metric but its function, as plain JSON values."""
    return {name: value for name, value in asdict(metric).items() if name != "of"}


def described_metrics(descriptions: Any) -> dict[str, tuple[Metric, ...]]:
    """Metrics by environment id, from lists of their descriptions; their functions raise.

    Raises:
        ConfigurationError: for descriptions of another shape.
    """
    if not isinstance(descriptions, Mapping) or not all(
        isinstance(own, list) for own in descriptions.values()
    ):
        raise ConfigurationError(f"metrics must be an object of lists, got {abbreviated(descriptions)}")
    return {env_id: tuple(map(_metric, own)) for env_id, own in descriptions.items()}


def _metric(values: Any) -> Metric:
    own = _fields(Metric, values, "of", "display")
    display = values.get("display")
    return Metric(
        of=_no_function, display=None if display is None else Display(**_fields(Display, display)), **own
    )


def _fields(kind: type, values: Any, *others: str) -> dict[str, Any]:
    """Checked values of the fields of a dataclass, apart from others."""
    hints = {name: hint for name, hint in get_type_hints(kind).items() if name not in others}
    if not isinstance(values, Mapping) or set(values) - set(others) != set(hints):
        raise ConfigurationError(
            f"description of a metric must have {', '.join(hints)}, got {abbreviated(values)}"
        )
    return {name: checked(name, values[name], hint, empty=True) for name, hint in hints.items()}


def _no_function(episodes: Any, task: Any) -> Any:
    raise ConfigurationError("a metric that was read from results has no function; import its task")
