"""The planet behind the drawings: clouds over an ocean and the glow of its atmosphere, painted by numpy.

The cameras stay within a few metres of the origin and the planet is hundreds away, so only one side is
visible. The textures are painted for that side: `u` and `v` of its mesh are polar coordinates about
the point below the origin, with the angle from there as radius.
"""

from functools import lru_cache

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.fft import ifft2

from space_envs.scenery.shapes import Vector, rotation_to

PLANET = "planet"
ATMOSPHERE = "atmosphere"
TEXTURE_SIDE = 1024  # pixels, of the visible side
PAINTED = 1.15  # rad, angle from the point below the origin to the texture's edge: beyond the horizon
RINGS, SIDES = 96, 144  # of the planet's mesh
GLOW = 0.045  # of the horizon's radius, height of the glow above it
_REFLECTED = 0.01  # share of the light, by the planet's materials
_GLOW_PIXELS = (32, 256)  # of the glow's texture: outward, around
_OCEAN = np.array([0.02, 0.10, 0.28])
_SHALLOWS = np.array([0.05, 0.23, 0.43])
_CLOUD = np.array([0.72, 0.77, 0.84])
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
    rotation = rotation_to([-part for part in pos])
    light = _in_mesh_axes(sun, rotation)
    _add_textured(spec, PLANET, _planet_pixels(round(horizon, 6), light))
    _add_sphere(spec, radius)
    _add_textured(spec, ATMOSPHERE, _glow_pixels(light))
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
            quat=rotation,
            mass=0,
            contype=0,
            conaffinity=0,
            group=1,
        )


def make_plain(spec: mujoco.MjSpec) -> None:
    """Give the planet and its glow one color each in a drawn spec: MJCF text cannot hold painted pixels."""
    for name, color in ((PLANET, _OCEAN), (ATMOSPHERE, np.zeros(3))):
        texture = spec.texture(name)
        texture.data = b""
        texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
        texture.width = texture.height = 8
        texture.rgb1 = texture.rgb2 = color
        spec.material(name).emission, spec.material(name).rgba = 0.0, [1.0, 1.0, 1.0, 1.0]


def _in_mesh_axes(sun: Vector, rotation: Vector) -> tuple[float, float, float]:
    """Unit vector of the sunlight's direction in the axes of the planet's mesh."""
    inverse, seen = np.zeros(4), np.zeros(3)
    mujoco.mju_negQuat(inverse, np.asarray(rotation, dtype=float))
    mujoco.mju_rotVecQuat(seen, np.asarray(sun, dtype=float) / np.linalg.norm(sun), inverse)
    x, y, z = seen.round(6).tolist()
    return x, y, z


def _add_textured(spec: mujoco.MjSpec, name: str, pixels: Texture) -> None:
    """Add a texture and a material that shows it as it is: day and night are painted.

    It reflects next to nothing, so that the robot throws no shadow onto a planet that far away.
    """
    height, width, channels = pixels.shape
    flat = mujoco.mjtTexture.mjTEXTURE_2D
    texture = spec.add_texture(name=name, type=flat, width=width, height=height, nchannel=channels)
    texture.data = pixels.tobytes()
    material = spec.add_material(name=name, specular=0.0, shininess=0.0)
    material.rgba = [_REFLECTED, _REFLECTED, _REFLECTED, 1.0]
    material.emission = 1.0 / _REFLECTED  # OpenGL multiplies it by the color
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = name


def _add_sphere(spec: mujoco.MjSpec, radius: float) -> None:
    """Add a sphere whose +z half carries the texture; the other half, which is not visible, mirrors it."""
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
def _planet_pixels(horizon: float, light: tuple[float, float, float]) -> Texture:
    """(TEXTURE_SIDE, TEXTURE_SIDE, 3) colors of ocean, cloud and haze by day and night.

    Args:
        horizon: rad, angle from the point below the origin to the visible edge of the planet.
        light: unit vector in which sunlight travels, axes of the planet's mesh.
    """
    generator = np.random.default_rng(7)  # a picture must not depend on a seed
    side = TEXTURE_SIDE
    across, along = _noise(generator, side, decay=2.6, first=4)
    weather, detail = _noise(generator, side, decay=1.9, first=5)[0], _noise(generator, side, 1.5, 24)[0]
    rows, columns = np.indices((side, side), dtype=np.int32)
    reach = 0.03 * side  # pixels that winds carry the clouds
    carried = (rows + reach * across).astype(int) % side, (columns + reach * along).astype(int) % side
    cloud = _smoothstep(0.75 * weather[carried] + 0.45 * detail, 0.0, 1.9)[..., None]
    ground = _OCEAN + _smoothstep(across, 0.2, 1.8)[..., None] * (_SHALLOWS - _OCEAN)
    color = ground + cloud * (_CLOUD - ground)
    middle = (side - 1) / 2
    u, v = (columns - middle) / middle, (rows - middle) / middle
    angle = PAINTED * np.hypot(u, v)
    outward = np.sin(angle) / np.maximum(np.hypot(u, v), 1e-9)
    facing = -(light[0] * outward * u + light[1] * outward * v + light[2] * np.cos(angle))
    day = (0.08 + 0.92 * _smoothstep(facing, -0.1, 0.9))[..., None]
    height = np.sin(np.minimum(angle, horizon)) / np.sin(horizon)  # across the line of sight
    haze = 0.85 * height[..., None] ** 14
    return _bytes(day * (color + haze * (_HAZE - color)))


@lru_cache(maxsize=4)
def _glow_pixels(light: tuple[float, float, float]) -> Texture:
    """Colors (outward, around, 3) of the atmosphere above the horizon, bright where the sun shines."""
    outward, around = _GLOW_PIXELS
    angle = 2 * np.pi * (np.arange(around) + 0.5) / around
    day = 0.25 + 0.75 * _smoothstep(-light[0] * np.cos(angle) - light[1] * np.sin(angle), -0.6, 0.5)
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
    wave = np.asarray(ifft2((random[0] + 1j * random[1]) * amplitude))
    fields = np.stack([np.real(wave), np.imag(wave)])
    return fields / fields.std(axis=(1, 2), keepdims=True)


def _smoothstep(value: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
    """From 0 below `low` to 1 above `high`, smooth between."""
    part = np.clip((value - low) / (high - low), 0.0, 1.0)
    return part * part * (3.0 - 2.0 * part)


def _bytes(color: NDArray[np.float64]) -> Texture:
    return np.round(255 * np.clip(color, 0.0, 1.0)).astype(np.uint8)
