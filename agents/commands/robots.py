"""The options of commands that choose a robot."""

import argparse
import os
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from space_envs.robots.zoo import is_path, robot_names


def add_robot(add: Callable[..., Any]) -> None:
    """Add `--robot` and `--variant` to a command line, whose `add_argument` is given."""
    what = (
        f"its description file, or one of {', '.join(robot_names())} (default: the robot of each id); "
        "docs/own_robot.md tells how to bring your own"
    )
    add("--robot", metavar="NAME|FILE", help=what)
    add(
        "--variant", metavar="NAME", help="of the robot's inertias, if there are several (default: the first)"
    )


def robot_words(keywords: Mapping[str, Any]) -> str:
    """Robot and variant that were chosen, as the end of a sentence; empty for the robot of each id."""
    return "".join(f", {name} {Path(value).name}" for name, value in keywords.items())


def robot_keywords(options: argparse.Namespace) -> dict[str, Any]:
    """Keywords of a task that the two options set; a file has its absolute path."""
    given = {"robot": options.robot, "variant": options.variant}
    return with_absolute_path({name: value for name, value in given.items() if value is not None})


def with_absolute_path(keywords: Mapping[str, Any]) -> dict[str, Any]:
    """Keywords of a task; a robot's file has its absolute path, as other processes and folders need it."""
    robot = keywords.get("robot")
    if isinstance(robot, str) and is_path(robot):
        return {**keywords, "robot": os.path.abspath(os.path.expanduser(robot))}
    return dict(keywords)
