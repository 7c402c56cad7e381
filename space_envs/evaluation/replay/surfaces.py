"""Surfaces of geoms with their colors, placed in the frames of their bodies."""

from collections.abc import Iterable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.evaluation.replay.solids import Solid, geom_solid

_GROUT = 0.025  # of a tile's side, the edge around it
_ABOVE = 0.001  # m, a tile above what it lies on


@dataclass(frozen=True, eq=False)
class Surface:
    """Surface of one color, in the frame of its body."""

    solid: Solid
    body: int
    color: NDArray[np.float64]  # (4,) in 0..1
    gloss: float


def surfaces(model: mujoco.MjModel, geom: int) -> Iterable[Surface]:
    """Surface of a geom, and tiles on the two larger sides of a box whose material is tiled."""
    color, gloss = rgba(model, geom), _gloss(model, geom)
    body = int(model.geom_bodyid[geom])
    tile = _tile(model, geom)
    if tile is None:
        return [Surface(_placed(model, geom, geom_solid(model, geom)), body, color, gloss)]
    inner, edge, repeat = tile
    solids = [
        (geom_solid(model, geom), edge),
        (_tiles(model.geom_size[geom], repeat), inner),
    ]
    return [
        Surface(_placed(model, geom, solid), body, np.append(rgb, color[3]), gloss) for solid, rgb in solids
    ]


def _placed(model: mujoco.MjModel, geom: int, solid: Solid) -> Solid:
    rotation = np.empty(9)
    mujoco.mju_quat2Mat(rotation, model.geom_quat[geom])
    rotation = rotation.reshape(3, 3)
    return Solid(
        solid.vertices @ rotation.T + model.geom_pos[geom], solid.normals @ rotation.T, solid.triangles
    )


def rgba(model: mujoco.MjModel, geom: int) -> NDArray[np.float64]:
    """Color and opacity (4,) of a geom."""
    material = model.geom_matid[geom]
    return np.array(model.geom_rgba[geom] if material < 0 else model.mat_rgba[material], dtype=float)


def _gloss(model: mujoco.MjModel, geom: int) -> float:
    material = model.geom_matid[geom]
    return 0.3 if material < 0 else float(model.mat_specular[material] * model.mat_shininess[material])


def _tile(
    model: mujoco.MjModel, geom: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], tuple[int, int]] | None:
    """Colors (3,) of the middle and of the edge of a box's texture, and how often it repeats."""
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
