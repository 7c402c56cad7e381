"""Visual geometry of the dual-arm models: no mass and no collisions."""

from math import cos, pi, sin

import mujoco
import numpy as np

from space_envs.errors import ConfigurationError
from space_envs.scenery.parts import (
    draw_arm_deck,
    draw_boom,
    draw_bus,
    draw_hand,
    draw_joint,
    draw_wing,
)
from space_envs.scenery.shapes import Brush, Vector, add_crumpled_box, rotation_to

_ARM_SCALE = 0.5  # of joints and hands, relative to the single arm
_PLANAR_DECK = -0.34  # m, z of the deck that the planar arms rotate above
_PLANAR_TARGET = -0.30  # m, z of the target's middle, below the arms
_HALF_X = (0.0, 1.0, 0.0, 0.0)  # z becomes -z


def draw_planar(spec: mujoco.MjSpec, side: float, link_radius: float, target_half: Vector) -> None:
    """Draw the planar robot and its target: the arms rotate in z = 0, above the bus and above the target.

    Args:
        spec: with bodies `satellite`, `arm{a}_link{i}` and `target`, and the sites of hands and grapples.
        side: of the satellite's cube, m. link_radius: m. target_half: (3,) half sides of the target, m.
    """
    bus = Brush(spec.body("satellite")).at((0.0, 0.0, _PLANAR_DECK - side / 2))
    _draw_satellite(spec, bus, side)
    for arm in (1, 2):
        x, y, _ = spec.body(f"arm{arm}_link1").pos.tolist()
        _draw_tower(bus.at((0.0, 0.0, side / 2)), (x, y), -_PLANAR_DECK, 0.36 * side)
    for arm in (1, 2):  # hands come down on the fixtures
        _draw_arm(spec, arm, link_radius, _HALF_X)

    target = Brush(spec.body("target"))
    _draw_debris(target.at((0.0, 0.0, _PLANAR_TARGET)), target_half)
    _, wide, high = target_half
    half = float(np.linalg.norm(spec.site("grapple1").pos))
    for sign in (-1.0, 1.0):
        foot = (0.0, sign * half, _PLANAR_TARGET + 0.5 * high)
        target.rod("titanium", (0.0, sign * wide, foot[2]), foot, 0.02, round_ends=True)
        target.rod("aluminium", foot, (0.0, sign * half, -0.17), 0.03)
        _draw_fixture(target.at((0.0, sign * half, 0.0), _HALF_X))


def draw_spatial_target(spec: mujoco.MjSpec, target_half: Vector) -> None:
    """Draw the target of two arms in space, with half sides (3,) in m, on the body `target`."""
    target = Brush(spec.body("target"))
    _draw_debris(target, target_half)
    for name in ("grapple1", "grapple2"):
        site = spec.site(name)
        _draw_fixture(target.at(site.pos, site.quat))


def scale_target(model: mujoco.MjModel, half_width: float) -> None:
    """Scale the geoms and sites of the target of a model for rendering, in place.

    Args:
        model: compiled after `draw_planar` or `draw_spatial_target`; must not be shared.
        half_width: new distance of the grapple points from the target's centre, m.

    Raises:
        ConfigurationError: if half_width is not positive and finite.
    """
    if not 0 < half_width < np.inf:
        raise ConfigurationError(f"half_width must be positive and finite, got {half_width!r}")
    target = model.body("target").id
    ratio = half_width / float(np.linalg.norm(model.site("grapple1").pos))
    geoms, sites = model.geom_bodyid == target, model.site_bodyid == target
    for lengths in (model.geom_pos, model.geom_size, model.geom_rbound, model.geom_aabb):
        lengths[geoms] *= ratio
    model.site_pos[sites] *= ratio


def _draw_satellite(spec: mujoco.MjSpec, bus: Brush, side: float) -> None:
    draw_bus(bus, side)
    draw_arm_deck(bus, side)
    for sign in (-1.0, 1.0):
        draw_wing(bus, side, sign, panels=2)
    add_crumpled_box(spec, "bus_foil", [side * 0.97] * 3, depth=0.022 * side)


def _draw_tower(deck: Brush, mount: tuple[float, float], height: float, inside: float) -> None:
    """Draw the tower that carries a planar arm, on a bracket where there is no deck below the mount."""
    x, y = mount
    foot = (float(np.clip(x, -inside, inside)), float(np.clip(y, -inside, inside)))
    top = height - 0.155 * _ARM_SCALE
    if np.hypot(x - foot[0], y - foot[1]) > 0.02:
        deck.rod("titanium", (*foot, 0.05), (x, y, 0.05), 0.05, round_ends=True)
        deck.rod("titanium", (*foot, 0.03), (x, y, 0.6 * top), 0.03, round_ends=True)
    deck.rod("aluminium", (*foot, 0.0), (*foot, 0.03), 0.12)
    deck.rod("dark_metal", (x, y, 0.0), (x, y, 0.10), 0.095)
    deck.rod("white_paint", (x, y, 0.10), (x, y, top - 0.03), 0.075)
    deck.rod("warning", (x, y, top - 0.06), (x, y, top - 0.045), 0.078)
    deck.rod("aluminium", (x, y, top - 0.03), (x, y, top), 0.09)


def _draw_arm(spec: mujoco.MjSpec, arm: int, radius: float, grip: Vector) -> None:
    """Draw joints, booms and the hand of an arm.

    `grip` is the hand's rotation in the frame of its site: it closes along its own z axis.
    """
    names = {body.name for body in spec.bodies}
    count = sum(name.startswith(f"arm{arm}_link") for name in names)
    for number in range(1, count + 1):
        link = spec.body(f"arm{arm}_link{number}")
        body = Brush(link, scale=_ARM_SCALE)
        draw_joint(body)
        if number < count:
            end = np.array(spec.body(f"arm{arm}_link{number + 1}").pos)
        else:  # the hand reaches the site from the side that it closes from
            site = spec.site(f"end_effector{arm}")
            hand = Brush(link).at(site.pos, site.quat).at((0.0, 0.0, 0.0), grip, _ARM_SCALE)
            end = np.array(hand.at((0.0, 0.0, -0.30)).origin)
            draw_hand(hand, f"end_effector{arm}", fingers=3)
            body.ellipsoid("dark_metal", (end / _ARM_SCALE).tolist(), (0.11, 0.11, 0.11))
        if end.any():
            draw_boom(body, (end / _ARM_SCALE).tolist(), radius / _ARM_SCALE)


def _draw_fixture(grapple: Brush) -> None:
    """Draw a knob in the origin on a post that runs along +z, to a plate with marks for the camera."""
    grapple.ellipsoid("warning", (0, 0, 0), (0.017, 0.017, 0.017))
    grapple.rod("aluminium", (0, 0, 0), (0, 0, 0.09), 0.011)
    grapple.rod("white_paint", (0, 0, 0.09), (0, 0, 0.10), 0.085)
    for number in range(3):
        u, v = 0.06 * cos(2 * pi * number / 3), 0.06 * sin(2 * pi * number / 3)
        grapple.rod("dark_metal", (u, v, 0.086), (u, v, 0.09), 0.014)


def _draw_debris(target: Brush, half_sides: Vector) -> None:
    """Draw a defunct satellite around the origin, without meshes, which `scale_target` cannot scale.

    Its box has these half sides in m; the remains of its wings are at +y and -y, across the grapple points
    if these are at +x and -x.
    """
    half = np.array(half_sides)
    x, y, z = half.tolist()
    target.box("silver_foil", (0, 0, 0), (1.94 * half).tolist())
    _draw_quilt(target, half)
    for axis in range(3):  # twelve edges
        for u in (-1.0, 1.0):
            for v in (-1.0, 1.0):
                middle, size = np.zeros(3), np.full(3, 0.022)
                middle[[(axis + 1) % 3, (axis + 2) % 3]] = u, v
                size[axis] = 2 * half[axis] + 0.022
                target.box("titanium", (middle * half).tolist(), size.tolist())
    target.box("scorched", (0.3 * x, 0.25 * y, z), (0.8 * x, y, 0.014))
    target.box("radiator", (-0.45 * x, -0.4 * y, z + 0.002), (0.7 * x, 0.8 * y, 0.014))
    target.rod("dark_metal", (-0.45 * x, 0.55 * y, z), (-0.45 * x, 0.55 * y, z + 0.012), 0.05)
    target.rod("white_paint", (0.55 * x, -0.65 * y, z), (0.62 * x, -0.7 * y, z + 0.035), 0.035)

    # Engine below: a cone of rings.
    target.rod("dark_metal", (0, 0, -z), (0, 0, -z - 0.03), 0.09)
    for ring in range(6):
        top = -z - 0.03 - 0.02 * ring
        target.rod("scorched", (0, 0, top), (0, 0, top - 0.02), 0.035 + 0.009 * ring)


def _draw_quilt(target: Brush, half: np.ndarray, tiles: int = 3) -> None:
    """Draw a foil blanket on a box: slightly rotated tiles with separate reflections."""
    generator = np.random.default_rng(2)  # a picture must not depend on a seed
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for sign in (-1.0, 1.0):
            for row in range(tiles):
                for column in range(tiles):
                    middle, size = np.zeros(3), np.full(3, 0.012)
                    middle[axis] = sign * (half[axis] - 0.006)
                    middle[first] = half[first] * ((2 * row + 1) / tiles - 1)
                    middle[second] = half[second] * ((2 * column + 1) / tiles - 1)
                    size[[first, second]] = 2 * half[[first, second]] / tiles
                    normal = generator.normal(0.0, 0.06, 3)
                    normal[axis] = sign
                    toward = np.zeros(3)
                    toward[axis] = sign
                    quat = rotation_to(normal.tolist(), toward.tolist())
                    target.box("silver_foil", middle.tolist(), size.tolist(), quat)
