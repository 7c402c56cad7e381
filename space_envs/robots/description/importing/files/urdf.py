"""URDF files: MuJoCo reads their frames and shapes, this module what MuJoCo changes or drops.

MuJoCo drops rate limits, mimic joints and the type of planar joints, and rejects or changes inertias; these
are read from the XML.
"""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np

from space_envs.robots.description.importing.files.packages import Packages
from space_envs.robots.description.importing.files.structure import structure_of
from space_envs.robots.description.importing.files.tree import FileBody, FileTree
from space_envs.robots.description.importing.files.urdf_geometry import (
    compiled,
    geometry_document,
    urdf_shapes,
)
from space_envs.robots.description.importing.files.urdf_links import inertial_of, joint_of
from space_envs.robots.pose import Pose


def read_urdf(path: Path, root: ET.Element, packages: Packages) -> FileTree:
    """The robot of a URDF document.

    Raises:
        ConfigurationError: if the document is damaged; the message names the link or joint.
    """
    structure = structure_of(root)
    document, meshes = geometry_document(path, root, structure, packages)
    model = compiled(document, structure.order)
    shapes = urdf_shapes(model, meshes)
    places = {name: place for place, name in enumerate(structure.order)}
    bodies = []
    for place, name in enumerate(structure.order):
        joint = structure.joint_above.get(name)
        parent = None if joint is None else places[structure.parent[name]]
        number = model.body(f"b{place}").id
        bodies.append(
            FileBody(
                name=name,
                parent=parent,
                pose=Pose.of(np.array(model.body_pos[number]), np.array(model.body_quat[number])),
                inertial=inertial_of(structure.links[name]),
                joints=() if joint is None or joint.get("type") == "fixed" else (joint_of(joint),),
                shapes=tuple(shapes.get(number, ())),
            )
        )
    return FileTree(tuple(bodies), "urdf", notes=tuple(_ignored(root)))


def _ignored(root: ET.Element) -> list[str]:
    """Sentences about elements that nothing here simulates."""
    damped = [
        str(joint.get("name"))
        for joint in root.findall("joint")
        if (dynamics := joint.find("dynamics")) is not None
        and any(dynamics.get(key, "0").strip("0. ") for key in ("damping", "friction"))
    ]
    notes = [f"damping and friction of joints are not simulated: {', '.join(damped)}."] if damped else []
    for tag in ("transmission", "gazebo"):
        if count := len(root.findall(tag)):
            notes.append(f"{count} <{tag}> elements are not used.")
    return notes
