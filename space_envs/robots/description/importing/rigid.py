"""Rigid parts of a robot file: bodies that are fixed to the root or to a link, with locked joints."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from space_envs.robots.description.importing.files.tree import HINGE, SLIDE, FileJoint, FileTree, Shape
from space_envs.robots.inertias import combined, moved, rounded
from space_envs.robots.pose import Pose
from space_envs.robots.robot import Inertial


@dataclass(frozen=True)
class Placed:
    """A body of a file in the frame of what carries it.

    Attributes:
        carrier: place of the root, or of the body whose joint moves it. pose: in the carrier's link frame,
            whose origin lies on the joint's axis.
    """

    carrier: int
    pose: Pose


@dataclass(frozen=True)
class RigidParts:
    """Bodies of a file below a root, as rigid parts.

    Attributes:
        tree: the file. root: place of the body that is fixed to the satellite. values: of locked joints.
        moving: names of the joints that move.
        placed: bodies by place. frames: pose of a link's frame in the part that carries it, at joint angle
            zero, by the place of the body with the joint.
    """

    tree: FileTree
    root: int
    placed: Mapping[int, Placed]
    frames: Mapping[int, Placed]
    values: Mapping[str, float]
    moving: Collection[str]

    def value(self, joint: FileJoint) -> float:
        """Value that a joint which does not move is fixed at."""
        return value_of(self.tree, joint, self.values)

    def members(self, carrier: int) -> Iterator[tuple[int, Pose]]:
        """Bodies of a rigid part, with their poses in it."""
        for body, placed in self.placed.items():
            if placed.carrier == carrier:
                yield body, placed.pose

    def inertial(self, carrier: int) -> Inertial | None:
        """Mass properties of a rigid part; None if nothing in it has mass."""
        found = [
            moved(inertial, *pose)
            for body, pose in self.members(carrier)
            if (inertial := self.tree.bodies[body].inertial) is not None
        ]
        return rounded(combined(found)) if any(body.mass for body in found) else None

    def shapes(self, carrier: int) -> list[Shape]:
        """Geometry of a rigid part, in its frame."""
        return [
            _moved_shape(shape, pose)
            for body, pose in self.members(carrier)
            for shape in self.tree.bodies[body].shapes
        ]


def assemble(tree: FileTree, root: int, moving: Collection[str], values: Mapping[str, float]) -> RigidParts:
    """The rigid parts below a root, whose own joint is left out.

    Args:
        moving: names of the joints that move. values: of the others, rad or m; where there is none, that of
            the file's pose, or the nearest in the range.
    """
    placed, frames = {root: Placed(root, Pose.of())}, {}
    scenery = _scenery(tree, moving) if root == 0 else []
    for place, body in enumerate(tree.bodies):
        if body.parent not in placed or place == root or place in scenery:
            continue
        above = placed[body.parent]
        carrier, pose = above.carrier, above.pose @ body.pose
        for joint in body.joints:
            anchor = Pose.of(joint.at)
            if joint.name in moving:
                frames[place] = Placed(carrier, pose @ anchor @ Pose.about(joint.axis, -joint.zero))
                carrier, pose = place, anchor.inverse
            else:
                pose = pose @ _displacement(joint, value_of(tree, joint, values))
        placed[place] = Placed(carrier, pose)
    return RigidParts(tree, root, placed, frames, values, moving)


def _scenery(tree: FileTree, moving: Collection[str]) -> list[int]:
    """Bodies of the world of MJCF that carry none of the joints that move."""
    if tree.format == "urdf":
        return []
    robots = {
        tree.path_to(place)[1]
        for place, body in enumerate(tree.bodies)
        if any(joint.name in moving for joint in body.joints)
    }
    return [place for place in tree.children(0) if place not in robots]


def value_of(tree: FileTree, joint: FileJoint, values: Mapping[str, float]) -> float:
    """Value that a joint which does not move is fixed at."""
    if joint.name in values:
        return values[joint.name]
    joints = tree.joints
    if joint.mimic is not None and joint.mimic.leader in joints:
        leader = joints[joint.mimic.leader]
        if leader.mimic is None:
            return joint.mimic.multiplier * value_of(tree, leader, values) + joint.mimic.offset
    low, high = joint.range or (joint.zero, joint.zero)
    return float(np.clip(joint.zero, low, high))


def _displacement(joint: FileJoint, value: float) -> Pose:
    """Motion of a body by a joint from its pose in the file; none for joints of other kinds."""
    if joint.kind == SLIDE:
        return Pose.of(joint.axis * (value - joint.zero))
    if joint.kind == HINGE:
        anchor = Pose.of(joint.at)
        return anchor @ Pose.about(joint.axis, value - joint.zero) @ anchor.inverse
    return Pose.of()


def _moved_shape(shape: Shape, pose: Pose) -> Shape:
    place = pose @ Pose.of(shape.visual.position, shape.visual.orientation)
    return shape._replace(visual=replace(shape.visual, position=place.vector, orientation=place.quaternion))
