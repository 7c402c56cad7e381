"""COLLADA files, which most URDF files draw with: their triangles and colours.

As in RViz, the up axis that a file states is not applied, its unit is.
"""

import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from space_envs.dynamics.rotations import Array, exponential, to_matrix
from space_envs.errors import ConfigurationError
from space_envs.robots.description.importing.files.document import parse_xml
from space_envs.robots.description.importing.meshes.polygons import counts, triangles

Colour = tuple[float, float, float, float]
_DEEPEST = 50  # nodes within each other
_MOST = 2_000_000  # triangles of a file, after instancing


class MeshSurface(NamedTuple):
    """Triangles of one colour.

    Attributes:
        corners: (m, 3, 3) m, corners of each triangle. colour: red, green, blue, opacity; None if not given.
    """

    corners: Array
    colour: Colour | None


def read_collada(path: Path) -> list[MeshSurface]:
    """All surfaces of the scene in a COLLADA file.

    Raises:
        ConfigurationError: if it is none, or holds no triangles. OSError: if it cannot be read.
    """
    root = parse_xml(path)
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    try:
        unit = root.find("asset/unit")
        scale = float(unit.get("meter", "1")) if unit is not None else 1.0
        scene = _Scene(root)
        surfaces = list(scene.surfaces(np.diag([scale, scale, scale, 1.0])))
    except (ValueError, KeyError, IndexError, AttributeError, TypeError) as error:
        raise ConfigurationError(f"{path}: not a COLLADA file that can be read ({error})") from None
    if not surfaces:
        raise ConfigurationError(f"{path}: a COLLADA file without triangles or polygons")
    return surfaces


class _Scene:
    """Elements of a document by their ids."""

    def __init__(self, root: ET.Element) -> None:
        self._elements = {f"#{element.get('id')}": element for element in root.iter() if element.get("id")}
        instance = root.find("scene/instance_visual_scene")
        first = root.find("library_visual_scenes/visual_scene")
        self._root = self._elements[instance.get("url", "")] if instance is not None else first
        self._triangles = 0

    def surfaces(self, frame: Array) -> Iterator[MeshSurface]:
        """Surfaces of all nodes, in a frame (4, 4)."""
        for node in self._root.findall("node") if self._root is not None else ():
            yield from self._of_node(node, frame, 1)

    def _of_node(self, node: ET.Element, frame: Array, depth: int) -> Iterator[MeshSurface]:
        if depth > _DEEPEST:
            raise ValueError("nodes are nested too deeply")
        for part in node:
            frame = frame @ _transform(part)
        for instance in node.findall("instance_geometry"):
            mesh = self._elements[instance.get("url", "")].find("mesh")
            materials = {
                each.get("symbol"): each.get("target") for each in instance.iter("instance_material")
            }
            for tag in ("triangles", "polylist", "polygons"):
                for group in mesh.findall(tag) if mesh is not None else ():
                    corners = self._corners(group)
                    self._triangles += len(corners)
                    if self._triangles > _MOST:
                        raise ValueError(f"more than {_MOST} triangles")
                    placed = corners @ frame[:3, :3].T + frame[:3, 3]
                    if len(corners):
                        yield MeshSurface(placed, self._colour(materials.get(group.get("material"))))
        for child in node.findall("node"):
            yield from self._of_node(child, frame, depth + 1)
        for instance in node.findall("instance_node"):
            yield from self._of_node(self._elements[instance.get("url", "")], frame, depth + 1)

    def _corners(self, group: ET.Element) -> Array:
        """Corners (m, 3, 3) of the triangles of a primitive, polygons as fans."""
        inputs = {each.get("semantic"): each for each in group.findall("input")}
        vertices = self._elements[inputs["VERTEX"].get("source", "")]
        source = next(each.get("source") for each in vertices if each.get("semantic") == "POSITION")
        values = self._elements[str(source)].find("float_array")
        points = np.array((values.text or "").split(), dtype=float).reshape(-1, 3)  # type: ignore[union-attr]
        width = 1 + max(int(each.get("offset", 0)) for each in group.findall("input"))
        lists = [np.array((each.text or "").split(), dtype=np.int64) for each in group.findall("p")]
        indices = np.concatenate(lists) if lists else np.zeros(0, dtype=np.int64)
        places = indices.reshape(-1, width)[:, int(inputs["VERTEX"].get("offset", 0))]
        return points[triangles(counts(group, places, [len(each) // width for each in lists]), places)]

    def _colour(self, material: str | None) -> Colour | None:
        if material not in self._elements:
            return None
        effect = self._elements[material].find("instance_effect")
        found = self._elements[effect.get("url", "")].find(".//diffuse/color") if effect is not None else None
        if found is None:
            return None
        red, green, blue, *_ = map(float, (found.text or "").split())
        return red, green, blue, 1.0


def _transform(element: ET.Element) -> Array:
    """Transformation (4, 4) of an element of a node; that of other elements is none."""
    result = np.eye(4)
    if element.tag not in ("matrix", "translate", "rotate", "scale"):
        return result
    values = np.array((element.text or "").split(), dtype=float)
    if element.tag == "matrix":
        return values.reshape(4, 4)
    if element.tag == "translate":
        result[:3, 3] = values
    elif element.tag == "rotate":
        result[:3, :3] = to_matrix(exponential(values[:3] * np.radians(values[3])))
    else:
        result[range(3), range(3)] = values
    return result
