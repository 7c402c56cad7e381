"""Robots in the plane: what all their frames have in common."""

from collections.abc import Sequence

import numpy as np

from space_envs.robots.description.tables import DescriptionTable
from space_envs.robots.pose import Pose
from space_envs.robots.robot import Arm, Link

_ROUNDING = 1e-9  # m, and of a unit vector


def check_plane(tables: Sequence[DescriptionTable], arms: Sequence[Arm]) -> None:
    """Reject arms that leave the plane z = 0 of the satellite.

    Raises:
        ConfigurationError: with the first joint that is not along z or is outside of the plane.
    """
    for table, arm in zip(tables, arms, strict=True):
        pose = Pose.of()
        for link in arm.links:
            pose = pose @ Pose.of(link.position, link.orientation)
            _check(table, pose, link)
        tool = pose @ Pose.of(arm.tool_position, arm.tool_orientation)
        upright = tool.point((0.0, 0.0, 1.0)) - tool.position
        if abs(tool.position[2]) > _ROUNDING or np.abs(upright - [0.0, 0.0, 1.0]).max() > _ROUNDING:
            raise table.error(
                "a planar robot has its end-effector at z = 0 with its z axis along the satellite's; here it "
                f"is at z = {tool.position[2]:.6g} m with z along {np.round(upright, 6).tolist()}"
            )


def _check(table: DescriptionTable, pose: Pose, link: Link) -> None:
    axis = pose.point(link.joint.axis) - pose.position
    if abs(abs(axis[2]) - 1.0) > _ROUNDING:
        raise table.error(
            f"a planar robot has all joints along z of the satellite; {link.joint.name!r} is along "
            f"{np.round(axis, 6).tolist()}: turn the mount, lock the joint, or leave out planar = true"
        )
    if abs(pose.position[2]) > _ROUNDING:
        raise table.error(
            f"a planar robot lies in the plane z = 0; joint {link.joint.name!r} is at z = "
            f"{pose.position[2]:.6g} m: change the mount or the offsets along z in the arm"
        )
