"""Visual parts of all spacecraft: bus, solar wings, arms and hands.

Each function draws in the frame of its brush; lengths in m.
"""

from math import cos, pi, sin

import mujoco
import numpy as np

from space_envs.scenery.shapes import Brush, Vector, add_revolved, look_at

JOINT_RADIUS = 0.115  # m, housing of a motor


def add_part_meshes(spec: mujoco.MjSpec) -> None:
    """Add the meshes that parts name: `dish`, `small_dish` and `nozzle`."""
    bowl = [(0.001, 0.0), (0.10, 0.012), (0.20, 0.05), (0.28, 0.10)]
    add_revolved(spec, "dish", [*bowl, *((max(r - 0.008, 0.001), z + 0.008) for r, z in reversed(bowl))])
    bowl = [(0.55 * r, 0.55 * z) for r, z in bowl]
    add_revolved(
        spec, "small_dish", [*bowl, *((max(r - 0.006, 0.001), z + 0.006) for r, z in reversed(bowl))]
    )
    bell = [(0.17, 0.0), (0.155, 0.08), (0.12, 0.16), (0.06, 0.22), (0.07, 0.26)]
    add_revolved(spec, "nozzle", [*bell, *((r - 0.012, z) for r, z in reversed(bell))])


def add_views(spec: mujoco.MjSpec, overview: tuple[Vector, Vector], chase: tuple[Vector, Vector]) -> None:
    """Add the cameras `overview`, at rest, and `chase`, which moves along with the robot.

    Each is given by its position and the point it looks at, in the inertial frame and in the satellite's
    frame in the model's initial state.
    """
    eye, at = overview
    spec.worldbody.add_camera(name="overview", pos=eye, quat=look_at(eye, at), fovy=46)
    eye, at = chase
    spec.body("satellite").add_camera(
        name="chase", mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACKCOM, pos=eye, quat=look_at(eye, at), fovy=50
    )


def draw_bus(bus: Brush, side: float) -> None:
    """Draw a cube in foil with its equipment; the face at +z is a deck, the main engine is at -z.

    The foil is the mesh `bus_foil`.
    """
    h = side / 2
    bus.mesh("gold_foil", "bus_foil")
    for u in (-h, h):  # the frame: twelve edges
        for v in (-h, h):
            bus.box("aluminium", (0, u, v), (side + 0.03, 0.03, 0.03))
            bus.box("aluminium", (u, 0, v), (0.03, side + 0.03, 0.03))
            bus.box("aluminium", (u, v, 0), (0.03, 0.03, side + 0.03))
    bus.box("radiator", (h, 0.13 * side, 0.10 * side), (0.025, 0.56 * side, 0.62 * side))
    bus.box("white_paint", (h, -0.33 * side, 0.22 * side), (0.05, 0.2 * side, 0.28 * side))  # electronics
    bus.box("blue_mark", (h + 0.026, -0.33 * side, 0.29 * side), (0.004, 0.14 * side, 0.05 * side))
    for u in (-0.25, 0.05):
        bus.box("dark_metal", (h, u * side - 0.05, -0.36 * side), (0.03, 0.22 * side, 0.10 * side))

    # Star tracker: two baffles on a bracket at the corner of the deck.
    bus.box("dark_metal", (0.36 * side, -0.36 * side, h + 0.04), (0.14, 0.14, 0.06))
    for tilt in (-0.5, 0.5):
        base = np.array([0.36 * side, -0.36 * side, h + 0.06])
        direction = np.array([0.5 * tilt, -0.35, 0.8])
        end = base + 0.20 * direction
        bus.rod("white_paint", base.tolist(), end.tolist(), 0.045)
        bus.rod("glass", end.tolist(), (end + 0.004 * direction).tolist(), 0.038)
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
            for direction in ((np.sign(u), 0), (0, np.sign(v))):
                start = (u * 1.03, v * 1.03, -h * 0.86)
                end = (u * 1.03 + 0.10 * direction[0], v * 1.03 + 0.10 * direction[1], -h * 0.86)
                bus.rod("titanium", start, end, 0.024)


def draw_plain_bus(bus: Brush, sides: Vector) -> None:
    """Draw a box in foil with a frame; the foil is the mesh `bus_foil`."""
    bus.mesh("gold_foil", "bus_foil")
    half = np.array(sides) / 2
    for axis in range(3):
        first, second = (axis + 1) % 3, (axis + 2) % 3
        for u in (-1.0, 1.0):
            for v in (-1.0, 1.0):
                middle, size = np.zeros(3), np.full(3, 0.03)
                middle[[first, second]] = u * half[first], v * half[second]
                size[axis] = 2 * half[axis] + 0.03
                bus.box("aluminium", middle.tolist(), size.tolist())


def draw_arm_deck(bus: Brush, side: float) -> None:
    """Draw the bolted plate of the deck of `draw_bus`."""
    h = side / 2
    bus.box("grey_paint", (0, 0, h), (0.62 * side, 0.62 * side, 0.02))
    for u in (-0.26 * side, 0.26 * side):
        for v in (-0.26 * side, 0.26 * side):
            bus.rod("dark_metal", (u, v, h), (u, v, h + 0.025), 0.02)


def draw_wing(bus: Brush, side: float, sign: float, panels: int = 3) -> None:
    """Draw a wing along +y or -y of a bus, set back from its deck and tilted to the sun."""
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
    for panel in range(panels):
        middle = np.array([0, sign * (root + length / 2 + panel * (length + gap)), z])
        bus.box("aluminium", middle.tolist(), (width, length, 0.018), quat)
        cells = (middle + 0.011 * normal).tolist()
        bus.box("solar_cells", cells, (width - 0.04, length - 0.04, 0.006), quat)
        if panel:
            for u in (-0.35, 0.35):
                hinge = middle - np.array([0, sign * (length + gap) / 2, 0]) + u * width * across
                bus.box("dark_metal", hinge.tolist(), (0.06, 0.05, 0.03), quat)
    corner = np.array([0, sign * (root + panels * (length + gap) - gap), z]) - 0.5 * width * across
    bus.ellipsoid("lamp", corner.tolist(), (0.02, 0.02, 0.02))


def draw_joint(body: Brush) -> None:
    """Draw the motor housing of the joint about the body's z axis."""
    body.rod("dark_metal", (0, 0, -0.13), (0, 0, 0.13), JOINT_RADIUS)
    for sign in (-1.0, 1.0):
        body.rod("aluminium", (0, 0, sign * 0.13), (0, 0, sign * 0.145), 0.9 * JOINT_RADIUS)
        body.rod("dark_metal", (0, 0, sign * 0.145), (0, 0, sign * 0.155), 0.45 * JOINT_RADIUS)
    body.rod("grey_paint", (0, 0, -0.02), (0, 0, 0.02), 1.03 * JOINT_RADIUS)


def draw_boom(body: Brush, end: Vector, radius: float, shorten: float = 0.0) -> None:
    """Draw a boom from the origin to `end`, or `shorten` metres less."""
    reach = float(np.linalg.norm(end))
    along = np.asarray(end, dtype=float) / reach
    length = reach - shorten

    def ring(material: str, start: float, stop: float, scale: float) -> None:
        body.rod(material, (start * along).tolist(), (stop * along).tolist(), scale * radius)

    ring("white_paint", 0.0, length, 1.0)
    ring("dark_metal", 0.10, 0.17, 1.18)
    ring("warning", 0.17, 0.185, 1.12)
    if not shorten:
        ring("dark_metal", length - 0.17, length - 0.10, 1.18)
    ring("aluminium", length * 0.5 - 0.012, length * 0.5 + 0.012, 1.06)
    # A cable duct along the boom, across the joint axis or along x.
    side = np.cross(along, [0.0, 1.0, 0.0] if abs(along[1]) < 0.99 else [1.0, 0.0, 0.0])
    offset = 1.02 * radius * side / np.linalg.norm(side)
    duct = (0.17 * along + offset).tolist(), ((length - 0.12) * along + offset).tolist()
    body.rod("grey_paint", *duct, 0.16 * radius)


def draw_ring(brush: Brush, material: str, radius: float, wire: float, segments: int = 24) -> None:
    """Draw a ring about z out of straight pieces; both radii, of the ring and of its wire, in m."""
    angles = [2 * pi * number / segments for number in range(segments + 1)]
    corners = [(radius * cos(angle), radius * sin(angle), 0.0) for angle in angles]
    for start, end in zip(corners, corners[1:], strict=False):
        brush.rod(material, start, end, wire)


def draw_hand(hand: Brush, camera: str, fingers: int) -> None:
    """Draw wrist, palm and fingers that close on the origin from -z, and add the camera behind them."""
    hand.rod("dark_metal", (0, 0, -0.32), (0, 0, -0.22), 0.105)
    hand.rod("aluminium", (0, 0, -0.22), (0, 0, -0.20), 0.115)
    if fingers == 2:
        hand.box("grey_paint", (0, 0, -0.17), (0.10, 0.22, 0.06))
    else:
        hand.rod("grey_paint", (0, 0, -0.20), (0, 0, -0.14), 0.11)
    for number in range(fingers):
        angle = 2 * pi * number / fingers
        _draw_finger(hand.at((0, 0, 0), (cos(angle / 2), 0.0, 0.0, sin(angle / 2))))
    hand.rod("glass", (0.0, 0.0, -0.14), (0.0, 0.0, -0.13), 0.028)
    # The camera is next to the palm and looks between two fingers at the grasped point.
    gap = pi / 2 - pi / fingers
    side = hand.at((0, 0, 0), (cos(gap / 2), 0.0, 0.0, sin(gap / 2)))
    side.rod("aluminium", (0.09, 0.0, -0.27), (0.24, 0.0, -0.27), 0.022)
    side.box("dark_metal", (0.25, 0.0, -0.28), (0.08, 0.09, 0.10))
    side.rod("glass", (0.25, 0.0, -0.23), (0.25, 0.0, -0.22), 0.03)
    side.camera(camera, (0.25, 0.0, -0.215), (0.0, 0.0, 0.22), up=(1.0, 0.0, 0.0), fovy=75)


def _draw_finger(hand: Brush) -> None:
    """Draw the finger on the +y side of a hand."""
    knuckle, elbow, end = (0.0, 0.10, -0.15), (0.0, 0.115, -0.07), (0.0, 0.055, 0.045)
    hand.rod("aluminium", knuckle, elbow, 0.022, round_ends=True)
    hand.rod("aluminium", elbow, end, 0.018, round_ends=True)
    hand.box("warning", (0.0, 0.045, 0.01), (0.06, 0.014, 0.07))
    hand.rod("dark_metal", (-0.035, *knuckle[1:]), (0.035, *knuckle[1:]), 0.026)
