"""MJCF files: read from the model that MuJoCo compiles of them."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

from space_envs.errors import ConfigurationError
from space_envs.robots.description.importing.files.geoms import KINDS, geom_pose, geom_visual
from space_envs.robots.description.importing.files.mjcf_joints import coupled, ignored, joint_of
from space_envs.robots.description.importing.files.tree import (
    FileBody,
    FileTree,
    Frame,
    Shape,
    inertial_example,
)
from space_envs.robots.description.importing.meshes.reading import READABLE, mesh_pose, original_vertices
from space_envs.robots.pose import Pose
from space_envs.robots.robot import Inertial

_VISIBLE = 2  # largest group of geoms that MuJoCo's viewer shows by default; files put contact geometry above


def read_mjcf(path: Path) -> FileTree:
    """The robot of an MJCF file, with what it includes.

    Raises:
        ConfigurationError: if MuJoCo cannot read or compile it; the message has MuJoCo's reason.
    """
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        _drop_drawings_without_files(path, spec)
        _drop_textures(spec)
        model = spec.compile()
    except (ValueError, OSError) as error:
        reason = " ".join(str(error).split())
        hint = f". Write its {inertial_example('mjcf')}" if "mjMINVAL" in reason else ""
        raise ConfigurationError(f"MuJoCo cannot read it: {reason}{hint}") from None
    names = [model.body(body).name or f"body {body}" for body in range(model.nbody)]
    bodies = [
        FileBody(
            name=name,
            parent=int(model.body_parentid[body]) if body else None,
            pose=Pose.of(np.array(model.body_pos[body]), np.array(model.body_quat[body])),
            inertial=_inertial(model, body),
            joints=tuple(
                joint_of(model, joint) for joint in range(model.njnt) if int(model.jnt_bodyid[joint]) == body
            ),
            shapes=tuple(_shapes(path, spec, model, body)) if body else (),
        )
        for body, name in enumerate(names)
    ]
    frames = {
        model.site(site).name: Frame(
            int(model.site_bodyid[site]),
            Pose.of(np.array(model.site_pos[site]), np.array(model.site_quat[site])),
        )
        for site in range(model.nsite)
        if model.site(site).name
    }
    return FileTree(tuple(bodies), "mjcf", frames, _home(model), coupled(model), tuple(ignored(spec, model)))


def _inertial(model: mujoco.MjModel, body: int) -> Inertial | None:
    mass = float(model.body_mass[body])
    if mass == 0.0:
        return None
    moments, centre, axes = (
        tuple(map(float, values[body])) for values in (model.body_inertia, model.body_ipos, model.body_iquat)
    )
    return Inertial(mass, moments, centre, axes)  # type: ignore[arg-type]


def _home(model: mujoco.MjModel) -> dict[str, float]:
    """Hinge angles of the keyframe named home, or of the only keyframe."""
    names = [model.key(key).name for key in range(model.nkey)]
    if "home" not in names and len(names) != 1:
        return {}
    positions = model.key_qpos[names.index("home") if "home" in names else 0]
    hinges = [j for j in range(model.njnt) if model.jnt_type[j] == int(mujoco.mjtJoint.mjJNT_HINGE)]
    return {model.joint(j).name: float(positions[model.jnt_qposadr[j]]) for j in hinges}


def _shapes(path: Path, spec: mujoco.MjSpec, model: mujoco.MjModel, body: int) -> list[Shape]:
    shapes = []
    for geom in np.flatnonzero(model.geom_bodyid == body).tolist():
        if int(model.geom_type[geom]) not in KINDS:
            continue
        visual, vertices = geom_visual(model, geom), None
        solid = bool(model.geom_contype[geom] or model.geom_conaffinity[geom])
        if visual.kind == "mesh":
            mesh = int(model.geom_dataid[geom])
            place = geom_pose(model, geom) @ mesh_pose(model, mesh).inverse
            x, y, z = (float(value) for value in model.mesh_scale[mesh])
            name = spec.mesh(model.mesh(mesh).name).file
            file = _mesh_path(path, spec, name) if name else None
            vertices = original_vertices(model, mesh)
            visual = replace(
                visual, size=(x, y, z), position=place.vector, orientation=place.quaternion, mesh=file
            )
        visible = int(model.geom_group[geom]) <= _VISIBLE
        shapes.append(Shape(visual, drawn=visible, solid=solid, vertices=vertices))
    return shapes


def _mesh_path(path: Path, spec: mujoco.MjSpec, name: str) -> Path:
    return path.parent / spec.meshdir / name


def _drop_drawings_without_files(path: Path, spec: mujoco.MjSpec) -> None:
    """Delete geoms that are only drawn and whose meshes are missing or of a type that MuJoCo cannot read."""
    files = {mesh.name: _mesh_path(path, spec, mesh.file) for mesh in spec.meshes if mesh.file}
    lost = {name for name, file in files.items() if not file.is_file() or file.suffix.lower() not in READABLE}
    for geom in list(spec.geoms):
        weightless = geom.parent.explicitinertial or geom.mass == 0.0 or geom.density == 0.0
        if geom.meshname in lost and weightless and not geom.contype and not geom.conaffinity:
            spec.delete(geom)
    used = {geom.meshname for geom in spec.geoms}
    for mesh in list(spec.meshes):
        if mesh.name in lost - used:
            spec.delete(mesh)


def _drop_textures(spec: mujoco.MjSpec) -> None:
    """Replace images, which nothing here draws and which may be missing, by a plain colour."""
    for texture in spec.textures:
        texture.file = ""
        texture.cubefiles = [""] * 6
        texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
        texture.width = texture.height = 6
