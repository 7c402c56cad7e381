"""Robots as plain JSON values, for files that must be read where the robot's own files are not."""

import os
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from types import NoneType, UnionType
from typing import Any, get_args, get_origin, get_type_hints

from space_envs.checks import flag, number
from space_envs.errors import ConfigurationError, shown
from space_envs.robots.robot import Robot, Visual

UNCHECKED = "unchecked"  # minus infinity, which JSON has no number for


def to_plain(value: Any) -> Any:
    """A robot, or a part of one, as JSON values."""
    if isinstance(value, Path):
        return str(value)
    if is_dataclass(value):
        return {field.name: to_plain(getattr(value, field.name)) for field in fields(value)}
    if hasattr(value, "_asdict"):
        return {name: to_plain(part) for name, part in value._asdict().items()}
    if isinstance(value, tuple):
        return [to_plain(part) for part in value]
    return UNCHECKED if value == float("-inf") else value


def robot_from_plain(values: Any) -> Robot:
    """The robot of `to_plain`.

    Raises:
        ConfigurationError: for anything else.
    """
    return _read(Robot, values, "robot")


def without_missing_meshes(robot: Robot) -> Robot:
    """The robot without drawings whose files are not there; what has no others is drawn as a rod or a bus."""
    visuals = _present(robot.satellite.visuals)
    bus = robot.satellite.bus or visuals != robot.satellite.visuals
    return replace(
        robot,
        satellite=replace(robot.satellite, visuals=visuals, bus=bus),
        arms=tuple(
            replace(arm, links=tuple(replace(link, visuals=_present(link.visuals)) for link in arm.links))
            for arm in robot.arms
        ),
    )


def _present(visuals: tuple[Visual, ...]) -> tuple[Visual, ...]:
    return tuple(visual for visual in visuals if visual.mesh is None or os.path.isfile(visual.mesh))


def _read(kind: Any, value: Any, name: str) -> Any:
    """A value of a type, checked."""
    if isinstance(kind, UnionType):
        if value is None and NoneType in get_args(kind):
            return None
        return _read(next(part for part in get_args(kind) if part is not NoneType), value, name)
    if get_origin(kind) is tuple:
        return _read_tuple(get_args(kind), value, name)
    if is_dataclass(kind) or hasattr(kind, "_fields"):
        return _read_fields(kind, value, name)
    if kind is bool:
        return flag(name, value)
    if kind is float:
        return float("-inf") if value == UNCHECKED else number(name, value)
    expected = str if kind is Path else kind
    if not isinstance(value, expected) or isinstance(value, bool):
        raise ConfigurationError(f"{name} must be of type {expected.__name__}, got {shown(value)}")
    return kind(value)


def _read_tuple(kinds: tuple[Any, ...], value: Any, name: str) -> tuple[Any, ...]:
    if not isinstance(value, list) or (kinds[-1] is not Ellipsis and len(value) != len(kinds)):
        raise ConfigurationError(f"{name} must be a list of the right length, got {shown(value)}")
    each = [kinds[0]] * len(value) if kinds[-1] is Ellipsis else kinds
    return tuple(
        _read(kind, part, f"{name}[{place}]")
        for place, (kind, part) in enumerate(zip(each, value, strict=True))
    )


def _read_fields(kind: Any, value: Any, name: str) -> Any:
    hints = get_type_hints(kind)
    if not isinstance(value, Mapping) or set(value) != set(hints):
        raise ConfigurationError(f"{name} must have {', '.join(hints)}, got {shown(value)}")
    return kind(**{key: _read(hint, value[key], f"{name}.{key}") for key, hint in hints.items()})
