"""Small drawing tools on MjSpec: every geom made here has no mass and never collides."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import mujoco
import numpy as np

Vector = Sequence[float]


def rotation_to(direction: Vector, toward: Vector = (0.0, 0.0, 1.0)) -> list[float]:
    """Quaternion (w, x, y, z) of the shortest active rotation that rotates `toward` to `direction`."""
    target = np.asarray(direction, dtype=float) / np.linalg.norm(direction)
    source = np.asarray(toward, dtype=float) / np.linalg.norm(toward)
    real = 1 + float(source @ target)
    if real < 1e-9:  # rotation by pi: any perpendicular axis
        axis = np.cross(source, np.eye(3)[int(np.argmin(np.abs(source)))])
        return [0.0, *(axis / np.linalg.norm(axis)).tolist()]
    quaternion = np.array([real, *np.cross(source, target)])
    return (quaternion / np.linalg.norm(quaternion)).tolist()


def look_at(eye: Vector, at: Vector, up: Vector = (0.0, 0.0, 1.0)) -> list[float]:
    """Quaternion (w, x, y, z) of a camera at `eye` that looks along its own -z towards `at`."""
    back = np.subtract(eye, at) / np.linalg.norm(np.subtract(eye, at))
    right = np.cross(up, back) / np.linalg.norm(np.cross(up, back))
    matrix = np.stack([right, np.cross(back, right), back], axis=1)
    quaternion = np.zeros(4)
    mujoco.mju_mat2Quat(quaternion, matrix.ravel())
    return quaternion.tolist()


@dataclass(frozen=True)
class Brush:
    """Draws geoms on one body, in a frame that is fixed to the body; lengths in m.

    Attributes:
        body: body that the geoms are attached to.
        origin, rotation: pose of the brush's frame in that of the body, m and quaternion (w, x, y, z).
        scale: factor on all lengths except those of meshes.
    """

    body: mujoco.MjsBody
    origin: Vector = (0.0, 0.0, 0.0)
    rotation: Vector = (1.0, 0.0, 0.0, 0.0)
    scale: float = 1.0

    def at(self, pos: Vector, quat: Vector = (1.0, 0.0, 0.0, 0.0), scale: float = 1.0) -> Self:
        """Brush with this pose in the frame of this one, and with its lengths multiplied by `scale`."""
        return replace(self, origin=self._place(pos), rotation=self._rotated(quat), scale=self.scale * scale)

    def _place(self, pos: Vector) -> list[float]:
        place = np.zeros(3)
        rotation = np.asarray(self.rotation, dtype=float)
        mujoco.mju_rotVecQuat(place, self.scale * np.asarray(pos, dtype=float), rotation)
        return (place + self.origin).tolist()

    def _rotated(self, quat: Vector) -> list[float]:
        rotated = np.zeros(4)
        mujoco.mju_mulQuat(rotated, np.asarray(self.rotation, dtype=float), np.asarray(quat, dtype=float))
        return rotated.tolist()

    def _geom(
        self, kind: mujoco.mjtGeom, material: str, pos: Vector, size: Vector, quat: Vector, **rest
    ) -> None:
        self.body.add_geom(
            type=kind,
            material=material,
            pos=self._place(pos),
            quat=self._rotated(quat),
            size=[self.scale * length for length in size],
            mass=0,
            contype=0,
            conaffinity=0,
            group=1,
            **rest,
        )

    def camera(self, name: str, eye: Vector, at: Vector, up: Vector, fovy: float) -> None:
        """Camera at `eye` that looks at a point; `up` is up in the picture, the field of view in degrees."""
        pos, quat = self._place(eye), self._rotated(look_at(eye, at, up))
        self.body.add_camera(name=name, pos=pos, quat=quat, fovy=fovy)

    def box(self, material: str, pos: Vector, size: Vector, quat: Vector = (1, 0, 0, 0)) -> None:
        """Box around `pos` with edge lengths `size`."""
        self._geom(mujoco.mjtGeom.mjGEOM_BOX, material, pos, [edge / 2 for edge in size], quat)

    def rod(self, material: str, start: Vector, end: Vector, radius: float, round_ends: bool = False) -> None:
        """Cylinder, or capsule, whose axis runs from `start` to `end`."""
        axis = np.subtract(end, start)
        middle = (np.add(start, end) / 2).tolist()
        kind = mujoco.mjtGeom.mjGEOM_CAPSULE if round_ends else mujoco.mjtGeom.mjGEOM_CYLINDER
        size = [radius, float(np.linalg.norm(axis)) / 2, 0]
        self._geom(kind, material, middle, size, rotation_to(axis.tolist()))

    def ellipsoid(self, material: str, pos: Vector, radii: Vector) -> None:
        """Ellipsoid with the given semi-axes."""
        self._geom(mujoco.mjtGeom.mjGEOM_ELLIPSOID, material, pos, radii, (1, 0, 0, 0))

    def mesh(
        self,
        material: str,
        mesh: str,
        pos: Vector = (0, 0, 0),
        quat: Vector = (1, 0, 0, 0),
        color: Vector | None = None,
    ) -> None:
        """Mesh of the model, by name, in its material or in a color (red, green, blue, opacity)."""
        self._geom(
            mujoco.mjtGeom.mjGEOM_MESH, material, pos, [0, 0, 0], quat, meshname=mesh, **_colored(color)
        )

    def solid(self, kind: str, pos: Vector, size: Vector, quat: Vector, color: Vector | None = None) -> None:
        """Box, sphere, cylinder, capsule or ellipsoid with MuJoCo's half sizes."""
        shape = getattr(mujoco.mjtGeom, f"mjGEOM_{kind.upper()}")
        self._geom(shape, "white_paint", pos, size, quat, **_colored(color))


def _colored(color: Vector | None) -> dict[str, list[float]]:
    """Argument of a geom with this color instead of its material's."""
    return {} if color is None else {"rgba": list(color)}


def _add_mesh(spec: mujoco.MjSpec, name: str, corners: np.ndarray) -> None:
    """Add triangles with corners (n, 3, 3), counter-clockwise from outside.

    No two triangles share a vertex, so that the normals stay flat and each facet glints on its own.
    """
    mesh = spec.add_mesh(name=name, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    mesh.uservert = corners.astype(np.float32).ravel()
    mesh.userface = np.arange(corners.size // 3, dtype=np.int32)


def add_crumpled_box(spec: mujoco.MjSpec, name: str, size: Vector, depth: float, cells: int = 12) -> None:
    """Add a box with edge lengths `size` in crumpled foil whose creases are up to `depth` deep.

    The creases are the same in every model: a picture must not depend on a seed.
    """
    generator = np.random.default_rng(1)
    half = np.asarray(size, dtype=float) / 2
    line = np.linspace(-1, 1, cells + 1)
    triangles = []
    for axis in range(3):
        for sign in (-1.0, 1.0):
            first, second = (axis + 1) % 3, (axis + 2) % 3
            grid = np.zeros((cells + 1, cells + 1, 3))
            grid[..., first], grid[..., second], grid[..., axis] = line[:, None], line[None, :], sign
            inner = grid[1:-1, 1:-1]
            inner[..., [first, second]] += generator.uniform(-0.35, 0.35, (*inner.shape[:2], 2)) * 2 / cells
            grid *= half
            grid[1:-1, 1:-1, axis] -= sign * generator.uniform(0, depth, inner.shape[:2])
            a, b, c, d = (
                part.reshape(-1, 3) for part in (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:])
            )
            faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
            triangles.append(faces if sign > 0 else faces[:, ::-1])
    _add_mesh(spec, name, np.concatenate(triangles))


def add_revolved(
    spec: mujoco.MjSpec, name: str, profile: Sequence[tuple[float, float]], sides: int = 32
) -> None:
    """Add the closed surface that a profile of (radius, z) points, rotated about z, sweeps out.

    Used for dishes and nozzles: give the outside going up and the inside coming down.
    """
    angle = np.linspace(0, 2 * np.pi, sides + 1)
    points = np.array([[(r * np.cos(t), r * np.sin(t), z) for t in angle] for r, z in profile])
    a, b, c, d = (
        p.reshape(-1, 3) for p in (points[:-1, :-1], points[:-1, 1:], points[1:, 1:], points[1:, :-1])
    )
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    edges = np.cross(faces[:, 1] - faces[:, 0], faces[:, 2] - faces[:, 0])
    _add_mesh(spec, name, faces[np.linalg.norm(edges, axis=1) > 1e-9])
