"""Poses of a robot's end-effectors in its satellite's frame, from its numbers alone."""

import numpy as np

from space_envs.dynamics.rotations import Array, exponential
from space_envs.robots.pose import Pose
from space_envs.robots.robot import Arm, Robot


def tool_poses(robot: Robot, q: Array) -> list[Pose]:
    """Pose of each end-effector in the satellite's frame at joint angles q (n,), rad."""
    return [_poses(arm, angles)[-1] for arm, angles in zip(robot.arms, _of_arms(robot, q), strict=True)]


def link_positions(robot: Robot, q: Array) -> list[Array]:
    """Origins (m + 1, 3) of the link frames and the end-effector of each arm, in the satellite's frame, m."""
    return [
        np.array([pose.position for pose in _poses(arm, angles)])
        for arm, angles in zip(robot.arms, _of_arms(robot, q), strict=True)
    ]


def _of_arms(robot: Robot, q: Array) -> list[Array]:
    ends = np.cumsum([len(arm.links) for arm in robot.arms])[:-1]
    return np.split(np.asarray(q, dtype=np.float64), ends)


def _poses(arm: Arm, angles: Array) -> list[Pose]:
    """Poses of the frames of the links and, at last, of the end-effector."""
    pose, found = Pose(np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])), []
    for link, angle in zip(arm.links, angles, strict=True):
        hinge = Pose(np.zeros(3), exponential(angle * np.array(link.joint.axis)))
        pose = pose @ Pose(np.array(link.position), np.array(link.orientation)) @ hinge
        found.append(pose)
    return [*found, pose @ Pose(np.array(arm.tool_position), np.array(arm.tool_orientation))]
