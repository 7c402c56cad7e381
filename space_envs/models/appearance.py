"""How the models look: geometry without mass that never collides.

The drawings name materials and meshes that `draw_environment` adds, so a spec needs all three calls.
"""

from math import cos, pi, sin

import mujoco
import numpy as np

from space_envs.models.materials import add_earth, add_materials, add_sky
from space_envs.models.parameters import DHLink, SingleArmParameters
from space_envs.models.shapes import Brush, add_crumpled_box, add_revolved, look_at

SUN = (-0.50, 0.45, -0.74)  # the way its light travels, inertial frame
JOINT_RADIUS = 0.115  # m, housings of the motors; links are drawn with parameters.link_radius


def draw_robot(spec: mujoco.MjSpec, parameters: SingleArmParameters) -> None:
    """Draw the satellite and the arm on the bodies `satellite` and `link1` to `link7`."""
    side = parameters.satellite_side
    bus = Brush(spec.body("satellite"))
    _draw_bus(bus, side)
    for sign in (-1.0, 1.0):
        _draw_wing(bus, side, sign)
    add_crumpled_box(spec, "bus_foil", [side * 0.97] * 3, depth=0.022 * side)

    for number, link in enumerate(parameters.links, start=1):
        body = Brush(spec.body(f"link{number}"))
        if number == 1:  # from the satellite's centre to its face: only what stands out can be seen
            body.rod("dark_metal", (0, 0, link.d - 0.02), (0, 0, link.d + 0.03), 0.19)
            continue
        _draw_joint(body)
        last = number == len(parameters.links)
        _draw_link(body, link, parameters.link_radius, shorten=0.30 if last else 0.0)
    hand = spec.body(f"link{len(parameters.links)}")
    _draw_gripper(Brush(hand), parameters.links[-1].d)
    hand.add_camera(
        name="end_effector",
        pos=[0.18, 0.0, parameters.links[-1].d - 0.25],
        quat=look_at((0.18, 0.0, -0.25), (0.02, 0.0, 0.30), up=(1.0, 0.0, 0.0)),
        fovy=70,
    )


def _draw_bus(bus: Brush, side: float) -> None:
    h = side / 2
    bus.mesh("gold_foil", "bus_foil")
    for u in (-h, h):  # the frame: twelve edges
        for v in (-h, h):
            bus.box("aluminium", (0, u, v), (side + 0.03, 0.03, 0.03))
            bus.box("aluminium", (u, 0, v), (0.03, side + 0.03, 0.03))
            bus.box("aluminium", (u, v, 0), (0.03, 0.03, side + 0.03))
    bus.box("grey_paint", (0, 0, h), (0.62 * side, 0.62 * side, 0.02))  # deck of the arm
    for u in (-0.26 * side, 0.26 * side):
        for v in (-0.26 * side, 0.26 * side):
            bus.rod("dark_metal", (u, v, h), (u, v, h + 0.025), 0.02)
    bus.rod("aluminium", (0, 0, h), (0, 0, h + 0.02), 0.24)
    bus.box("radiator", (h, 0.13 * side, 0.10 * side), (0.025, 0.56 * side, 0.62 * side))
    bus.box("white_paint", (h, -0.33 * side, 0.22 * side), (0.05, 0.2 * side, 0.28 * side))  # electronics
    bus.box("blue_mark", (h + 0.026, -0.33 * side, 0.29 * side), (0.004, 0.14 * side, 0.05 * side))
    for u in (-0.25, 0.05):
        bus.box("dark_metal", (h, u * side - 0.05, -0.36 * side), (0.03, 0.22 * side, 0.10 * side))

    # Star tracker: two baffles on a bracket at the corner of the deck.
    bus.box("dark_metal", (0.36 * side, -0.36 * side, h + 0.04), (0.14, 0.14, 0.06))
    for tilt in (-0.5, 0.5):
        base = np.array([0.36 * side, -0.36 * side, h + 0.06])
        way = np.array([0.5 * tilt, -0.35, 0.8])
        tip = base + 0.20 * way
        bus.rod("white_paint", base.tolist(), tip.tolist(), 0.045)
        bus.rod("glass", tip.tolist(), (tip + 0.004 * way).tolist(), 0.038)
    # Lidar and cameras of the rendezvous sensor look along +y.
    bus.box("dark_metal", (0.3 * side, h - 0.02, h + 0.06), (0.2, 0.16, 0.10))
    for u in (0.25, 0.35):
        bus.rod("glass", (u * side, h + 0.05, h + 0.065), (u * side, h + 0.075, h + 0.065), 0.034)

    # High-gain antenna: dish on a boom below the -x edge, and two whip antennas.
    foot, dish = (-h, -0.25 * side, -h), (-h - 0.28, -0.45 * side, -h - 0.34)
    bus.rod("aluminium", foot, dish, 0.022)
    bus.mesh("white_paint", "dish", dish, look_at((0, 0, 0), (0.6, 0.8, 0.7)))
    bus.rod("aluminium", (h - 0.05, h - 0.05, -h), (h + 0.12, h + 0.1, -h - 0.42), 0.008)
    bus.rod("aluminium", (h - 0.05, -h + 0.05, -h), (h + 0.12, -h - 0.1, -h - 0.42), 0.008)

    # Main engine below, thrusters in pairs at the corners.
    bus.mesh("titanium", "nozzle", (0, 0, -h - 0.26))
    bus.rod("dark_metal", (0, 0, -h - 0.05), (0, 0, -h), 0.2)
    for u in (-h, h):
        for v in (-h, h):
            bus.box("dark_metal", (u * 1.03, v * 1.03, -h * 0.86), (0.09, 0.09, 0.09))
            for way in ((np.sign(u), 0), (0, np.sign(v))):
                start = (u * 1.03, v * 1.03, -h * 0.86)
                end = (u * 1.03 + 0.10 * way[0], v * 1.03 + 0.10 * way[1], -h * 0.86)
                bus.rod("titanium", start, end, 0.024)


def _draw_wing(bus: Brush, side: float, sign: float) -> None:
    """Draw a wing of three panels along +y or -y, below the arm's workspace and tilted to the sun."""
    h, z = side / 2, -0.25 * side
    length, width, gap = 0.78 * side, 0.92 * side, 0.025
    tilt = 0.42  # rad about y
    quat = (cos(tilt / 2), 0.0, sin(tilt / 2), 0.0)
    across = np.array([cos(tilt), 0.0, -sin(tilt)])
    normal = np.array([sin(tilt), 0.0, cos(tilt)])
    root = h + 0.42
    bus.rod("dark_metal", (0, sign * h, z), (0, sign * (h + 0.10), z), 0.075)  # drive
    bus.rod("aluminium", (0, sign * h, z), (0, sign * (h + 0.2), z), 0.03)
    for u in (-1.0, 1.0):  # yoke
        corner = np.array([0, sign * root, z]) + u * 0.42 * width * across
        bus.rod("aluminium", (0, sign * (h + 0.18), z), corner.tolist(), 0.018)
    for panel in range(3):
        middle = np.array([0, sign * (root + length / 2 + panel * (length + gap)), z])
        bus.box("aluminium", middle.tolist(), (width, length, 0.018), quat)
        cells = (middle + 0.011 * normal).tolist()
        bus.box("solar_cells", cells, (width - 0.04, length - 0.04, 0.006), quat)
        if panel:
            for u in (-0.35, 0.35):
                hinge = middle - np.array([0, sign * (length + gap) / 2, 0]) + u * width * across
                bus.box("dark_metal", hinge.tolist(), (0.06, 0.05, 0.03), quat)
    tip = np.array([0, sign * (root + 3 * length + 2 * gap), z]) - 0.5 * width * across
    bus.ball("lamp", tip.tolist(), (0.02, 0.02, 0.02))


def _draw_joint(body: Brush) -> None:
    """Draw the housing of the motor that turns this body about its z axis."""
    body.rod("dark_metal", (0, 0, -0.13), (0, 0, 0.13), JOINT_RADIUS)
    for sign in (-1.0, 1.0):
        body.rod("aluminium", (0, 0, sign * 0.13), (0, 0, sign * 0.145), 0.9 * JOINT_RADIUS)
        body.rod("dark_metal", (0, 0, sign * 0.145), (0, 0, sign * 0.155), 0.45 * JOINT_RADIUS)
    body.rod("grey_paint", (0, 0, -0.02), (0, 0, 0.02), 1.03 * JOINT_RADIUS)


def _draw_link(body: Brush, link: DHLink, radius: float, shorten: float) -> None:
    """Draw a boom from the body's origin to that of the next DH frame, `shorten` metres less."""
    if link.length == 0:
        return
    along = np.array([link.a, 0.0, link.d]) / link.length
    length = link.length - shorten

    def ring(material: str, start: float, end: float, scale: float) -> None:
        body.rod(material, (start * along).tolist(), (end * along).tolist(), scale * radius)

    ring("white_paint", 0.0, length, 1.0)
    ring("dark_metal", 0.10, 0.17, 1.18)
    ring("warning", 0.17, 0.185, 1.12)
    if not shorten:
        ring("dark_metal", length - 0.17, length - 0.10, 1.18)
    ring("aluminium", length * 0.5 - 0.012, length * 0.5 + 0.012, 1.06)
    side = np.array(
        [-along[2], 0.0, along[0]]
    )  # a cable duct along the boom, across the joint axis or along x
    offset = 1.02 * radius * side
    body.rod(
        "grey_paint",
        (0.17 * along + offset).tolist(),
        ((length - 0.12) * along + offset).tolist(),
        0.16 * radius,
    )


def _draw_gripper(hand: Brush, reach: float) -> None:
    """Draw wrist, palm and two fingers that close on the point `reach` along z, the end-effector frame."""
    hand.rod("dark_metal", (0, 0, reach - 0.32), (0, 0, reach - 0.22), 0.105)
    hand.rod("aluminium", (0, 0, reach - 0.22), (0, 0, reach - 0.20), 0.115)
    hand.box("grey_paint", (0, 0, reach - 0.17), (0.10, 0.22, 0.06))
    for sign in (-1.0, 1.0):
        knuckle, elbow, tip = (0.0, sign * 0.10, reach - 0.15), (0.0, sign * 0.115, reach - 0.07), None
        tip = (0.0, sign * 0.055, reach + 0.045)
        hand.rod("aluminium", knuckle, elbow, 0.022, round_ends=True)
        hand.rod("aluminium", elbow, tip, 0.018, round_ends=True)
        hand.box("warning", (0.0, sign * 0.045, reach + 0.01), (0.06, 0.014, 0.07))
        hand.rod("dark_metal", (-0.035, *knuckle[1:]), (0.035, *knuckle[1:]), 0.026)
    hand.rod("glass", (0.0, 0.0, reach - 0.14), (0.0, 0.0, reach - 0.13), 0.028)
    hand.box("dark_metal", (0.10, 0.0, reach - 0.36), (0.10, 0.09, 0.09))  # camera on its bracket
    hand.rod("glass", (0.12, 0.0, reach - 0.315), (0.12, 0.0, reach - 0.305), 0.03)


def draw_target(target: mujoco.MjsBody) -> None:
    """Draw a dead satellite whose grapple bar lies in the body's origin; it extends along +y from there."""
    debris = Brush(target)
    # Grapple fixture: a bar along x between two posts, on a plate with marks for the camera.
    debris.rod("warning", (-0.07, 0, 0), (0.07, 0, 0), 0.02)
    for sign in (-1.0, 1.0):
        debris.rod("aluminium", (sign * 0.07, 0, 0), (sign * 0.07, 0.15, 0), 0.014)
        debris.ball("aluminium", (sign * 0.07, 0, 0), (0.024, 0.024, 0.024))
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
    """Add materials, meshes, sky, sun and the cameras `overview` and `chase`, and how it is rendered."""
    add_materials(spec)
    add_sky(spec)
    add_earth(spec, pos=(-370.0, 110.0, -340.0), radius=305.0)
    add_crumpled_box(spec, "debris_foil", [0.6, 0.7, 0.6], depth=0.02, cells=9)
    bowl = [(0.001, 0.0), (0.10, 0.012), (0.20, 0.05), (0.28, 0.10)]
    add_revolved(spec, "dish", [*bowl, *((max(r - 0.008, 0.001), z + 0.008) for r, z in reversed(bowl))])
    bowl = [(0.55 * r, 0.55 * z) for r, z in bowl]
    add_revolved(
        spec, "small_dish", [*bowl, *((max(r - 0.006, 0.001), z + 0.006) for r, z in reversed(bowl))]
    )
    bell = [(0.17, 0.0), (0.155, 0.08), (0.12, 0.16), (0.06, 0.22), (0.07, 0.26)]
    add_revolved(spec, "nozzle", [*bell, *((r - 0.012, z) for r, z in reversed(bell))])

    world = spec.worldbody
    world.add_light(
        name="sun",
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=[-8 * way for way in SUN],
        dir=SUN,
        ambient=[0.0, 0.0, 0.0],
        diffuse=[0.95, 0.93, 0.88],
        specular=[0.6, 0.58, 0.5],
        castshadow=True,
    )
    spec.visual.headlight.ambient = [0.10, 0.11, 0.13]
    spec.visual.headlight.diffuse = [0.10, 0.10, 0.12]
    spec.visual.headlight.specular = [0.0, 0.0, 0.0]
    spec.visual.quality.shadowsize = 2048
    spec.visual.quality.numslices = 20
    spec.visual.quality.numstacks = 10
    spec.visual.map.shadowclip = 1.0
    spec.visual.map.znear = 0.01
    spec.visual.map.zfar = 100.0  # times the extent: beyond the limb of the planet
    spec.stat.extent = 5.0
    spec.stat.center = [0.0, 0.8, 1.0]

    eye, at = (6.5, -1.5, 3.6), (-0.3, 0.85, 1.4)
    world.add_camera(name="overview", pos=eye, quat=look_at(eye, at), fovy=46)
    eye, at = (4.0, -4.1, 3.2), (0.0, 0.6, 0.9)
    spec.body("satellite").add_camera(
        name="chase", mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM, pos=eye, quat=look_at(eye, at), fovy=50
    )
