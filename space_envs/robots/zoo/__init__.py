"""Robots by name: those of this package, and those that a user registers."""

import os
from collections.abc import Callable
from functools import lru_cache
from importlib.resources import files
from itertools import takewhile
from pathlib import Path

from space_envs.errors import ConfigurationError, no_path, shown, unknown_name
from space_envs.robots.description.reading import read_robot
from space_envs.robots.robot import Robot, StepLimits

Source = str | Path | Robot
Measure = Callable[[Robot], StepLimits]
_FOLDER = Path(str(files("space_envs") / "robots" / "zoo"))
_SUFFIX = ".toml"
_ARM_SUFFIXES = (".urdf", ".xacro", ".xml", ".mjcf")
_SOURCES: dict[str, Path | Robot] = {file.stem: file for file in sorted(_FOLDER.glob(f"*{_SUFFIX}"))}
_FOUND: dict[str, tuple[str, str | None]] = {}  # sources and variants of robots by their digests


def robot_names() -> tuple[str, ...]:
    """Names of all robots that `find_robot` knows."""
    return tuple(_SOURCES)


def robot_summary(name: str) -> str:
    """First sentence of the comment at the beginning of a robot's description; empty if there is none.

    Raises:
        ConfigurationError: for an unknown name.
    """
    if name not in _SOURCES:
        raise unknown_name("robot", name, _SOURCES)
    source = _SOURCES[name]
    if isinstance(source, Robot):
        return f"{len(source.arms)} arm{'s' * (len(source.arms) > 1)}, {source.n_joints} joints"
    lines = takewhile(lambda line: line.startswith("#"), source.read_text(encoding="utf-8").splitlines())
    return " ".join(line.lstrip("# ") for line in lines).partition(". ")[0]


def register_robot(name: str, source: str | Path | Robot) -> None:
    """Make a robot available by name.

    Args:
        name: for `robot=` and `--robot`. source: its description file, or the robot itself.

    Raises:
        ConfigurationError: for a name that is another robot's, or a file that does not exist.
    """
    if not isinstance(name, str) or not name.strip() or is_path(name):
        raise ConfigurationError(
            f"the name of a robot is a text without / that is no file name, got {shown(name)}"
        )
    value = source if isinstance(source, Robot) else Path(source).absolute()
    if isinstance(value, Path) and not value.is_file():
        raise ConfigurationError(f"there is no file {str(value)!r}")
    if _SOURCES.get(name, value) != value:
        raise ConfigurationError(f"robot {name!r} is registered already")
    _SOURCES[name] = value


def found_as(robot: Robot) -> tuple[str, str | None] | None:
    """Name or path and variant with which `find_robot` has last found a robot in this process, if it has."""
    return _FOUND.get(robot.digest)


def find_robot(source: Source, variant: str | None = None, measure: Measure | None = None) -> Robot:
    """A robot by its name, its description file, or the robot itself.

    Args:
        source: registered name, path of a TOML file, or a robot, which is returned as it is.
        variant: of its inertias; None is its default. measure: time steps of a robot whose file gives none.

    Raises:
        ConfigurationError: for an unknown name, with the nearest one, or a file that is not valid.
    """
    if variant is not None and not isinstance(variant, str):
        raise ConfigurationError(f"variant must be the name of a variant of the robot, got {shown(variant)}")
    if isinstance(source, Robot):
        if variant not in (None, source.variant):
            raise unknown_name("model variant", variant, [source.variant])
        return source
    if not isinstance(source, str | Path):
        raise ConfigurationError(
            f"robot must be a name, a path of a TOML file or a Robot, got {shown(source)}"
        )
    if isinstance(source, Path) or is_path(source):
        path = _existing(source)
        return _noted(str(source), variant, _read(path, path.stat().st_mtime_ns, variant, measure))
    if source not in _SOURCES:
        file = f"{source}{_SUFFIX}"
        raise unknown_name("robot", source, [*_SOURCES, *([file] if os.path.isfile(file) else [])])
    found = _SOURCES[source]
    return _noted(source, variant, find_robot(found, variant, measure))


def _existing(source: str | Path) -> Path:
    """Absolute path of a description.

    Raises:
        ConfigurationError: if it is no file, with the nearest description in its folder, or an arm's.
    """
    path = Path(os.path.expanduser(source)).absolute()
    if os.path.isdir(path):
        raise ConfigurationError(f"robot: {str(path)!r} is a folder, expected a description (TOML)")
    if not os.path.isfile(path):
        near = [each.name for each in path.parent.glob(f"*{_SUFFIX}")] if os.path.isdir(path.parent) else []
        raise no_path("file", path, near)
    if path.suffix in _ARM_SUFFIXES:
        raise ConfigurationError(
            f"robot: {str(path)!r} is the file of an arm, expected a description (TOML), which says on what "
            f"satellite it stands: [satellite] mass = 100.0, size = 0.7, and [[arm]] file = {path.name!r}, "
            "mount = { position = [0.0, 0.0, 0.35] }, home = [...]"
        )
    return path


def _noted(source: str, variant: str | None, robot: Robot) -> Robot:
    _FOUND[robot.digest] = source, variant
    return robot


@lru_cache(maxsize=64)
def _read(path: Path, changed: int, variant: str | None, measure: Measure | None) -> Robot:
    return read_robot(path, variant, measure)


def is_path(text: str) -> bool:
    """Whether a text is the path of a file rather than a robot's name."""
    return text.endswith((_SUFFIX, *_ARM_SUFFIXES)) or "/" in text or "\\" in text
