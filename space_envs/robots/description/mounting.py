"""Arms of a description, mounted on their satellite."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from space_envs.errors import shown
from space_envs.robots.description.arms import DescribedArm
from space_envs.robots.description.contact_shape import explicit_shape
from space_envs.robots.description.inline import inline_arm
from space_envs.robots.description.satellites import read_satellite
from space_envs.robots.description.tables import DescriptionTable
from space_envs.robots.inertias import moved, quaternion, vector
from space_envs.robots.kinematics import Pose
from space_envs.robots.robot import IDENTITY, ORIGIN, Arm, Satellite, Visual

MOUNT_KEYS = ("position", "quaternion")
_UNIT = 1e-9  # error of a quaternion's norm up to which it is taken as it is


def assembled(
    robot: DescriptionTable, satellite: DescriptionTable, tables: Sequence[DescriptionTable]
) -> tuple[Satellite, tuple[Arm, ...], tuple[str, ...]]:
    """The satellite with the roots of its arms, the arms, and notes for the robot's user.

    Args:
        robot: the whole description. satellite: [satellite]. tables: of the arms.

    Raises:
        ConfigurationError: for anything that is missing or not valid.
    """
    arms = [_described(table) for table in tables]
    mounts = [_mount(table) for table in tables]
    pairs = list(zip(arms, mounts, strict=True))
    fixed = [moved(arm.root, *mount) for arm, mount in pairs if arm.root is not None]
    drawn = tuple(_moved(visual, mount) for arm, mount in pairs for visual in arm.root_visuals)
    body = read_satellite(satellite, fixed, drawn)
    origin = Pose(np.array(body.box_centre), np.array(IDENTITY))
    built = tuple(_mounted(arm, origin @ mount) for arm, mount in pairs)
    counts = [len(arm.links) for arm in built]
    if len(set(counts)) > 1:
        raise robot.error(f"two arms need as many joints each, got {counts[0]} and {counts[1]}")
    return body, built, tuple(note for arm in arms for note in arm.notes)


def _described(table: DescriptionTable) -> DescribedArm:
    if ("links" in table) == ("file" in table):
        raise table.error("needs either 'file', a URDF or MJCF file, or 'links', a list of tables")
    arm = inline_arm(table)
    if "capsules" in table:
        anchors, capsules = explicit_shape(table, len(arm.links), arm.tool_position)
        arm = replace(arm, anchors=anchors, capsules=capsules)
    return arm


def _mount(table: DescriptionTable) -> Pose:
    mount = table.table("mount", MOUNT_KEYS, {})
    position, orientation = mount.vector("position", 3, ORIGIN), mount.vector("quaternion", 4, IDENTITY)
    norm = float(np.linalg.norm(orientation))
    if abs(norm - 1.0) > 1e-3:
        raise mount.error(f"quaternion must be a unit one (w, x, y, z), got {shown(list(orientation))}")
    scale = norm if abs(norm - 1.0) > _UNIT else 1.0
    return Pose(np.array(position), np.array(orientation) / scale)


def _mounted(arm: DescribedArm, mount: Pose) -> Arm:
    first = arm.links[0]
    pose = mount @ Pose(np.array(first.position), np.array(first.orientation))
    root = replace(first, position=vector(pose.position), orientation=quaternion(pose.orientation))
    return Arm((root, *arm.links[1:]), arm.tool_position, arm.tool_orientation, arm.anchors, arm.capsules)


def _moved(visual: Visual, by: Pose) -> Visual:
    pose = by @ Pose(np.array(visual.position), np.array(visual.orientation))
    return replace(visual, position=vector(pose.position), orientation=quaternion(pose.orientation))
