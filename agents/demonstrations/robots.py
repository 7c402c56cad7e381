"""The robot that a command makes demonstrations or libraries of."""

import argparse

from agents.planners.common.robot_files import shipped_robots
from space_envs.errors import ConfigurationError
from space_envs.robots.robot import Robot
from space_envs.tasks.single_arm import SingleArmTask


def add_robot_options(parser: argparse.ArgumentParser) -> None:
    """Add `--robot` and `--variant`."""
    text = (
        "name of a robot with one arm, or its description file (default: that of SpaceCapture/SingleArm-v0)"
    )
    parser.add_argument("--robot", metavar="NAME_OR_FILE", help=text)
    parser.add_argument("--variant", metavar="NAME", help="of the robot's inertias (default: its first)")


def chosen_robot(options: argparse.Namespace) -> Robot:
    """The robot that the options name.

    Raises:
        ConfigurationError: if it is not found, its description is not valid, or it has two arms.
    """
    robot = SingleArmTask(robot=options.robot, variant=options.variant).robot
    if len(robot.arms) != 1:
        raise ConfigurationError(f"demonstrations are of robots with one arm, {robot.name!r} has two")
    return robot


def print_use(robot: Robot) -> None:
    """Print whether policies use what a command made."""
    if robot.digest in shipped_robots():
        print(f"policies go on using the files that ship with the project for {robot.name}")
