"""Scenes of replays: the model's surfaces once, and the motion of its bodies."""

import copy
from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.evaluation.replay.replay import Replay
from space_envs.evaluation.replay.surfaces import rgba, surfaces

_SHOWN_GROUPS = 3  # groups 0 to 2 are those that MuJoCo shows by itself
_OVERVIEW = "overview"


@dataclass(frozen=True, eq=False)
class ReplayScene:
    """Surfaces of all bodies, each in the frame of its body; the same for every episode of a task.

    Attributes:
        vertices: (V, 3) m. normals: (V, 3). colors: (V, 4) in 0..1. gloss: (V,) in 0..1.
        body: (V,) index into `bodies`. triangles: (F, 3), those that can be seen through last.
        opaque: number of triangles that cannot.
        bodies: of the model, by id.
        end_effectors: name, index into `bodies`, and place (3,) in the body's frame of each.
        eye, centre: (3,) m, of the camera and of the point that it looks at, inertial frame. fovy: deg.
        sun: (3,) direction in which its light travels. planet: (4,) centre and radius in m, or None.
    """

    vertices: NDArray[np.float64]
    normals: NDArray[np.float64]
    colors: NDArray[np.float64]
    gloss: NDArray[np.float64]
    body: NDArray[np.int64]
    triangles: NDArray[np.int64]
    opaque: int
    bodies: tuple[int, ...]
    end_effectors: tuple[tuple[str, int, NDArray[np.float64]], ...]
    eye: NDArray[np.float64]
    centre: NDArray[np.float64]
    fovy: float
    sun: NDArray[np.float64]
    planet: NDArray[np.float64] | None


@dataclass(frozen=True, eq=False)
class ReplayMotion:
    """Motion of a scene's bodies in an episode of T steps.

    Attributes:
        position: (T + 1, B, 3) m, inertial frame. quaternion: (T + 1, B, 4), w first.
        size: (B,) factor on each body's surfaces, for goals that come in sizes.
    """

    position: NDArray[np.float64]
    quaternion: NDArray[np.float64]
    size: NDArray[np.float64]


def make_scene(model: mujoco.MjModel) -> ReplayScene:
    """Scene of a model: surfaces of all bodies but the world, whose own are far away."""
    shown = [
        geom
        for geom in range(model.ngeom)
        if model.geom_bodyid[geom] > 0 and model.geom_group[geom] < _SHOWN_GROUPS and rgba(model, geom)[3] > 0
    ]
    shown.sort(key=lambda geom: rgba(model, geom)[3] < 1)
    bodies = tuple(sorted({int(model.geom_bodyid[geom]) for geom in shown}))
    parts = [part for geom in shown for part in surfaces(model, geom)]
    counts = [len(part.solid.vertices) for part in parts]
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    eye, centre, fovy = _view(model)
    return ReplayScene(
        vertices=np.concatenate([part.solid.vertices for part in parts]),
        normals=np.concatenate([part.solid.normals for part in parts]),
        colors=np.repeat([part.color for part in parts], counts, axis=0),
        gloss=np.repeat([part.gloss for part in parts], counts),
        body=np.repeat([bodies.index(part.body) for part in parts], counts),
        triangles=np.concatenate(
            [part.solid.triangles + start for part, start in zip(parts, starts, strict=True)]
        ),
        opaque=sum(len(part.solid.triangles) for part in parts if part.color[3] == 1),
        bodies=bodies,
        end_effectors=tuple(_end_effectors(model, bodies)),
        eye=eye,
        centre=centre,
        fovy=fovy,
        sun=model.light_dir[0].copy() if model.nlight else np.array([-0.5, 0.45, -0.74]),
        planet=_planet(model),
    )


def make_motion(replay: Replay, scene: ReplayScene) -> ReplayMotion:
    """Poses of the scene's bodies at every recorded state."""
    shared = replay.task.render_model
    model = copy.copy(shared)  # update_visuals may change it
    data = mujoco.MjData(model)
    replay.task.update_visuals(model, data, replay.goals, 0)
    bodies = list(scene.bodies)
    position = np.empty((len(replay.scene), len(bodies), 3))
    quaternion = np.empty((len(replay.scene), len(bodies), 4))
    for step, qpos in enumerate(replay.scene):
        data.qpos[:] = qpos
        mujoco.mj_kinematics(model, data)
        position[step], quaternion[step] = data.xpos[bodies], data.xquat[bodies]
    first = model.body_geomadr[bodies]
    return ReplayMotion(position, quaternion, model.geom_rbound[first] / shared.geom_rbound[first])


def _end_effectors(
    model: mujoco.MjModel, bodies: tuple[int, ...]
) -> Iterable[tuple[str, int, NDArray[np.float64]]]:
    for site in range(model.nsite):
        name, body = model.site(site).name, int(model.site_bodyid[site])
        if name.startswith("end_effector") and body in bodies:
            yield name, bodies.index(body), model.site_pos[site].copy()


def _view(model: mujoco.MjModel) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Eye, centre and field of view of the camera `overview`; a view of the whole model without one."""
    centre = np.array(model.stat.center)
    names = [model.cam(number).name for number in range(model.ncam)]
    if _OVERVIEW not in names:
        return centre + 2.0 * model.stat.extent * np.array([0.8, -0.5, 0.33]), centre, 45.0
    camera = names.index(_OVERVIEW)
    eye, ahead = model.cam_pos0[camera].copy(), -model.cam_mat0[camera].reshape(3, 3)[:, 2]
    return eye, eye + ahead * float(ahead @ (centre - eye)), float(model.cam_fovy[camera])


def _planet(model: mujoco.MjModel) -> NDArray[np.float64] | None:
    """Centre and radius of the largest geom of the world body, if it is far larger than the rest."""
    fixed = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == 0]
    if not fixed:
        return None
    # Clouds lie in shells around it, hardly larger: the first of about that size is the ground.
    largest = min(fixed, key=lambda geom: (-round(float(model.geom_aabb[geom, 3:].max()), -1), geom))
    radius = float(model.geom_aabb[largest, 3:].max())
    return np.append(model.geom_pos[largest], radius) if radius > 10 * model.stat.extent else None
