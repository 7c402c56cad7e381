"""Meshes of robot files: STL, OBJ and MSH, read by MuJoCo, and COLLADA."""

from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError
from space_envs.robots.description.importing.meshes.collada import read_collada
from space_envs.robots.pose import Pose
from space_envs.robots.robot import Vector3

READABLE = (".stl", ".obj", ".msh")  # by MuJoCo
COLLADA = ".dae"


class MeshFile(NamedTuple):
    """A mesh that a robot file names, with the scale along its axes."""

    path: Path
    scale: Vector3


def mesh_vertices(mesh: MeshFile) -> Array:
    """Vertices (k, 3) of a mesh in its own axes, scaled, m.

    Raises:
        ConfigurationError: if there is no such file or MuJoCo cannot read it.
    """
    kind = mesh.path.suffix.lower()
    if kind not in (*READABLE, COLLADA):
        known = ", ".join((*READABLE, COLLADA))
        raise ConfigurationError(f"{mesh.path}: a mesh of type {kind or 'none'}; {known} can be read")
    if not mesh.path.is_file():
        raise ConfigurationError(f"there is no mesh file {mesh.path}")
    if kind == COLLADA:
        corners = [surface.corners.reshape(-1, 3) for surface in read_collada(mesh.path)]
        return np.concatenate(corners) * np.array(mesh.scale)
    spec = mujoco.MjSpec()
    spec.add_mesh(name="mesh", file=str(mesh.path.resolve()), scale=list(mesh.scale)).inertia = (
        mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # of any surface, closed or not
    )
    try:
        model = spec.compile()
    except ValueError as error:
        reason = " ".join(str(error).split())
        raise ConfigurationError(f"{mesh.path}: MuJoCo cannot read the mesh: {reason}") from None
    return original_vertices(model, 0)


def original_vertices(model: mujoco.MjModel, mesh: int) -> Array:
    """Vertices (k, 3) of a compiled mesh in the axes of its file, which MuJoCo moves to principal axes."""
    first, count = int(model.mesh_vertadr[mesh]), int(model.mesh_vertnum[mesh])
    return mesh_pose(model, mesh).point(np.array(model.mesh_vert[first : first + count], dtype=float))


def mesh_pose(model: mujoco.MjModel, mesh: int) -> Pose:
    """Pose of a compiled mesh's frame in that of its file."""
    return Pose.of(model.mesh_pos[mesh], model.mesh_quat[mesh])
