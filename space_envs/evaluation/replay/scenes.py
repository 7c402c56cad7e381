"""Scenes of replays: the model's surfaces once, and the motion of its bodies."""

import copy
from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.evaluation.replay.replay import Replay
from space_envs.evaluation.replay.solids import Solid, geom_solid

_SHOWN_GROUPS = 3  # groups 0 to 2 are those that MuJoCo shows by itself
_OVERVIEW = "overview"
_GROUT = 0.025  # of a tile's side, the edge around it
_ABOVE = 0.001  # m, a tile above what it lies on


@dataclass(frozen=True, eq=False)
class ReplayScene:
    """Surfaces of all bodies, each in the frame of its body; the same for every episode of a task.

    Attributes:
        vertices: (V, 3) m. normals: (V, 3). colours: (V, 4) in 0..1. gloss: (V,) in 0..1.
        body: (V,) index into `bodies`. triangles: (F, 3), those that can be seen through last.
        opaque: number of triangles that cannot.
        bodies: of the model, by id.
        end_effectors: name, index into `bodies`, and place (3,) in the body's frame of each.
        eye, centre: (3,) m, from where to look at what, inertial frame. fovy: deg.
        sun: (3,) direction in which its light travels. planet: (4,) centre and radius in m, or None.
    """

    vertices: NDArray[np.float64]
    normals: NDArray[np.float64]
    colours: NDArray[np.float64]
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
    """Surfaces of all bodies but the world's own, which are far away."""
    shown = [
        geom
        for geom in range(model.ngeom)
        if model.geom_bodyid[geom] > 0
        and model.geom_group[geom] < _SHOWN_GROUPS
        and _rgba(model, geom)[3] > 0
    ]
    shown.sort(key=lambda geom: _rgba(model, geom)[3] < 1)
    bodies = tuple(sorted({int(model.geom_bodyid[geom]) for geom in shown}))
    parts = [part for geom in shown for part in _parts(model, geom)]
    counts = [len(part.solid.vertices) for part in parts]
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]])
    eye, centre, fovy = _view(model)
    return ReplayScene(
        vertices=np.concatenate([part.solid.vertices for part in parts]),
        normals=np.concatenate([part.solid.normals for part in parts]),
        colours=np.repeat([part.colour for part in parts], counts, axis=0),
        gloss=np.repeat([part.gloss for part in parts], counts),
        body=np.repeat([bodies.index(part.body) for part in parts], counts),
        triangles=np.concatenate(
            [part.solid.triangles + start for part, start in zip(parts, starts, strict=True)]
        ),
        opaque=sum(len(part.solid.triangles) for part in parts if part.colour[3] == 1),
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
    model = copy.copy(shared)  # dressing may change it
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


@dataclass(frozen=True, eq=False)
class _Part:
    solid: Solid  # in the frame of its body
    body: int
    colour: NDArray[np.float64]  # (4,)
    gloss: float


def _parts(model: mujoco.MjModel, geom: int) -> Iterable[_Part]:
    """A geom's surface, and tiles on the two larger sides of a box whose material is tiled."""
    colour, gloss = _rgba(model, geom), _gloss(model, geom)
    body = int(model.geom_bodyid[geom])
    tile = _tile(model, geom)
    if tile is None:
        return [_Part(_placed(model, geom, geom_solid(model, geom)), body, colour, gloss)]
    inner, edge, repeat = tile
    solids = [
        (geom_solid(model, geom), edge),
        (_tiles(model.geom_size[geom], repeat), inner),
    ]
    return [
        _Part(_placed(model, geom, solid), body, np.append(rgb, colour[3]), gloss) for solid, rgb in solids
    ]


def _placed(model: mujoco.MjModel, geom: int, solid: Solid) -> Solid:
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    rotation = rotation.reshape(3, 3)
    return Solid(
        solid.vertices @ rotation.T + model.geom_pos[geom], solid.normals @ rotation.T, solid.triangles
    )


def _rgba(model: mujoco.MjModel, geom: int) -> NDArray[np.float64]:
    material = model.geom_matid[geom]
    return np.array(model.geom_rgba[geom] if material < 0 else model.mat_rgba[material], dtype=float)


def _gloss(model: mujoco.MjModel, geom: int) -> float:
    material = model.geom_matid[geom]
    return 0.3 if material < 0 else float(model.mat_specular[material] * model.mat_shininess[material])


def _tile(
    model: mujoco.MjModel, geom: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[int, int]] | None:
    """Colours (3,) of the middle and of the edge of a box's texture, and how often it repeats."""
    material = model.geom_matid[geom]
    texture = -1 if material < 0 else int(model.mat_texid[material, mujoco.mjtTextureRole.mjTEXROLE_RGB])
    if texture < 0 or model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_BOX:
        return None
    height, width, channels = (
        int(a[texture]) for a in (model.tex_height, model.tex_width, model.tex_nchannel)
    )
    start = int(model.tex_adr[texture])
    picture = (
        model.tex_data[start : start + height * width * channels].reshape(height, width, channels) / 255.0
    )
    across, along = (max(1, round(float(times))) for times in model.mat_texrepeat[material])
    return picture[height // 2, width // 2, :3], picture[0, 0, :3], (across, along)


def _tiles(half: NDArray[np.float64], repeat: tuple[int, int]) -> Solid:
    """Rectangles just above the two largest sides of a box of half lengths (3,)."""
    thin = int(np.argmin(half))
    first, second = (thin + 1) % 3, (thin + 2) % 3
    # The texture's first repetition runs along x where the box lies flat.
    across, along = repeat if first == 0 else repeat[::-1]
    vertices, normals, triangles = [], [], []
    for sign in (-1.0, 1.0):
        for column in range(across):
            for row in range(along):
                corner = np.zeros((4, 3))
                u = np.array([column + _GROUT, column + 1 - _GROUT]) / across * 2 - 1
                v = np.array([row + _GROUT, row + 1 - _GROUT]) / along * 2 - 1
                corner[:, first], corner[:, second] = u[[0, 1, 1, 0]], v[[0, 0, 1, 1]]
                corner *= half
                corner[:, thin] = sign * (half[thin] + _ABOVE)
                triangles.append(np.array([(0, 1, 2), (0, 2, 3)]) + 4 * len(vertices))
                vertices.append(corner[:: int(sign)])
                normals.append(np.tile(sign * np.eye(3)[thin], (4, 1)))
    return Solid(np.concatenate(vertices), np.concatenate(normals), np.concatenate(triangles))


def _end_effectors(
    model: mujoco.MjModel, bodies: tuple[int, ...]
) -> Iterable[tuple[str, int, NDArray[np.float64]]]:
    for site in range(model.nsite):
        name, body = model.site(site).name, int(model.site_bodyid[site])
        if name.startswith("end_effector") and body in bodies:
            yield name, bodies.index(body), model.site_pos[site].copy()


def _view(model: mujoco.MjModel) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Eye, what it looks at and field of view of the camera `overview`; of the whole model without one."""
    centre = np.array(model.stat.center)
    names = [model.cam(number).name for number in range(model.ncam)]
    if _OVERVIEW not in names:
        return centre + 2.0 * model.stat.extent * np.array([0.8, -0.5, 0.33]), centre, 45.0
    camera = names.index(_OVERVIEW)
    eye, ahead = model.cam_pos0[camera].copy(), -model.cam_mat0[camera].reshape(3, 3)[:, 2]
    return eye, eye + ahead * float(ahead @ (centre - eye)), float(model.cam_fovy[camera])


def _planet(model: mujoco.MjModel) -> NDArray[np.float64] | None:
    """Centre and radius of the largest thing that belongs to the world, if it is far larger than the rest."""
    fixed = [geom for geom in range(model.ngeom) if model.geom_bodyid[geom] == 0]
    if not fixed:
        return None
    # Clouds lie in shells around it, hardly larger: the first of about that size is the ground.
    largest = min(fixed, key=lambda geom: (-round(float(model.geom_aabb[geom, 3:].max()), -1), geom))
    radius = float(model.geom_aabb[largest, 3:].max())
    return np.append(model.geom_pos[largest], radius) if radius > 10 * model.stat.extent else None
