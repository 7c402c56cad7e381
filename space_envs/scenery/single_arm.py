"""Visual geometry of the single-arm model: no mass and no collisions.

Materials and meshes are added by `draw_environment`, so a spec needs all three calls.
"""

from math import cos, pi, sin

import mujoco

from space_envs.scenery.materials import add_space
from space_envs.scenery.parts import (
    add_part_meshes,
    add_views,
    draw_arm_deck,
    draw_boom,
    draw_bus,
    draw_hand,
    draw_joint,
    draw_ring,
    draw_wing,
)
from space_envs.scenery.shapes import Brush, Vector, add_crumpled_box

_KEEP_OUT_WIRE = 0.007  # m, radius
_MERIDIANS = [pi * number / 3 for number in range(3)]  # rad, of a keep-out sphere's cage


def draw_robot(spec: mujoco.MjSpec, side: float, link_radius: float) -> None:
    """Draw the satellite and the arm on the bodies `satellite`, `link1`, `link2`, ... and `end_effector`.

    Args:
        side: of the satellite's cube, m. link_radius: m.
    """
    bus = Brush(spec.body("satellite"))
    draw_bus(bus, side)
    draw_arm_deck(bus, side)
    bus.rod("aluminium", (0, 0, side / 2), (0, 0, side / 2 + 0.02), 0.24)
    for sign in (-1.0, 1.0):
        draw_wing(bus, side, sign)
    add_crumpled_box(spec, "bus_foil", [side * 0.97] * 3, depth=0.022 * side)

    links = [body for body in spec.bodies if body.name.startswith("link")]
    ends = [tuple(link.pos.tolist()) for link in [*links[1:], spec.site("end_effector")]]
    for number, (link, end) in enumerate(zip(links, ends, strict=True), start=1):
        body, last = Brush(link), number == len(links)
        if number == 1:  # from the satellite's centre to its face: only what stands out can be seen
            body.rod("dark_metal", (0, 0, end[2] - 0.02), (0, 0, end[2] + 0.03), 0.19)
            continue
        draw_joint(body)
        if any(end):
            draw_boom(body, end, link_radius, shorten=0.30 if last else 0.0)
        if last:
            draw_hand(body.at((0.0, 0.0, end[2])), "end_effector", fingers=2)


def draw_keep_out(spec: mujoco.MjSpec, radius: float) -> None:
    """Draw a sphere of this radius in m on every body `obstacle{i}`.

    It is a cage of rings, which hides neither the arm nor the goal behind it.
    """
    half = sin(pi / 4)
    rotations = [(cos(pi / 4), cos(angle) * half, sin(angle) * half, 0.0) for angle in _MERIDIANS]
    for body in spec.bodies:
        if body.name.startswith("obstacle"):
            cage = Brush(body)
            for rotation in ((1.0, 0.0, 0.0, 0.0), *rotations):
                draw_ring(cage.at((0, 0, 0), rotation), "keep_out", radius, _KEEP_OUT_WIRE)


def resize_keep_out(model: mujoco.MjModel, radius: Vector) -> None:
    """Set the radii in m of the spheres of `draw_keep_out`, in place."""
    for number, size in enumerate(radius, start=1):
        body, surface = model.body(f"obstacle{number}"), model.site(f"obstacle{number}_surface")
        geoms = slice(int(body.geomadr[0]), int(body.geomadr[0] + body.geomnum[0]))
        ratio = size / surface.pos[0]
        for lengths in (model.geom_pos, model.geom_size, model.geom_rbound, model.geom_aabb):
            lengths[geoms] *= ratio
        surface.pos[0] = size


def draw_target(target: mujoco.MjsBody) -> None:
    """Draw a defunct satellite with its grapple bar at the body's origin; it extends along +y from there."""
    debris = Brush(target)
    # Grapple fixture: a bar along x between two posts, on a plate with marks for the camera.
    debris.rod("warning", (-0.07, 0, 0), (0.07, 0, 0), 0.02)
    for sign in (-1.0, 1.0):
        debris.rod("aluminium", (sign * 0.07, 0, 0), (sign * 0.07, 0.15, 0), 0.014)
        debris.ellipsoid("aluminium", (sign * 0.07, 0, 0), (0.024, 0.024, 0.024))
    debris.box("white_paint", (0, 0.155, 0), (0.34, 0.02, 0.34))
    for u in (-0.13, 0.13):
        for v in (-0.13, 0.13):
            debris.rod("dark_metal", (u, 0.143, v), (u, 0.146, v), 0.025)

    near, far = 0.17, 0.87
    middle = (near + far) / 2
    debris.mesh("silver_foil", "debris_foil", (0, middle, 0))
    for u in (-0.3, 0.3):
        for v in (-0.3, 0.3):
            debris.box("titanium", (u, middle, v), (0.03, 0.72, 0.03))
    for y in (near, far):
        for v in (-0.3, 0.3):
            debris.box("titanium", (0, y, v), (0.62, 0.03, 0.03))
            debris.box("titanium", (v, y, 0), (0.03, 0.03, 0.62))
    debris.box("scorched", (0.05, middle + 0.05, 0.30), (0.36, 0.4, 0.02))
    debris.mesh("scorched", "nozzle", (0, far + 0.24, 0), (cos(pi / 4), sin(pi / 4), 0, 0))
    debris.rod("dark_metal", (0, far, 0), (0, far + 0.04, 0), 0.16)
    debris.rod("aluminium", (-0.2, far, 0.2), (-0.34, far + 0.3, 0.42), 0.008)

    # One wing bent at its hinge, the other torn off at the yoke.
    debris.rod("aluminium", (0.3, middle, 0), (0.46, middle, 0.0), 0.022)
    debris.box("dead_cells", (0.70, middle, 0.02), (0.46, 0.5, 0.014), (cos(0.04), 0, -sin(0.04), 0))
    debris.box(
        "dead_cells", (1.10, middle + 0.02, 0.20), (0.42, 0.5, 0.014), (cos(0.33), 0.05, -sin(0.33), 0.04)
    )
    debris.rod("aluminium", (-0.3, middle, 0), (-0.42, middle + 0.04, 0.05), 0.022)
    debris.box(
        "dead_cells", (-0.47, middle + 0.09, 0.07), (0.13, 0.24, 0.014), (cos(0.3), 0.1, sin(0.3), 0.15)
    )
    debris.mesh("white_paint", "small_dish", (0.08, middle, -0.38), (0, 1, 0, 0))


def draw_environment(spec: mujoco.MjSpec) -> None:
    """Add materials, meshes, sky, sun the cameras `overview` and `chase`, and render settings."""
    add_space(spec, earth=(-370.0, 110.0, -340.0))
    add_crumpled_box(spec, "debris_foil", [0.6, 0.7, 0.6], depth=0.02, cells=9)
    add_part_meshes(spec)
    spec.stat.extent = 5.0
    spec.stat.center = [0.0, 0.8, 1.0]

    add_views(
        spec,
        overview=((7.51, -0.82, 5.53), (-0.5, 0.31, 1.76)),
        chase=((4.76, 5.48, 4.87), (0.69, 1.42, 1.55)),
    )
