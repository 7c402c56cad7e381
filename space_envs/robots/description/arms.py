"""An arm as it is described, inline or by a file of its own, before it is mounted on a satellite."""

from dataclasses import dataclass

from space_envs.robots.description.shape.clouds import Cloud
from space_envs.robots.robot import (
    IDENTITY,
    ORIGIN,
    Anchor,
    Capsule,
    Inertial,
    Link,
    Quaternion,
    Vector3,
    Visual,
)


@dataclass(frozen=True)
class DescribedArm:
    """A serial chain of links.

    Attributes:
        links: from the satellite outwards; the first one's pose is in the chain's root frame.
        tool_position, tool_orientation: of the end-effector's frame, in the last link's frame.
        anchors, capsules: shape for contacts.
        solids: contact geometry of each link in its frame, for an arm without capsules.
        root: mass properties of what is fixed to the satellite, in the root frame; None if there is nothing.
        root_visuals: what is drawn of it.
        notes: sentences for the robot's user about what was assumed or left out.
    """

    links: tuple[Link, ...]
    tool_position: Vector3 = ORIGIN
    tool_orientation: Quaternion = IDENTITY
    anchors: tuple[Anchor, ...] = ()
    capsules: tuple[Capsule, ...] = ()
    solids: tuple[tuple[Cloud, ...], ...] = ()
    root: Inertial | None = None
    root_visuals: tuple[Visual, ...] = ()
    notes: tuple[str, ...] = ()
