"""Colors, foils, skies and sunlight of the drawings, all of them procedural."""

import mujoco

from space_envs.scenery.planet import add_planet

# name: (red, green, blue, alpha), specular, shininess, emission
PLAIN = {
    "gold_foil": ((0.88, 0.60, 0.16, 1.0), 0.9, 0.75, 0.0),
    "silver_foil": ((0.62, 0.63, 0.66, 1.0), 1.0, 0.8, 0.0),
    "white_paint": ((0.93, 0.93, 0.91, 1.0), 0.35, 0.4, 0.0),
    "grey_paint": ((0.55, 0.56, 0.58, 1.0), 0.3, 0.3, 0.0),
    "dark_metal": ((0.13, 0.135, 0.15, 1.0), 0.7, 0.55, 0.0),
    "aluminium": ((0.72, 0.74, 0.77, 1.0), 0.9, 0.7, 0.0),
    "titanium": ((0.40, 0.38, 0.36, 1.0), 0.8, 0.6, 0.0),
    "scorched": ((0.30, 0.25, 0.21, 1.0), 0.3, 0.3, 0.0),
    "warning": ((0.95, 0.42, 0.06, 1.0), 0.4, 0.4, 0.15),
    "blue_mark": ((0.06, 0.22, 0.62, 1.0), 0.4, 0.4, 0.1),
    "glass": ((0.03, 0.05, 0.10, 1.0), 1.0, 0.95, 0.0),
    "lamp": ((1.0, 0.25, 0.15, 1.0), 0.2, 0.2, 1.0),
    "keep_out": ((1.0, 0.16, 0.12, 1.0), 0.3, 0.5, 0.6),
}


def add_space(
    spec: mujoco.MjSpec,
    earth: tuple[float, float, float],
    sun: tuple[float, float, float] = (-0.50, 0.45, -0.74),
) -> None:
    """Add materials, stars, a planet, sunlight, and settings of the renderer.

    Args:
        spec: to add to.
        earth: centre of the planet, inertial frame, m.
        sun: direction in which sunlight travels, inertial frame.
    """
    add_materials(spec)
    add_sky(spec)
    add_planet(spec, earth, radius=305.0, sun=sun)
    add_sunlight(spec, sun)


def _textured(spec: mujoco.MjSpec, name: str, texture: str, repeat: tuple[float, float], **rest) -> None:
    material = spec.add_material(name=name, texrepeat=repeat, **rest)
    material.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = texture


def add_materials(spec: mujoco.MjSpec) -> None:
    """Add all materials of the visual geometry."""
    for name, (rgba, specular, shininess, emission) in PLAIN.items():
        spec.add_material(name=name, rgba=rgba, specular=specular, shininess=shininess, emission=emission)

    flat, edge = mujoco.mjtBuiltin.mjBUILTIN_FLAT, mujoco.mjtMark.mjMARK_EDGE
    plane = mujoco.mjtTexture.mjTEXTURE_2D
    cell = {"type": plane, "builtin": flat, "mark": edge, "width": 64, "height": 64}
    spec.add_texture(name="cell", rgb1=[0.02, 0.05, 0.20], markrgb=[0.45, 0.48, 0.55], **cell)
    spec.add_texture(name="dead_cell", rgb1=[0.10, 0.11, 0.17], markrgb=[0.42, 0.39, 0.34], **cell)
    spec.add_texture(name="mirror", rgb1=[0.70, 0.75, 0.80], markrgb=[0.40, 0.42, 0.45], **cell)
    _textured(spec, "solar_cells", "cell", (4, 5), specular=0.9, shininess=0.8)
    _textured(spec, "dead_cells", "dead_cell", (3, 4), specular=0.5, shininess=0.5)
    _textured(spec, "radiator", "mirror", (5, 5), specular=1.0, shininess=0.9)


def add_sunlight(spec: mujoco.MjSpec, direction: tuple[float, float, float]) -> None:
    """Add sunlight along a direction, ambient light, and the quality of shadows."""
    spec.worldbody.add_light(
        name="sun",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[-8 * part for part in direction],
        dir=direction,
        ambient=[0.0, 0.0, 0.0],
        diffuse=[0.95, 0.93, 0.88],
        specular=[0.6, 0.58, 0.5],
        castshadow=True,
    )
    spec.visual.headlight.ambient = [0.10, 0.11, 0.13]
    spec.visual.headlight.diffuse = [0.30, 0.30, 0.32]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.visual.quality.shadowsize = 2048
    spec.visual.quality.numslices = 20
    spec.visual.quality.numstacks = 10
    spec.visual.map.shadowclip = 1.0
    spec.visual.map.znear = 0.01
    spec.visual.map.zfar = 300.0  # times the extent: the sky is drawn nearer, and must not hide the horizon


def add_sky(spec: mujoco.MjSpec) -> None:
    """Add black space with stars."""
    spec.add_texture(
        name="stars",
        type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_FLAT,
        mark=mujoco.mjtMark.mjMARK_RANDOM,
        rgb1=[0.0, 0.0, 0.004],
        rgb2=[0.0, 0.0, 0.004],
        markrgb=[0.85, 0.88, 1.0],
        random=0.0015,
        width=800,
        height=800,
    )
