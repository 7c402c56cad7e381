"""Momentum-level mathematics of a robot, read from its compiled model."""

from functools import lru_cache

from space_envs.dynamics import FloatingRobot
from space_envs.robots.models.bodies import SATELLITE, end_effectors
from space_envs.robots.models.scene import robot_model
from space_envs.robots.robot import Robot


@lru_cache(maxsize=64)
def robot_mechanics(robot: Robot) -> FloatingRobot:
    """Momentum-level mathematics of a robot with all its end-effectors, shared and read-only."""
    return FloatingRobot.from_model(robot_model(robot), SATELLITE, end_effectors(robot))
