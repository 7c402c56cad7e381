"""Files that were made for one robot, such as libraries of motions, found again by the robot's digest.

Those of the built-in robots ship with the project. Those of any other robot lie in a folder named after its
digest, in SPACE_ENVS_ROBOTS or else in the user's cache. Next to each is a JSON file of the same name, which
says for which robot and how it was made.
"""

import os
import shlex
from collections.abc import Mapping
from functools import lru_cache
from importlib.resources import files
from pathlib import Path
from typing import Any

from space_envs.codegen.cache import cache_folder
from space_envs.errors import ConfigurationError
from space_envs.robots.robot import Robot
from space_envs.robots.zoo import found_as
from space_envs.system.files import write_json
from space_envs.system.reading import read_object

VARIABLE = "SPACE_ENVS_ROBOTS"
SHIPPED = "robots.json"  # digests of the robots whose files ship, with their names
_DATA = files("agents") / "data"
_DIGITS = 32  # of a digest, in the name of a folder


def robot_folder(robot: Robot) -> Path:
    """Folder of the files that a user makes for a robot."""
    chosen = os.environ.get(VARIABLE)
    root = Path(chosen).absolute() if chosen else cache_folder() / "robots"
    return root / robot.digest[:_DIGITS]


def robot_file(robot: Robot, name: str) -> Path | None:
    """Path of a file that was made for a robot, shipped or by the user; None if there is none.

    Raises:
        ConfigurationError: if what is in the robot's folder was made for another robot.
    """
    if robot.digest in shipped_robots() and (path := shipped_file(name)).exists():
        return path
    path = robot_folder(robot) / name
    if not path.exists():
        return None
    check_robot(path, robot)
    return path


def shipped_file(name: str) -> Path:
    """Path of a file that ships with the project, whether or not it is there."""
    return Path(str(_DATA)) / name


@lru_cache(maxsize=1)
def shipped_robots() -> Mapping[str, str]:
    """Names of the robots whose files ship, by their digests."""
    return read_object(shipped_file(SHIPPED))


def robot_options(robot: Robot) -> str:
    """Options of commands that lead to a robot; with its own name where it was made in Python."""
    source, variant = found_as(robot) or (robot.name, None)
    return f"--robot {shlex.quote(source)}" + ("" if variant is None else f" --variant {variant}")


def described_robot(robot: Robot) -> dict[str, str]:
    """Name, variant and digest of a robot, as files hold them."""
    return {"name": robot.name, "variant": robot.variant, "digest": robot.digest}


def variant_name(robot: Robot) -> str:
    """Name of a robot and, in brackets, of its variant."""
    return f"{robot.name} ({robot.variant})"


def write_origin(path: Path, robot: Robot, origin: Mapping[str, Any]) -> None:
    """Write for which robot and how a file was made, next to it."""
    write_json(path.with_suffix(".json"), {"robot": described_robot(robot), **origin})


def check_robot(path: Path, robot: Robot) -> None:
    """Refuse a file that was made for another robot.

    Raises:
        ConfigurationError: naming both robots, or that it is not known for which one the file was made.
    """
    beside = path.with_suffix(".json")  # holds its origin
    refuse_other_robot(str(path), read_object(beside).get("robot") if beside.exists() else None, robot)


def refuse_other_robot(what: str, made: Any, robot: Robot) -> None:
    """Refuse something that was made for a robot with another digest.

    Args:
        what: it is. made: what it says of its robot, as `described_robot` gives it.

    Raises:
        ConfigurationError: naming both robots, or that it is not known for which one it was made.
    """
    if not isinstance(made, dict) or not {"name", "variant", "digest"} <= made.keys():
        raise ConfigurationError(f"{what} does not say for which robot it was made")
    if made["digest"] != robot.digest:
        raise ConfigurationError(
            f"{what} was made for the robot {in_words(made)}, not for {in_words(described_robot(robot))}"
        )


def in_words(robot: Mapping[str, Any]) -> str:
    """Name, variant and first digits of the digest of a robot."""
    return f"{robot['name']} ({robot['variant']}, {str(robot['digest'])[:12]})"
