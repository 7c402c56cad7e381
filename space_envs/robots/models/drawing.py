"""Drawings of a robot and what it captures: geometry without mass that never collides, cameras and light."""

import mujoco
import numpy as np

from space_envs.robots.kinematics import link_positions
from space_envs.robots.models.bodies import SATELLITE, arm_numbers, link_name, site_name
from space_envs.robots.robot import Arm, Link, Robot, View, Visual
from space_envs.scenery.dual_arm import draw_planar, draw_spatial_target
from space_envs.scenery.materials import add_space
from space_envs.scenery.parts import (
    add_part_meshes,
    add_views,
    draw_arm_deck,
    draw_boom,
    draw_bus,
    draw_hand,
    draw_joint,
    draw_plain_bus,
    draw_wing,
)
from space_envs.scenery.shapes import Brush, Vector, add_crumpled_box, rotation_to
from space_envs.scenery.single_arm import draw_keep_out, draw_target

STANDARD_LENGTH = 4.7  # m, of the arm for which parts are drawn in full size
_UPRIGHT = (float(np.cos(np.pi / 4)), -float(np.sin(np.pi / 4)), 0.0, 0.0)  # z becomes y
_HAND = 0.30  # m, of a hand in full size, from its wrist to the end-effector
_LEAST_BOOM = 0.02  # m
_FIELD = 2.3  # distance of the default camera, times the radius of what it shows


def draw(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add the drawings of a robot, its target and keep-out spheres, the surroundings and the cameras."""
    scale = min(1.0, max(arm.length for arm in robot.arms) / STANDARD_LENGTH)
    if robot.planar and robot.target is not None:
        radius = robot.arms[0].capsules[0].radius
        draw_planar(spec, 2 * robot.satellite.box[0], radius, robot.target.body)
    else:
        _draw_satellite(spec, robot)
        for number, arm in zip(arm_numbers(robot), robot.arms, strict=True):
            _draw_arm(spec, robot, number, arm, scale)
        if robot.target is None:
            draw_target(spec, scale)
            draw_keep_out(spec)
        else:
            draw_spatial_target(spec, robot.target.body)
    add_part_meshes(spec)
    view = robot.view or default_view(robot)
    add_space(spec, view.earth, view.sun)
    spec.stat.extent = 5.0
    spec.stat.center = [0.0, 0.8, 1.0 if robot.target is None else 0.0]
    add_views(spec, view.overview, view.chase)


def default_view(robot: Robot) -> View:
    """A view of the whole robot at home, from the front and from behind."""
    half, middle = np.array(robot.satellite.box), np.array(robot.satellite.box_centre)
    corners = middle + half * (np.indices((2, 2, 2)).reshape(3, -1).T * 2 - 1)
    points = np.concatenate([corners, *link_positions(robot, robot.home)])
    centre = (points.min(axis=0) + points.max(axis=0)) / 2
    distance = _FIELD * float(np.linalg.norm(points - centre, axis=1).max())

    def seen_from(*direction: float) -> tuple:
        eye = centre + distance * np.array(direction) / np.linalg.norm(direction)
        return tuple(eye.tolist()), tuple(centre.tolist())

    return View(seen_from(0.78, -0.12, 0.52), seen_from(0.42, 0.52, 0.36))


def _draw_satellite(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Draw the bus with its deck where the arms work: at +z for one arm, at +y for two."""
    satellite = robot.satellite
    body = Brush(spec.body(SATELLITE)).at(satellite.box_centre)
    _draw_visuals(spec, spec.body(SATELLITE), SATELLITE, satellite.visuals)
    if not satellite.bus:
        return
    sides = [2 * half for half in satellite.box]
    side, depth = min(sides), 0.022 * min(sides)
    add_crumpled_box(spec, "bus_foil", [0.97 * length for length in sides], depth=depth)
    bus = body if robot.target is None else body.at((0.0, 0.0, 0.0), _UPRIGHT)
    if max(sides) - side < 1e-9:
        draw_bus(bus, side)
        draw_arm_deck(bus, side)
    else:
        draw_plain_bus(body, sides)
    out = satellite.box[1 if robot.target is None else 2] - side / 2  # wings are beside the arms
    for sign in (-1.0, 1.0):
        draw_wing(bus.at((0.0, sign * out, 0.0)), side, sign, panels=3 if robot.target is None else 2)


def _draw_arm(spec: mujoco.MjSpec, robot: Robot, number: int | None, arm: Arm, scale: float) -> None:
    ends = [*(link.position for link in arm.links[1:]), arm.tool_position]
    radius = max((capsule.radius for capsule in arm.capsules), default=0.08 * scale)
    drawn = any(link.visuals for link in arm.links)
    for place, (link, end) in enumerate(zip(arm.links, ends, strict=True), start=1):
        name = link_name(number, place)
        if drawn:
            _draw_visuals(spec, spec.body(name), name, link.visuals)
        else:
            inside = place == 1 and _within(robot, link)
            _draw_link(Brush(spec.body(name), scale=scale), link, end, radius, inside, place == len(ends))
    camera = site_name(number, "end_effector")
    _draw_hand(Brush(spec.body(name)), robot, arm, scale, camera, drawn)


def _within(robot: Robot, link: Link) -> bool:
    """Whether the joint of a link is inside the satellite, so that it cannot be seen."""
    place = np.abs(np.array(link.position) - np.array(robot.satellite.box_centre))
    return bool((place < np.array(robot.satellite.box) - 1e-9).all())


def _draw_link(body: Brush, link: Link, end: Vector, radius: float, inside: bool, last: bool) -> None:
    length = float(np.linalg.norm(end))
    local = (np.array(end) / body.scale).tolist()
    if inside:  # only what stands out of the satellite can be seen
        along = np.array(local) / max(length / body.scale, 1e-9)
        tip = np.array(local)
        body.rod("dark_metal", (tip - 0.02 * along).tolist(), (tip + 0.03 * along).tolist(), 0.19)
        return
    draw_joint(body.at((0.0, 0.0, 0.0), rotation_to(link.joint.axis)))
    shorten = min(_HAND, 0.5 * length / body.scale) if last else 0.0
    if length > _LEAST_BOOM:
        draw_boom(body, local, radius / body.scale, shorten)


def _draw_hand(body: Brush, robot: Robot, arm: Arm, scale: float, camera: str, drawn: bool) -> None:
    """Draw the hand along the last link, or along the approach axis where a target prescribes one."""
    tool = body.at(arm.tool_position, arm.tool_orientation)
    length = float(np.linalg.norm(arm.tool_position))
    if robot.target is None and not drawn and length > _LEAST_BOOM:
        tool = body.at(arm.tool_position, rotation_to(arm.tool_position))
    hand = tool.at((0.0, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0), scale)
    if drawn:  # the robot's own hand: only its camera is added
        hand.camera(camera, (0.25, 0.0, -0.215), (0.0, 0.0, 0.22), up=(1.0, 0.0, 0.0), fovy=75)
    else:
        draw_hand(hand, camera, fingers=2 if robot.target is None else 3)


def _draw_visuals(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, visuals: tuple[Visual, ...]) -> None:
    """Add the geometry of a robot's own file."""
    for number, visual in enumerate(visuals):
        brush = Brush(body)
        if visual.mesh is None:
            brush.solid(visual.kind, visual.position, visual.size, visual.orientation, visual.colour)
            continue
        mesh = f"{name}_{number}"
        inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL
        spec.add_mesh(name=mesh, file=str(visual.mesh), scale=list(visual.size), inertia=inertia)
        brush.mesh("white_paint", mesh, visual.position, visual.orientation, visual.colour)
