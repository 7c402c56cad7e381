"""The planet behind the drawings: clouds over an ocean and the glow of its atmosphere, painted by numpy.

The cameras stay within a few metres of the origin and the planet is hundreds away, so one side of it is all
that is ever seen. The textures are painted for that side: `u` and `v` of its mesh are polar coordinates about
the point below the origin, with the angle from there as radius.
"""

from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.fft import ifft2

from space_envs.models.shapes import Vector, rotation_to

PLANET = "planet"
ATMOSPHERE = "atmosphere"
TEXTURE_SIDE = 1024  # pixels, of the side that is seen
PAINTED = 1.15  # rad, angle from the point below the origin to the texture's edge: beyond the horizon
RINGS, SIDES = 96, 144  # of the planet's mesh
GLOW = 0.045  # of the horizon's radius, height of the glow above it
_GLOW_PIXELS = (32, 256)  # of the glow's texture: outward, around
_OCEAN = np.array([0.03, 0.13, 0.34])
_SHALLOWS = np.array([0.06, 0.29, 0.52])
_CLOUD = np.array([0.80, 0.85, 0.92])
_HAZE = np.array([0.42, 0.68, 1.0])

Texture = NDArray[np.uint8]
Fields = NDArray[np.float32]


def add_planet(spec: mujoco.MjSpec, pos: Vector, radius: float, sun: Vector) -> None:
    """Add the planet and the glow around it, which belong to the world.

    Args:
        spec: to add to.
        pos: centre of the planet, inertial frame, m. It must be farther than the radius from the origin.
        radius: of the planet, m.
        sun: direction in which sunlight travels, inertial frame.
    """
    distance = float(np.linalg.norm(pos))
    horizon = float(np.arccos(radius / distance))
    turn = rotation_to([-part for part in pos])
    _add_textured(spec, PLANET, _planet_pixels(round(horizon, 6)), lit=0.74, glow=0.0)
    _add_sphere(spec, radius)
    _add_textured(spec, ATMOSPHERE, _glow_pixels(_across(sun, turn)), lit=0.02, glow=0.98)
    _add_ring(spec, radius * np.sin(horizon))
    height = radius * np.cos(horizon)  # of the horizon's circle above the centre
    above = (np.asarray(pos) * (1 - height / distance)).tolist()
    for name, place in ((PLANET, pos), (ATMOSPHERE, above)):
        spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            material=name,
            pos=place,
            quat=turn,
            mass=0,
            contype=0,
            conaffinity=0,
            group=1,
        )


def make_plain(spec: mujoco.MjSpec) -> None:
    """Give the planet and its glow one colour each in a drawn spec: MJCF text cannot hold painted pixels."""
    for name, colour in ((PLANET, _OCEAN), (ATMOSPHERE, np.zeros(3))):
        texture = spec.texture(name)
        texture.data = b""
        texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
        texture.width = texture.height = 8
        texture.rgb1 = texture.rgb2 = colour


def _across(sun: Vector, turn: Vector) -> tuple[float, float]:
    """The part of the sunlight's direction across the line of sight, in the axes of the planet's mesh."""
    inverse, seen = np.zeros(4), np.zeros(3)
    mujoco.mju_negQuat(inverse, np.asarray(turn, dtype=float))
    direction = np.asarray(sun, dtype=float) / np.linalg.norm(sun)
    mujoco.mju_rotVecQuat(seen, direction, inverse)
    return round(float(seen[0]), 6), round(float(seen[1]), 6)


def _add_textured(spec: mujoco.MjSpec, name: str, pixels: Texture, lit: float, glow: float) -> None:
    """Add a texture and its material, which reflects `lit` of the light and glows by itself.

    With all light together a material should stay below 1, where OpenGL clips.
    """
    height, width, channels = pixels.shape
    flat = mujoco.mjtTexture.mjTEXTURE_2D
    texture = spec.add_texture(name=name, type=flat, width=width, height=height, nchannel=channels)
    texture.data = pixels.tobytes()
    material = spec.add_material(name=name, emission=glow / lit, specular=0.0, shininess=0.0)
    material.rgba = [lit, lit, lit, 1.0]
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name


def _add_sphere(spec: mujoco.MjSpec, radius: float) -> None:
    """Add a sphere whose +z half carries the texture; the other half, which is never seen, mirrors it."""
    polar = np.linspace(0.0, np.pi, RINGS + 1)
    around = np.linspace(0.0, 2 * np.pi, SIDES + 1)[:-1]
    unit = np.stack(
        [
            np.outer(np.sin(polar), np.cos(around)),
            np.outer(np.sin(polar), np.sin(around)),
            np.repeat(np.cos(polar)[:, None], SIDES, axis=1),
        ],
        axis=-1,
    )
    outward = np.minimum(np.minimum(polar, np.pi - polar) / PAINTED, 1.0)[:, None]
    texture = 0.5 + 0.5 * np.stack([outward * np.cos(around), outward * np.sin(around)], axis=-1)
    mesh = spec.add_mesh(name=PLANET, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    mesh.uservert = (radius * unit).astype(np.float32).ravel()
    mesh.usernormal = unit.astype(np.float32).ravel()
    mesh.usertexcoord = texture.astype(np.float32).ravel()
    mesh.userface = _grid_faces(RINGS + 1, SIDES, closed=True)


def _add_ring(spec: mujoco.MjSpec, horizon: float) -> None:
    """Add a flat ring around the circle of the horizon, radius in m, that faces +z."""
    around = np.linspace(0.0, 2 * np.pi, SIDES + 1)
    radii = horizon * np.array([0.97, 1.0 + GLOW])
    place = np.zeros((2, SIDES + 1, 3))
    place[..., 0], place[..., 1] = np.outer(radii, np.cos(around)), np.outer(radii, np.sin(around))
    margin = 0.5 / _GLOW_PIXELS[0]  # half a pixel: textures repeat beyond their edges
    outward = np.array([[margin], [1.0 - margin]])
    texture = np.stack(np.broadcast_arrays(around / (2 * np.pi), outward), axis=-1)
    mesh = spec.add_mesh(name=ATMOSPHERE, inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL)
    mesh.uservert = place.astype(np.float32).ravel()
    mesh.usertexcoord = texture.astype(np.float32).ravel()
    mesh.userface = _grid_faces(2, SIDES + 1, closed=False)


def _grid_faces(rows: int, columns: int, closed: bool) -> NDArray[np.int32]:
    """Triangles between rows of vertices, counterclockwise from outside; closed joins the columns' ends."""
    index = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
    after = np.roll(index, -1, axis=1) if closed else index[:, 1:]
    before = index if closed else index[:, :-1]
    a, b, c, d = before[:-1], before[1:], after[1:], after[:-1]
    return np.concatenate([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)]).ravel()


@lru_cache(maxsize=4)
def _planet_pixels(horizon: float) -> Texture:
    """(TEXTURE_SIDE, TEXTURE_SIDE, 3) colours of ocean, cloud and haze, the horizon at this angle in rad."""
    generator = np.random.default_rng(7)  # a picture must not depend on a seed
    side = TEXTURE_SIDE
    across, along = _noise(generator, side, decay=2.6, first=4)
    weather, detail = _noise(generator, side, decay=1.9, first=5)[0], _noise(generator, side, 1.5, 24)[0]
    rows, columns = np.indices((side, side), dtype=np.int32)
    reach = 0.03 * side  # pixels that winds carry the clouds
    carried = (rows + reach * across).astype(int) % side, (columns + reach * along).astype(int) % side
    cloud = _smoothstep(0.75 * weather[carried] + 0.45 * detail, 0.0, 1.9)[..., None]
    ground = _OCEAN + _smoothstep(across, 0.2, 1.8)[..., None] * (_SHALLOWS - _OCEAN)
    colour = ground + cloud * (_CLOUD - ground)
    middle = (side - 1) / 2
    angle = PAINTED * np.hypot(rows - middle, columns - middle) / middle
    height = np.sin(np.minimum(angle, horizon)) / np.sin(horizon)  # across the line of sight
    haze = 0.85 * height[..., None] ** 14
    return _bytes(colour + haze * (_HAZE - colour))


@lru_cache(maxsize=4)
def _glow_pixels(across: tuple[float, float]) -> Texture:
    """Colours (outward, around, 3) of the atmosphere above the horizon, bright where the sun shines."""
    outward, around = _GLOW_PIXELS
    angle = 2 * np.pi * (np.arange(around) + 0.5) / around
    day = 0.25 + 0.75 * _smoothstep(-across[0] * np.cos(angle) - across[1] * np.sin(angle), -0.6, 0.5)
    radius = np.linspace(0.97, 1.0 + GLOW, outward)
    above = np.clip((radius - 1.0) / GLOW, 0.0, 1.0)
    fade = np.exp(-4.5 * above) * (1.0 - above)
    fade[:2] = 0.0  # behind the planet: the texture repeats, and its outer edge shall stay black
    return _bytes(fade[:, None, None] * day[:, None] * _HAZE)


def _noise(generator: np.random.Generator, side: int, decay: float, first: int) -> Fields:
    """Two fields (2, side, side) of noise with mean 0 and deviation 1 that repeat at their edges.

    Their amplitude falls with the power `decay` of the frequency from `first` periods a side on.
    """
    random = generator.standard_normal((2, side, side), dtype=np.float32)
    cycles = np.fft.fftfreq(side, 1.0 / side).astype(np.float32)
    amplitude = np.maximum(np.hypot(cycles[:, None], cycles), first) ** -decay
    amplitude[0, 0] = 0.0
    wave = ifft2((random[0] + 1j * random[1]) * amplitude)
    fields = np.stack([wave.real, wave.imag])
    return fields / fields.std(axis=(1, 2), keepdims=True)


def _smoothstep(value: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    """From 0 below `low` to 1 above `high`, smooth between."""
    part = np.clip((value - low) / (high - low), 0.0, 1.0)
    return part * part * (3.0 - 2.0 * part)


def _bytes(colour: NDArray[np.float64]) -> Texture:
    return np.round(255 * np.clip(colour, 0.0, 1.0)).astype(np.uint8)
