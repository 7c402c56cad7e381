"""Arms of a description, mounted on their satellite."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from space_envs.errors import shown
from space_envs.robots.description.arms import DescribedArm
from space_envs.robots.description.contact_shape import explicit_shape
from space_envs.robots.description.importing.arms import imported_arms
from space_envs.robots.description.importing.files.packages import Packages
from space_envs.robots.description.inline import inline_arm
from space_envs.robots.description.satellites import read_satellite
from space_envs.robots.description.shape.contact import ContactShape, contact_shape
from space_envs.robots.description.tables import DescriptionTable
from space_envs.robots.inertias import moved, quaternion, vector
from space_envs.robots.pose import Pose
from space_envs.robots.robot import IDENTITY, ORIGIN, Arm, Satellite, Visual

POSE_KEYS = ("position", "quaternion")
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
    packages = _packages(robot)
    arms = _described(tables, packages)
    mounts = [_pose(table, "mount") for table in tables]
    pairs = list(zip(arms, mounts, strict=True))
    fixed = [moved(arm.root, *mount) for arm, mount in pairs if arm.root is not None]
    drawn = tuple(_moved(visual, mount) for arm, mount in pairs for visual in arm.root_visuals)
    body = read_satellite(satellite, fixed, drawn, packages)
    origin = Pose(np.array(body.box_centre), np.array(IDENTITY))
    built, notes = [], []
    for arm, mount in pairs:
        mounted, more = _mounted(arm, origin @ mount, body)
        built.append(mounted)
        notes += [*arm.notes, *more]
    counts = [len(arm.links) for arm in built]
    if len(set(counts)) > 1:
        raise robot.error(f"two arms need as many joints each, got {counts[0]} and {counts[1]}")
    return body, tuple(built), tuple(dict.fromkeys(notes))


def _described(tables: Sequence[DescriptionTable], packages: Packages) -> list[DescribedArm]:
    """Arms as their tables and files describe them."""
    for table in tables:
        if ("links" in table) == ("file" in table):
            raise table.error("needs either 'file', a URDF or MJCF file, or 'links', a list of tables")
    imported = iter(imported_arms([table for table in tables if "file" in table], packages))
    arms = [next(imported) if "file" in table else inline_arm(table) for table in tables]
    return [
        _with_capsules(_with_tool_offset(arm, table), table) for arm, table in zip(arms, tables, strict=True)
    ]


def _packages(robot: DescriptionTable) -> dict[str, Path]:
    """Folders of packages by name, from `[packages]`."""
    given = robot.get("packages", {})
    if not isinstance(given, Mapping) or not all(isinstance(folder, str) for folder in given.values()):
        raise robot.error(f"[packages] must be a table of folders by name, got {shown(given)}")
    return {name: robot.file.parent / folder for name, folder in given.items()}


def _with_tool_offset(arm: DescribedArm, table: DescriptionTable) -> DescribedArm:
    if "tool_offset" not in table:
        return arm
    tool = Pose(np.array(arm.tool_position), np.array(arm.tool_orientation)) @ _pose(table, "tool_offset")
    return replace(arm, tool_position=vector(tool.position), tool_orientation=quaternion(tool.orientation))


def _with_capsules(arm: DescribedArm, table: DescriptionTable) -> DescribedArm:
    if "capsules" not in table:
        return arm
    anchors, capsules = explicit_shape(table, len(arm.links), arm.tool_position)
    return replace(arm, anchors=anchors, capsules=capsules)


def _pose(table: DescriptionTable, key: str) -> Pose:
    """Pose from a table of `POSE_KEYS`."""
    pose = table.table(key, POSE_KEYS, {})
    position, orientation = pose.vector("position", 3, ORIGIN), pose.vector("quaternion", 4, IDENTITY)
    norm = float(np.linalg.norm(orientation))
    if abs(norm - 1.0) > 1e-3:
        raise pose.error(f"quaternion must be a unit one (w, x, y, z), got {shown(list(orientation))}")
    scale = norm if abs(norm - 1.0) > _UNIT else 1.0
    return Pose(np.array(position), np.array(orientation) / scale)


def _mounted(arm: DescribedArm, mount: Pose, satellite: Satellite) -> tuple[Arm, tuple[str, ...]]:
    """An arm in the satellite's frame, and notes about its contact shape."""
    first = arm.links[0]
    pose = mount @ Pose(np.array(first.position), np.array(first.orientation))
    root = replace(first, position=vector(pose.position), orientation=quaternion(pose.orientation))
    links = (root, *arm.links[1:])
    shape = ContactShape(arm.anchors, arm.capsules, ())
    if not arm.capsules:
        shape = contact_shape(links, arm.tool_position, arm.solids, satellite)
    return Arm(links, arm.tool_position, arm.tool_orientation, shape.anchors, shape.capsules), shape.notes


def _moved(visual: Visual, by: Pose) -> Visual:
    pose = by @ Pose(np.array(visual.position), np.array(visual.orientation))
    return replace(visual, position=vector(pose.position), orientation=quaternion(pose.orientation))
