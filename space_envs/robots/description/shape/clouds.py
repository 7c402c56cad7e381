"""Geometry as the hulls of spheres, from which capsules are fitted."""

from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from space_envs.dynamics.rotations import Array
from space_envs.robots.pose import Pose
from space_envs.robots.robot import Visual

_RIM = 16  # points of a circle; the polygon around it is 2 % wider
_DIRECTIONS = 64  # and as many opposite ones


class Cloud(NamedTuple):
    """The convex hull of spheres.

    Attributes:
        centres: (k, 3) m. radii: (k,) m, zero for points.
    """

    centres: Array
    radii: Array


def cloud_of(visual: Visual, vertices: Array | None = None) -> Cloud:
    """Hull of a geometry in the frame of its body; a mesh is that of its vertices (k, 3) in its own frame."""
    centres, radius = _local(visual) if vertices is None else (_extreme(vertices), 0.0)
    place = Pose.of(visual.position, visual.orientation)
    return Cloud(place.point(centres), np.full(len(centres), radius))


def thinned(cloud: Cloud) -> Cloud:
    """Spheres of a cloud that lie farthest in one of many directions."""
    along = half_sphere(_DIRECTIONS) @ cloud.centres.T
    extremes = [(sign * along + cloud.radii).argmax(axis=1) for sign in (1.0, -1.0)]
    kept = np.unique(extremes)
    return Cloud(cloud.centres[kept], cloud.radii[kept])


def half_sphere(count: int) -> Array:
    """Directions (count, 3), evenly spread, none opposite to another."""
    height = (np.arange(count) + 0.5) / count
    angle = np.arange(count) * np.pi * (3.0 - np.sqrt(5.0))
    radius = np.sqrt(1.0 - height**2)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), height], axis=1)


def joined(clouds: list[Cloud]) -> Cloud:
    """Hull of several."""
    centres, radii = zip(*clouds, strict=True)
    return Cloud(np.concatenate(centres), np.concatenate(radii))


def _local(visual: Visual) -> tuple[Array, float]:
    """Centres and radius of the spheres in the geometry's own frame."""
    x, y, z = visual.size
    if visual.kind == "sphere":
        return np.zeros((1, 3)), x
    if visual.kind == "capsule":
        return np.array([[0.0, 0.0, -y], [0.0, 0.0, y]]), x
    if visual.kind == "cylinder":
        return _cylinder(x, y), 0.0
    # An ellipsoid is within its box; the arms of few robots have one.
    return np.array(np.meshgrid([-x, x], [-y, y], [-z, z])).reshape(3, -1).T, 0.0


def _cylinder(radius: float, half: float) -> Array:
    """Corners of the prism around a cylinder along z."""
    angle = np.arange(_RIM) * 2 * np.pi / _RIM
    outer = radius / np.cos(np.pi / _RIM)
    rim = np.stack([outer * np.cos(angle), outer * np.sin(angle), np.zeros(_RIM)], axis=1)
    return np.concatenate([rim + [0.0, 0.0, -half], rim + [0.0, 0.0, half]])


def _extreme(vertices: Array) -> Array:
    """Vertices of the convex hull; all of them if they lie in a plane."""
    try:
        return vertices[ConvexHull(vertices).vertices]
    except (QhullError, ValueError):
        return vertices
