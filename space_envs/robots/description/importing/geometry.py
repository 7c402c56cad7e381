"""Drawings and contact geometry of imported links."""

from collections.abc import Iterable, Sequence

from space_envs.errors import ConfigurationError
from space_envs.robots.description.importing.files.meshes import MeshFile, mesh_vertices
from space_envs.robots.description.importing.files.tree import Shape
from space_envs.robots.description.shape.clouds import Cloud, cloud_of
from space_envs.robots.robot import Visual


def solid_clouds(link: str, shapes: Iterable[Shape]) -> list[Cloud]:
    """Contact geometry of a link.

    Raises:
        ConfigurationError: if a mesh cannot be read: the contact shape would not be that of the file.
    """
    clouds = []
    for shape in shapes:
        if not shape.solid:
            continue
        try:
            clouds.append(_cloud(shape))
        except ConfigurationError as error:
            raise ConfigurationError(
                f"collision geometry of link {link!r}: {error}. Or write the contact shape in the "
                "description: [[arm]] anchors and capsules"
            ) from None
    return clouds


def _cloud(shape: Shape) -> Cloud:
    if shape.problem is not None:
        raise ConfigurationError(shape.problem)
    if shape.visual.mesh is None or shape.vertices is not None:
        return cloud_of(shape.visual, shape.vertices)
    return cloud_of(shape.visual, mesh_vertices(MeshFile(shape.visual.mesh, shape.visual.size)))


def drawings(shapes: Sequence[Shape]) -> tuple[tuple[Visual, ...], list[str]]:
    """Visuals of a link, and why some cannot be drawn; its contact geometry is drawn instead."""
    visuals, problems = [], []
    for shape in shapes:
        if shape.drawn and (problem := _problem(shape)):
            problems.append(problem)
        elif shape.drawn:
            visuals.append(shape.visual)
    if problems or not visuals:
        solid = [shape for shape in shapes if shape.solid and not shape.drawn and not _problem(shape)]
        visuals = [shape.visual for shape in solid] or visuals
    return tuple(visuals), problems


def _problem(shape: Shape) -> str | None:
    """Why a shape cannot be drawn."""
    if shape.problem is not None:
        return shape.problem
    if shape.visual.kind != "mesh":
        return None
    if shape.visual.mesh is None:
        return "a mesh that is written in the file itself"
    try:
        mesh_vertices(MeshFile(shape.visual.mesh, shape.visual.size))
    except ConfigurationError as error:
        return str(error)
    return None
