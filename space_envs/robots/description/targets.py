"""The target of a robot with two arms: a free body with a grapple point for each."""

import numpy as np

from space_envs.dynamics.rotations import Array, exponential, from_matrix
from space_envs.robots.description.tables import DescriptionTable
from space_envs.robots.inertias import box_moments, quaternion, vector
from space_envs.robots.kinematics import tool_poses
from space_envs.robots.pose import Pose
from space_envs.robots.robot import Quaternion, Robot, Target

TARGET_KEYS = ("mass", "inertia", "half_width", "body", "gripper", "position", "orientation")
MASS_SHARE = 0.25  # of the robot's satellite, by default
WIDTH_SHARE = 0.5  # of half the distance between the hands at home, by default
BODY = (0.6, 0.8, 0.75)  # half sides of the box between the grapple points, times half their distance
GRIPPER_SHARE = 0.1  # of the arm's reach that may touch the target, at most a third of the last link


def read_target(table: DescriptionTable, robot: Robot) -> Target:
    """The target of `[target]`; by default it is between the hands of the robot at home.

    Raises:
        ConfigurationError: for a value that is not valid, or hands that are at the same place.
    """
    hands = tool_poses(robot, robot.home)
    apart = hands[0].position - hands[1].position
    distance = float(np.linalg.norm(apart))
    if distance < 1e-3:
        raise table.error("the hands of both arms are at the same place at home: change 'home' or 'mount'")
    mass = table.positive("mass", MASS_SHARE * robot.satellite.inertial.mass)
    half_width = table.positive("half_width", WIDTH_SHARE * distance / 2)
    body = table.vector("body", 3, vector(half_width * np.array(BODY)))
    inertia = (
        table.moments("inertia")
        if "inertia" in table
        else box_moments(mass, vector(2 * half_width * np.array(BODY)))
    )
    last = np.linalg.norm(robot.arms[0].tool_position)
    return Target(
        mass=mass,
        inertia=inertia,
        half_width=half_width,
        body=body,
        gripper=table.positive("gripper", min(GRIPPER_SHARE * robot.reach, float(last))),
        position=table.vector("position", 3, vector((hands[0].position + hands[1].position) / 2)),
        orientation=table.vector("orientation", 4, _between(hands, apart / distance, robot.planar)),
    )


def _between(hands: list[Pose], toward_first: Array, planar: bool) -> Quaternion:
    """Orientation of a target whose grapple points face the hands."""
    if planar:  # arm 1 grapples on -y
        angle = float(np.arctan2(toward_first[0], -toward_first[1]))
        return quaternion(exponential(np.array([0.0, 0.0, angle])))
    x = toward_first
    up = np.eye(3)[int(np.argmin(np.abs(x)))]
    z = np.cross(x, up) / np.linalg.norm(np.cross(x, up))
    return quaternion(from_matrix(np.stack([x, np.cross(z, x), z], axis=1)))
