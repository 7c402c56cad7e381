"""Drawings and contact geometry of imported links."""

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path

from space_envs.errors import ConfigurationError
from space_envs.robots.description.importing.files.tree import Shape
from space_envs.robots.description.importing.meshes.converted import converted
from space_envs.robots.description.importing.meshes.reading import COLLADA, MeshFile, mesh_vertices
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
                "description, as capsules"
            ) from None
    return clouds


def _cloud(shape: Shape) -> Cloud:
    if shape.problem is not None:
        raise ConfigurationError(shape.problem)
    if shape.visual.mesh is None or shape.vertices is not None:
        return cloud_of(shape.visual, shape.vertices)
    return cloud_of(shape.visual, mesh_vertices(MeshFile(shape.visual.mesh, shape.visual.size)))


def drawings(shapes: Sequence[Shape]) -> tuple[tuple[Visual, ...], list[str]]:
    """Visuals of a link, and why some cannot be drawn; its contact geometry is drawn instead of those."""
    visuals, problems = _visuals([shape for shape in shapes if shape.drawn])
    if problems or not visuals:
        visuals = _visuals([shape for shape in shapes if shape.solid and not shape.drawn])[0] or visuals
    return tuple(visuals), problems


def _visuals(shapes: Iterable[Shape]) -> tuple[list[Visual], list[str]]:
    visuals, problems = [], []
    for shape in shapes:
        try:
            visuals += _drawn(shape)
        except ConfigurationError as error:
            problems.append(str(error))
    return visuals, problems


def _drawn(shape: Shape) -> list[Visual]:
    """A shape with meshes that MuJoCo reads; ConfigurationError where there is none."""
    visual = shape.visual
    if shape.problem is not None:
        raise ConfigurationError(shape.problem)
    if visual.kind != "mesh":
        return [visual]
    if visual.mesh is None:
        raise ConfigurationError("a mesh that is written in the robot file itself is not drawn")
    return mesh_visuals(visual, visual.mesh)


def mesh_visuals(visual: Visual, mesh: Path) -> list[Visual]:
    """Visuals of a mesh's file, of types that MuJoCo reads, placed and scaled as another visual.

    Raises:
        ConfigurationError: if there is no such file or it cannot be read.
    """
    if mesh.suffix.lower() == COLLADA and mesh.is_file():
        return [
            replace(visual, mesh=part.path, colour=part.colour or visual.colour) for part in converted(mesh)
        ]
    mesh_vertices(MeshFile(mesh, visual.size))
    return [replace(visual, mesh=mesh)]
