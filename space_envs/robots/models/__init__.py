"""MuJoCo models of robots."""

from space_envs.robots.models.bodies import SATELLITE, end_effectors, joint_names
from space_envs.robots.models.mechanics import robot_mechanics
from space_envs.robots.models.scene import (
    GRAPPLE,
    GRAPPLES,
    OBSTACLE,
    TARGET,
    MovingTarget,
    SceneOptions,
    robot_model,
    robot_spec,
)

__all__ = [
    "GRAPPLE",
    "GRAPPLES",
    "OBSTACLE",
    "SATELLITE",
    "TARGET",
    "MovingTarget",
    "SceneOptions",
    "end_effectors",
    "joint_names",
    "robot_mechanics",
    "robot_model",
    "robot_spec",
]
