"""Visual geometry of what one arm captures and avoids: no mass and no collisions."""

from math import cos, pi, sin

import mujoco

from space_envs.scenery.parts import (
    draw_ring,
)
from space_envs.scenery.shapes import Brush, Vector, add_crumpled_box

_KEEP_OUT_WIRE = 0.007  # m, radius
_MERIDIANS = [pi * number / 3 for number in range(3)]  # rad, of a keep-out sphere's cage


def draw_keep_out(spec: mujoco.MjSpec) -> None:
    """Draw the sphere of every body `obstacle{i}`, whose radius is that of its site `obstacle{i}_surface`.

    It is a cage of rings, which hides neither the arm nor the goal behind it.
    """
    half = sin(pi / 4)
    rotations = [(cos(pi / 4), cos(angle) * half, sin(angle) * half, 0.0) for angle in _MERIDIANS]
    for body in spec.bodies:
        if body.name.startswith("obstacle"):
            cage, radius = Brush(body), float(spec.site(f"{body.name}_surface").pos[0])
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


def draw_target(spec: mujoco.MjSpec, scale: float) -> None:
    """Draw a defunct satellite with its grapple bar at the origin of the body `target`; it extends along +y.

    Args:
        scale: of its size. Its nozzle and dish are left out where it is not 1.
    """
    debris = Brush(spec.body("target"), scale=scale)
    add_crumpled_box(
        spec, "debris_foil", [0.6 * scale, 0.7 * scale, 0.6 * scale], depth=0.02 * scale, cells=9
    )
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
    if scale == 1.0:
        debris.mesh("scorched", "nozzle", (0, far + 0.24, 0), (cos(pi / 4), sin(pi / 4), 0, 0))
        debris.mesh("white_paint", "small_dish", (0.08, middle, -0.38), (0, 1, 0, 0))
