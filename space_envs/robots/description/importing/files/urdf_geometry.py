"""Shapes of a URDF document: placed by MuJoCo, meshes named by their files."""

import re
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import mujoco

from space_envs.errors import ConfigurationError, shown
from space_envs.robots.description.importing.files.geoms import KINDS, geom_visual
from space_envs.robots.description.importing.files.packages import Packages, resolve
from space_envs.robots.description.importing.files.structure import Structure
from space_envs.robots.description.importing.files.tree import Shape
from space_envs.robots.description.importing.meshes.reading import MeshFile

# MuJoCo would merge fixed links, drop what is only drawn, and strip folders from names.
_COMPILER = {"fusestatic": "false", "discardvisual": "false", "strippath": "false"}
_ROLES = {"visual": "v", "collision": "c"}
Meshes = dict[str, MeshFile | str]  # geom -> its mesh, or why there is none


def geometry_document(
    path: Path, root: ET.Element, structure: Structure, packages: Packages
) -> tuple[str, Meshes]:
    """The URDF that MuJoCo reads: the same links and shapes, all joints fixed, spheres in place of meshes.

    Link number i is called b{i}, and its shape number k v{i}_{k} or c{i}_{k}, for drawings and contacts.
    """
    document = ET.Element("robot", name="robot")
    ET.SubElement(ET.SubElement(document, "mujoco"), "compiler", _COMPILER)
    colours = {str(each.get("name")): each.find("color") for each in root.findall("material")}
    meshes: Meshes = {}
    numbers = {name: f"b{place}" for place, name in enumerate(structure.order)}
    for place, (name, number) in enumerate(numbers.items()):
        link = ET.SubElement(document, "link", name=number)
        for shape in structure.links[name]:
            if shape.tag in _ROLES and shape.find("geometry") is not None:
                geom = f"{_ROLES[shape.tag]}{place}_{len(link)}"
                _add_shape(link, shape, geom, colours)
                if (mesh := shape.find("geometry/mesh")) is not None:
                    meshes[geom] = _mesh(f"link {name!r}", path, mesh, packages)
    for name, joint in structure.joint_above.items():
        element = ET.SubElement(document, "joint", name=f"j{numbers[name]}", type="fixed")
        element.extend(joint.findall("origin"))
        ET.SubElement(element, "parent", link=numbers[structure.parent[name]])
        ET.SubElement(element, "child", link=numbers[name])
    return ET.tostring(document, encoding="unicode"), meshes


def compiled(document: str, names: Sequence[str]) -> mujoco.MjModel:
    """The model of a geometry document whose links have these names.

    Raises:
        ConfigurationError: with MuJoCo's reason and the link.
    """
    try:
        return mujoco.MjSpec.from_string(document).compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        shape = re.search(r"'[bvc](\d+)(_\d+)?'", reason)
        where = f"link {names[int(shape[1])]!r}: " if shape else ""
        raise ConfigurationError(f"{where}MuJoCo cannot read its shapes: {reason}") from None


def _add_shape(link: ET.Element, shape: ET.Element, geom: str, colours: dict[str, ET.Element | None]) -> None:
    element = ET.SubElement(link, shape.tag, name=geom)
    element.extend(shape.findall("origin"))
    geometry = ET.SubElement(element, "geometry")
    for form in shape.findall("geometry/*"):
        geometry.append(ET.Element("sphere", radius="1") if form.tag == "mesh" else form)
    material = shape.find("material")
    if material is not None:
        color = material.find("color")
        color = colours.get(str(material.get("name"))) if color is None else color
        if color is not None:
            ET.SubElement(element, "material", name="").append(color)


def _mesh(where: str, path: Path, mesh: ET.Element, packages: Packages) -> MeshFile | str:
    try:
        x, y, z = (float(part) for part in mesh.get("scale", "1 1 1").split())
    except ValueError:
        raise ConfigurationError(
            f"{where}: the scale of a mesh must be three numbers, got {shown(mesh.get('scale'))}"
        ) from None
    try:
        return MeshFile(resolve(mesh.get("filename", ""), path, packages), (x, y, z))
    except ConfigurationError as error:
        return str(error)


def urdf_shapes(model: mujoco.MjModel, meshes: Meshes) -> dict[int, list[Shape]]:
    """Shapes of each body of the model that MuJoCo made of a geometry document."""
    shapes: dict[int, list[Shape]] = {}
    for geom in range(model.ngeom):
        if int(model.geom_type[geom]) not in KINDS:
            continue
        name, visual = model.geom(geom).name, geom_visual(model, geom)
        mesh = meshes.get(name)
        if isinstance(mesh, MeshFile):
            visual = replace(visual, kind="mesh", mesh=mesh.path, size=mesh.scale)
        elif mesh is not None:
            visual = replace(visual, kind="mesh")
        drawn = name.startswith(_ROLES["visual"])
        shape = Shape(visual, drawn, not drawn, problem=mesh if isinstance(mesh, str) else None)
        shapes.setdefault(int(model.geom_bodyid[geom]), []).append(shape)
    return shapes
