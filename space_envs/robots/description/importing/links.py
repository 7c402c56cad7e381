"""Links of an imported arm, normalised to numbers."""

from collections.abc import Sequence

import numpy as np

from space_envs.robots.description.importing.chain import Chain
from space_envs.robots.description.importing.geometry import drawings, solid_clouds
from space_envs.robots.description.importing.plausible import check_link, check_offset
from space_envs.robots.description.importing.rigid import Assembly
from space_envs.robots.description.importing.source import ArmSource
from space_envs.robots.description.shape.contact import ContactShape, contact_shape
from space_envs.robots.pose import Pose
from space_envs.robots.robot import Arm, Joint, Link, Vector3


def arm_of(
    assembly: Assembly, chain: Chain, joints: Sequence[Joint], source: ArmSource, box: Vector3
) -> tuple[Arm, list[str]]:
    """An arm with its first link in the satellite's own frame, and notes.

    Raises:
        ConfigurationError: for links without mass, offsets that no arm has, and meshes that cannot be read.
    """
    links, notes = [], []
    for body, joint in zip(chain.moving, joints, strict=True):
        link, problems = _link(assembly, body, joint, source)
        links.append(link)
        notes += problems
    tool = assembly.placed[chain.tool.body].pose @ chain.tool.pose
    shape = ContactShape((), (), ())
    if source.contacts:
        solids = [
            solid_clouds(link.name, assembly.shapes(body))
            for link, body in zip(links, chain.moving, strict=True)
        ]
        shape = contact_shape(links, tool.vector, solids, box)
    arm = Arm(tuple(links), tool.vector, tool.quaternion, shape.anchors, shape.capsules)
    return arm, [*notes, *shape.notes]


def _link(assembly: Assembly, body: int, joint: Joint, source: ArmSource) -> tuple[Link, list[str]]:
    name = assembly.tree.bodies[body].name
    inertial = assembly.inertial(body)
    check_link(name, joint.name, inertial, assembly.tree.inertial_example)
    frame = assembly.frames[body]
    check_offset(joint.name, float(np.linalg.norm(frame.pose.position)))
    pose = frame.pose
    if frame.carrier == assembly.root:
        pose = Pose.of(source.position, source.orientation) @ pose
    visuals, problems = drawings(assembly.shapes(body))
    return Link(name, pose.vector, pose.quaternion, joint, inertial, visuals), problems
