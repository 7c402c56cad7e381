"""Compiled models of a robot with what it captures: a grapple at rest or on a free body, or two on one."""

from dataclasses import dataclass
from functools import lru_cache
from math import cos, pi, sin

import mujoco

from space_envs.checks import count, flag
from space_envs.errors import positive
from space_envs.robots.models.bodies import add_hollow_site, add_robot, empty_spec, move_in_plane
from space_envs.robots.models.drawing import draw
from space_envs.robots.models.sensors import add_obstacle_sensors, add_sensors, add_target_sensors
from space_envs.robots.robot import Robot, Target

TARGET = "target"
GRAPPLE = "grapple"
GRAPPLES = ("grapple1", "grapple2")
OBSTACLE = "obstacle"
OBSTACLE_RADIUS = 0.25  # m, default of the model; set per episode


@dataclass(frozen=True)
class MovingTarget:
    """Free body that carries the grapple of one arm; the grapple's frame is the body's frame.

    Attributes:
        inertia: principal moments of inertia, kg m^2. centre: of mass, m. axes: w x y z, from the principal
            axes to the body's frame. mass: kg.
    """

    inertia: tuple[float, float, float]
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)
    axes: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
    mass: float = 100.0


@dataclass(frozen=True)
class SceneOptions:
    """Options of the simulated model.

    Attributes:
        timestep: integration step of RK4, s; None is the robot's default. docs/momentum.md shows its
            effect.
        visual: whether geometry, lights and cameras are drawn. They have no mass and do not collide; the
            simulation omits them since MuJoCo would update every geom.
        obstacles: number of keep-out spheres for one arm. Sphere i is the mocap body `obstacle{i}` with a
            site of that name in its centre and another, `obstacle{i}_surface`, as far from it as the
            radius; nothing collides with it.
        moving_target: body that carries the grapple of one arm; None is a grapple at rest.
    """

    timestep: float | None = None
    visual: bool = False
    obstacles: int = 0
    moving_target: MovingTarget | None = None

    def __post_init__(self) -> None:
        flag("visual", self.visual)
        if self.timestep is not None:
            positive("timestep", self.timestep, 0.1)
        count("obstacles", self.obstacles, 100)


def robot_spec(robot: Robot, options: SceneOptions = SceneOptions()) -> mujoco.MjSpec:
    """Build the editable model of a robot and its target."""
    spec = empty_spec(robot, robot.steps.default_timestep if options.timestep is None else options.timestep)
    add_robot(spec, robot)
    base = [0.0] * 3 if robot.planar else [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0]
    if robot.target is None:
        at = _add_grapple(spec, options.moving_target)
    else:
        at = _add_target(spec, robot.target, robot.planar)
    _add_obstacles(spec, options.obstacles)
    add_sensors(spec, robot, options.moving_target is not None)
    add_obstacle_sensors(spec, robot, options.obstacles)
    add_target_sensors(spec, robot)
    spec.add_key(name="home", qpos=[*base, *robot.home.tolist(), *at])
    if options.visual:
        draw(spec, robot)
    return spec


@lru_cache(maxsize=64)
def robot_model(robot: Robot, options: SceneOptions = SceneOptions()) -> mujoco.MjModel:
    """Compile the model. The result is shared: treat it as read-only, copy it to change it."""
    return robot_spec(robot, options).compile()


def _add_grapple(spec: mujoco.MjSpec, moving: MovingTarget | None) -> list[float]:
    """Add a body whose frame is the grapple of one arm, mocap or free; its coordinates in the keyframe."""
    place = [0.0, 3.0, 2.0]
    if moving is None:
        add_hollow_site(spec.worldbody.add_body(name=TARGET, mocap=True, pos=place), GRAPPLE)
        return []
    target = spec.worldbody.add_body(name=TARGET, pos=place, explicitinertial=True)
    centre, axes = list(moving.centre), list(moving.axes)
    target.mass, target.inertia, target.ipos, target.iquat = moving.mass, list(moving.inertia), centre, axes
    target.add_freejoint(name=TARGET)
    add_hollow_site(target, GRAPPLE)
    add_hollow_site(target, TARGET, pos=centre, quat=axes)
    return [*place, 1.0, 0.0, 0.0, 0.0]


def _add_target(spec: mujoco.MjSpec, parameters: Target, planar: bool) -> list[float]:
    """Add the free body that two arms capture; its coordinates in the keyframe."""
    target = spec.worldbody.add_body(name=TARGET, explicitinertial=True)
    target.mass, target.ipos, target.inertia = parameters.mass, [0.0, 0.0, 0.0], list(parameters.inertia)
    add_hollow_site(target, TARGET)
    half = parameters.half_width
    if planar:
        move_in_plane(target, TARGET)
        for name, side in zip(GRAPPLES, (-half, half), strict=True):
            add_hollow_site(target, name, pos=[0.0, side, 0.0])
        return [*parameters.position[:2], 0.0]
    target.add_freejoint(name=TARGET)
    for name, sign in zip(GRAPPLES, (1.0, -1.0), strict=True):
        # z of the fixture is its approach axis: an end-effector's z axis has to point along it.
        into = [cos(pi / 4), 0.0, sin(-sign * pi / 4), 0.0]
        add_hollow_site(target, name, pos=[sign * half, 0.0, 0.0], quat=into)
    return [*parameters.position, *parameters.orientation]


def _add_obstacles(spec: mujoco.MjSpec, number: int) -> None:
    for place in range(number):
        name = f"{OBSTACLE}{place + 1}"
        body = spec.worldbody.add_body(name=name, mocap=True, pos=[0.0, 3.0, -2.0 - place])
        for site, along in ((name, 0.0), (f"{name}_surface", OBSTACLE_RADIUS)):
            add_hollow_site(body, site, pos=[along, 0.0, 0.0])
