"""The free-floating 7-DoF robot of shyam2020 as an MjSpec and a compiled MjModel."""

from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np

from space_envs.checks import count, flag
from space_envs.errors import positive, unknown_name
from space_envs.robots.capsules import SINGLE_ARM_SHAPE, add_point_sensors
from space_envs.robots.models.drawing import draw
from space_envs.robots.parameters import (
    SINGLE_ARM,
    VARIANTS,
    DHLink,
    SingleArmParameters,
    cube_inertia,
    rod_inertia,
)
from space_envs.robots.zoo import find_robot

SATELLITE = "satellite"
TARGET = "target"
END_EFFECTOR = "end_effector"
GRAPPLE = "grapple"
ROOT = "root"
OBSTACLE = "obstacle"
OBSTACLE_RADIUS = 0.25  # m, default of the model; set per episode


@dataclass(frozen=True)
class ModelOptions:
    """Options of the simulated model.

    Attributes:
        variant: `paper` takes the inertias of Table II literally; `physical` makes the links solid rods
            and the satellite a homogeneous cube of the same masses.
        timestep: integration step of RK4, s. See docs/momentum.md for its effect.
        visual: whether geometry, lights and cameras are drawn. They have no mass and do not collide; the
            simulation omits them since MuJoCo would update every geom.
        obstacles: number of keep-out spheres. Sphere i is the mocap body `obstacle{i}` with a site of that
            name in its centre and another, `obstacle{i}_surface`, as far from it as the radius; nothing
            collides with it. Their sensors and those of the links' ends follow the other
            sensors.
    """

    variant: str = "paper"
    timestep: float = 0.02
    visual: bool = False
    obstacles: int = 0

    def __post_init__(self) -> None:
        if self.variant not in VARIANTS:
            raise unknown_name("model variant", self.variant, VARIANTS)
        flag("visual", self.visual)
        positive("timestep", self.timestep, 0.1)
        count("obstacles", self.obstacles, 100)


def quaternion_x(angle: float) -> list[float]:
    """Quaternion of a rotation about x."""
    return [float(np.cos(angle / 2)), float(np.sin(angle / 2)), 0.0, 0.0]


def link_inertia(link: DHLink, variant: str, radius: float) -> tuple[float, float, float]:
    """Principal inertia of a link in the axes of its DH frame, kg m^2."""
    return link.inertia if variant == "paper" else rod_link_inertia(link, radius)


def rod_link_inertia(link: DHLink, radius: float) -> tuple[float, float, float]:
    """Principal inertia of a link that is a solid rod, in the axes of its DH frame, kg m^2."""
    # The link runs along (a, 0, d) before Rx(alpha); alpha is a multiple of pi/2, so it is along an axis.
    along = (link.a, link.d * float(np.sin(link.alpha)), link.d * float(np.cos(link.alpha)))
    return rod_inertia(link.mass, radius, (along[0], along[1], 0.0 if abs(along[2]) < 1e-12 else along[2]))


def single_arm_spec(
    options: ModelOptions = ModelOptions(), parameters: SingleArmParameters = SINGLE_ARM
) -> mujoco.MjSpec:
    """Build the editable model.

    Body `link{i}` carries joint i: its frame is DH frame i - 1 rotated by the joint angle, so that the joint
    axis is its z axis. Mass, centre of mass (mid-link) and inertia (axes of DH frame i) are written
    explicitly; no geom has mass. The satellite's frame is at its centre of mass. The target is a mocap body
    whose frame is the grapple pose.
    """
    spec = mujoco.MjSpec()
    spec.modelname = f"single_arm_{options.variant}"
    spec.compiler.degree = False
    spec.compiler.balanceinertia = False
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.timestep = options.timestep

    satellite = spec.worldbody.add_body(name=SATELLITE, explicitinertial=True)
    satellite.mass = parameters.satellite_mass
    satellite.ipos = [0.0, 0.0, 0.0]  # otherwise MJCF is written without the inertia
    satellite.inertia = (
        parameters.satellite_inertia
        if options.variant == "paper"
        else cube_inertia(parameters.satellite_mass, parameters.satellite_side)
    )
    satellite.add_freejoint(name=SATELLITE)
    satellite.add_site(name=SATELLITE, size=[0.01, 0.01, 0.01], group=4)

    parent, position, orientation = satellite, [0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0]
    for number, link in enumerate(parameters.links, start=1):
        body = parent.add_body(name=f"link{number}", pos=position, quat=orientation, explicitinertial=True)
        body.mass = link.mass
        body.ipos = [link.a / 2, 0.0, link.d / 2]
        body.iquat = quaternion_x(link.alpha)
        body.inertia = link_inertia(link, options.variant, parameters.link_radius)
        home = parameters.home[number - 1]
        body.add_joint(
            name=f"joint{number}",
            type=mujoco.mjtJoint.mjJNT_HINGE,
            axis=[0, 0, 1],
            armature=parameters.rotor_inertia if options.variant == "physical" else 0.0,
            range=[home - parameters.joint_reach, home + parameters.joint_reach],
        )
        spec.add_actuator(
            name=f"joint{number}",
            target=f"joint{number}",
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            ctrlrange=[-parameters.torque_limit, parameters.torque_limit],
            forcerange=[-parameters.torque_limit, parameters.torque_limit],
        ).set_to_motor()
        parent, position, orientation = body, [link.a, 0.0, link.d], quaternion_x(link.alpha)
    parent.add_site(name=END_EFFECTOR, pos=position, quat=orientation, size=[0.01, 0.01, 0.01], group=4)
    # Point where the upper arm emerges from the deck.
    foot = [parameters.link_radius, 0.0, 0.0]
    spec.body("link3").add_site(name=ROOT, pos=foot, size=[0.01, 0.01, 0.01], group=4)

    target = spec.worldbody.add_body(name=TARGET, mocap=True, pos=[0.0, 3.0, 2.0])
    target.add_site(name=GRAPPLE, size=[0.01, 0.01, 0.01], group=4)

    _add_sensors(spec, len(parameters.links))
    if options.obstacles:
        _add_obstacles(spec, options.obstacles, len(parameters.links))
    add_point_sensors(spec, SINGLE_ARM_SHAPE, (1,), SATELLITE)
    spec.add_key(name="home", qpos=[0, 0, 0, 1, 0, 0, 0, *parameters.home])
    if options.visual:
        draw(spec, find_robot("shyam2020", options.variant))
    return spec


def _add_sensors(spec: mujoco.MjSpec, n_joints: int) -> None:
    """Sensors in the order of the task's observation layout, so that an observation is one copy of them."""
    kind, obj = mujoco.mjtSensor, mujoco.mjtObj
    for number in range(1, n_joints + 1):
        spec.add_sensor(
            name=f"position{number}",
            type=kind.mjSENS_JOINTPOS,
            objtype=obj.mjOBJ_JOINT,
            objname=f"joint{number}",
        )
    for number in range(1, n_joints + 1):
        spec.add_sensor(
            name=f"velocity{number}",
            type=kind.mjSENS_JOINTVEL,
            objtype=obj.mjOBJ_JOINT,
            objname=f"joint{number}",
        )
    for site in (SATELLITE, END_EFFECTOR, GRAPPLE):
        spec.add_sensor(
            name=f"{site}_position", type=kind.mjSENS_FRAMEPOS, objtype=obj.mjOBJ_SITE, objname=site
        )
        spec.add_sensor(
            name=f"{site}_quaternion", type=kind.mjSENS_FRAMEQUAT, objtype=obj.mjOBJ_SITE, objname=site
        )
        if site != GRAPPLE:
            spec.add_sensor(
                name=f"{site}_linear_velocity",
                type=kind.mjSENS_FRAMELINVEL,
                objtype=obj.mjOBJ_SITE,
                objname=site,
            )
            spec.add_sensor(
                name=f"{site}_angular_velocity",
                type=kind.mjSENS_FRAMEANGVEL,
                objtype=obj.mjOBJ_SITE,
                objname=site,
            )


def _add_obstacles(spec: mujoco.MjSpec, count: int, n_joints: int) -> None:
    """Add keep-out spheres, sensors of their centres and surfaces, and of the ends of the links.

    A surface is measured from its centre, in the axes of the sphere, which do not rotate.
    """
    kind, obj = mujoco.mjtSensor.mjSENS_FRAMEPOS, mujoco.mjtObj
    names = [f"{OBSTACLE}{number}" for number in range(1, count + 1)]
    for place, name in enumerate(names):
        body = spec.worldbody.add_body(name=name, mocap=True, pos=[0.0, 3.0, -2.0 - place])
        for site, along in ((name, 0.0), (f"{name}_surface", OBSTACLE_RADIUS)):
            body.add_site(name=site, pos=[along, 0.0, 0.0], size=[0.01, 0.01, 0.01], group=4)
    for name in names:
        spec.add_sensor(name=f"{name}_position", type=kind, objtype=obj.mjOBJ_SITE, objname=name)
    for name in names:
        spec.add_sensor(
            name=f"{name}_radius",
            type=kind,
            objtype=obj.mjOBJ_SITE,
            objname=f"{name}_surface",
            reftype=obj.mjOBJ_SITE,
            refname=name,
        )
    for number in range(1, n_joints + 1):
        spec.add_sensor(
            name=f"link{number}_position", type=kind, objtype=obj.mjOBJ_XBODY, objname=f"link{number}"
        )


@lru_cache(maxsize=16)
def single_arm_model(options: ModelOptions = ModelOptions()) -> mujoco.MjModel:
    """Compile the model. The result is shared: treat it as read-only, copy it to change it."""
    return single_arm_spec(options).compile()
