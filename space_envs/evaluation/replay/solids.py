"""Surfaces of MuJoCo's geoms as triangles, coarse, so that the page stays small."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.errors import ConfigurationError

_SIDES = 14  # of what is round
_FEW_SIDES = 8  # of what is thin
_THIN = 0.02  # m, radius


@dataclass(frozen=True, eq=False)
class Solid:
    """Triangles with their outward sides counterclockwise.

    Attributes:
        vertices: (V, 3) m. normals: (V, 3) of length 1. triangles: (F, 3) indices of vertices.
    """

    vertices: NDArray[np.float64]
    normals: NDArray[np.float64]
    triangles: NDArray[np.int64]


def geom_solid(model: mujoco.MjModel, geom: int) -> Solid:
    """Surface of a geom in its own frame.

    Raises:
        ConfigurationError: for a kind of geom that has no closed surface, such as a plane.
    """
    kind, size = mujoco.mjtGeom(int(model.geom_type[geom])), model.geom_size[geom]
    match kind:
        case mujoco.mjtGeom.mjGEOM_BOX:
            return box(size)
        case mujoco.mjtGeom.mjGEOM_SPHERE:
            return ellipsoid(np.repeat(size[:1], 3))
        case mujoco.mjtGeom.mjGEOM_ELLIPSOID:
            return ellipsoid(size)
        case mujoco.mjtGeom.mjGEOM_CYLINDER:
            return cylinder(size[0], size[1])
        case mujoco.mjtGeom.mjGEOM_CAPSULE:
            return capsule(size[0], size[1])
        case mujoco.mjtGeom.mjGEOM_MESH:
            return mesh(model, int(model.geom_dataid[geom]))
    raise ConfigurationError(f"a {kind.name} cannot be replayed; what can: box, sphere, ellipsoid, cylinder, "
                             "capsule, mesh")  # fmt: skip


def box(half: NDArray[np.float64]) -> Solid:
    """Surface of a box, six sides with corners of their own; `half` (3,) are half lengths in m."""
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)])
    vertices, normals, triangles = [], [], []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            side = np.empty((4, 3))
            side[:, axis] = sign
            side[:, [(axis + 1) % 3, (axis + 2) % 3]] = corners[:: int(sign)]
            triangles += [(np.array([(0, 1, 2), (0, 2, 3)]) + 4 * len(vertices))]
            vertices.append(side * half)
            normals.append(np.tile(sign * np.eye(3)[axis], (4, 1)))
    return Solid(np.concatenate(vertices), np.concatenate(normals), np.concatenate(triangles))


def cylinder(radius: float, half: float) -> Solid:
    """Surface of a cylinder about z, from -half to half, with flat ends; m."""
    sides = _SIDES if radius > _THIN else _FEW_SIDES
    ring = _ring(sides)
    wall = np.concatenate([ring * radius + (0, 0, end) for end in (-half, half)])
    flat = np.tile((0.0, 0.0, 1.0), (sides, 1))
    fan = np.array([(0, i, i + 1) for i in range(1, sides - 1)])
    return Solid(
        np.concatenate([wall, wall]),
        np.concatenate([ring, ring, -flat, flat]),
        np.concatenate([_strip(2, sides), fan[:, ::-1] + 2 * sides, fan + 3 * sides]),
    )


def capsule(radius: float, half: float) -> Solid:
    """Surface of a cylinder about z with hemispheres at its ends; m."""
    return _rounded(np.full(3, radius), half, _SIDES if radius > _THIN else _FEW_SIDES, 6)


def ellipsoid(half: NDArray[np.float64]) -> Solid:
    """Surface of an ellipsoid with half axes (3,) in m."""
    small = half.max() <= _THIN
    return _rounded(half, 0.0, _FEW_SIDES if small else 2 * _SIDES, 6 if small else _SIDES)


def mesh(model: mujoco.MjModel, number: int) -> Solid:
    """A mesh of the model, with a vertex for each pair of place and normal."""
    faces = slice(model.mesh_faceadr[number], model.mesh_faceadr[number] + model.mesh_facenum[number])
    pairs = np.stack([model.mesh_face[faces], model.mesh_facenormal[faces]], axis=-1).reshape(-1, 2)
    pairs, triangles = np.unique(pairs, axis=0, return_inverse=True)
    vertices = model.mesh_vert[model.mesh_vertadr[number] + pairs[:, 0]].astype(float)
    normals = model.mesh_normal[model.mesh_normaladr[number] + pairs[:, 1]].astype(float)
    return Solid(vertices, normals, triangles.reshape(-1, 3))


def _ring(sides: int) -> NDArray[np.float64]:
    angle = 2 * np.pi * np.arange(sides) / sides
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(sides)], axis=1)


def _strip(rings: int, sides: int) -> NDArray[np.int64]:
    """Triangles (F, 3) between rings of `sides` vertices each, from the lowest to the highest."""
    low = (np.arange(rings - 1)[:, None] * sides + np.arange(sides)).ravel()
    adjacent = (np.arange(rings - 1)[:, None] * sides + (np.arange(sides) + 1) % sides).ravel()
    lower = np.stack([low, adjacent, adjacent + sides], axis=1)
    upper = np.stack([low, adjacent + sides, low + sides], axis=1)
    return np.concatenate([lower, upper])


def _rounded(half: NDArray[np.float64], reach: float, sides: int, rings: int) -> Solid:
    """Two halves of an ellipsoid, `reach` below and above the origin, joined by a wall if reach > 0."""
    latitude = np.linspace(-0.5 * np.pi, 0.5 * np.pi, rings + 1)
    if reach > 0:  # the equator is there twice
        latitude = np.sort(np.append(latitude, 0.0))
    level = np.repeat(np.sin(latitude), sides)[:, None]
    around = np.tile(_ring(sides), (len(latitude), 1)) * np.repeat(np.cos(latitude), sides)[:, None]
    unit = around + level * (0.0, 0.0, 1.0)
    shift = np.repeat(np.arange(len(latitude)) * 2 >= len(latitude), sides)
    vertices = unit * half + np.where(shift, reach, -reach)[:, None] * (0.0, 0.0, 1.0)
    normals = unit / half
    triangles = _strip(len(latitude), sides)
    # At the poles one of the two triangles of each quadrangle has no area.
    sizes = np.linalg.norm(
        np.cross(
            vertices[triangles[:, 1]] - vertices[triangles[:, 0]],
            vertices[triangles[:, 2]] - vertices[triangles[:, 0]],
        ),
        axis=1,
    )
    return Solid(
        vertices,
        normals / np.linalg.norm(normals, axis=1, keepdims=True),
        triangles[sizes > 1e-9 * sizes.max()],
    )
