"""Links of an imported arm, normalised to numbers."""

from collections.abc import Sequence

import numpy as np

from space_envs.robots.description.arms import DescribedArm
from space_envs.robots.description.importing.chain import JointChain
from space_envs.robots.description.importing.files.tree import inertial_example
from space_envs.robots.description.importing.geometry import drawings, solid_clouds
from space_envs.robots.description.importing.notes import drawing_notes
from space_envs.robots.description.importing.plausible import check_offset, checked_link
from space_envs.robots.description.importing.rigid import RigidParts
from space_envs.robots.robot import Joint, Link, Visual


def described_arm(
    parts: RigidParts, chain: JointChain, joints: Sequence[Joint], contacts: bool
) -> DescribedArm:
    """An arm with its first link in the root's frame, without the root.

    Args:
        contacts: whether its contact geometry is used.

    Raises:
        ConfigurationError: for links without mass, offsets that no arm has, and meshes that cannot be read.
    """
    links, solids, missing = [], [], []
    for body, joint in zip(chain.moving, joints, strict=True):
        shapes = parts.shapes(body)
        visuals, problems = drawings(shapes)
        links.append(_link(parts, body, joint, visuals))
        solids.append(tuple(solid_clouds(links[-1].name, shapes)) if contacts else ())
        missing += problems
    tool = parts.placed[chain.tool.body].pose @ chain.tool.pose
    return DescribedArm(
        tuple(links), tool.vector, tool.quaternion, solids=tuple(solids), notes=tuple(drawing_notes(missing))
    )


def _link(parts: RigidParts, body: int, joint: Joint, visuals: tuple[Visual, ...]) -> Link:
    name = parts.tree.bodies[body].name
    inertial = parts.inertial(body)
    inertial = checked_link(name, joint.name, inertial, inertial_example(parts.tree.format))
    pose = parts.frames[body].pose
    check_offset(joint.name, float(np.linalg.norm(pose.position)))
    return Link(name, pose.vector, pose.quaternion, joint, inertial, visuals)
