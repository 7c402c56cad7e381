"""The free-floating dual-arm robots as MjSpecs and compiled MjModels: planar (shah2013) and spatial."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import pi
from typing import Any

import mujoco
import numpy as np

from space_envs.checks import flag, numbers
from space_envs.errors import ConfigurationError, positive, shown, unknown_name
from space_envs.robots.capsules import PLANAR_SHAPE, SPATIAL_SHAPE, ArmShape, add_point_sensors
from space_envs.robots.models.drawing import draw
from space_envs.robots.parameters import (
    DUAL_ARM_PLANAR,
    DUAL_ARM_SPATIAL,
    DHLink,
    DualArmPlanarParameters,
    DualArmSpatialParameters,
    TargetParameters,
    cube_inertia,
)
from space_envs.robots.single_arm import SATELLITE, TARGET, quaternion_x, rod_link_inertia
from space_envs.robots.zoo import find_robot

ARMS = (1, 2)
END_EFFECTORS = ("end_effector1", "end_effector2")
GRAPPLES = ("grapple1", "grapple2")
PLANE = ("x", "y", "turn")  # joints of a body that moves in the plane: two slides and a hinge


def _build_planar(spec: mujoco.MjSpec, parameters: DualArmPlanarParameters) -> None:
    moment = parameters.satellite_inertia
    satellite = _base(spec, parameters.satellite_mass, (moment, moment, moment))
    _move_in_plane(satellite, SATELLITE)
    for arm, mount in zip(ARMS, parameters.mounts, strict=True):
        parent, position = satellite, [*mount, 0.0]
        for number, link in enumerate(parameters.arm, start=1):
            body = parent.add_body(name=f"arm{arm}_link{number}", pos=position, explicitinertial=True)
            body.mass = link.mass
            body.ipos = [link.length / 2, 0.0, 0.0]
            axial = (
                link.mass * parameters.link_radius**2 / 2
            )  # unused: links do not rotate about their length
            body.inertia = [axial, link.inertia, link.inertia]
            reach = parameters.first_reach if number == 1 else parameters.joint_reach
            _add_joint(spec, body, f"arm{arm}_joint{number}", reach, parameters.torque_limit)
            parent, position = body, [link.length, 0.0, 0.0]
        parent.add_site(name=f"end_effector{arm}", pos=position, size=[0.01, 0.01, 0.01], group=4)
        _add_gripper(parent, arm, position, parameters.target.gripper)

    target = _target(spec, parameters.target)
    _move_in_plane(target, TARGET)
    half = parameters.target.half_width
    for name, side in zip(GRAPPLES, (-half, half), strict=True):
        target.add_site(name=name, pos=[0.0, side, 0.0], size=[0.01, 0.01, 0.01], group=4)
    spec.add_key(name="home", qpos=[0.0, 0.0, 0.0, *parameters.home, 2.0, 1.0, 0.0])


def _build_spatial(spec: mujoco.MjSpec, parameters: DualArmSpatialParameters) -> None:
    side = parameters.satellite_side
    satellite = _base(spec, parameters.satellite_mass, cube_inertia(parameters.satellite_mass, side))
    satellite.add_freejoint(name=SATELLITE)
    for arm, sign in zip(ARMS, (1.0, -1.0), strict=True):
        # Frame 0 of the arm: z out of the face, x along z of the satellite, so that both are mirrored in y.
        parent, position = satellite, [sign * side / 2, parameters.forward, 0.0]
        orientation = [float(np.cos(pi / 4)), 0.0, float(np.sin(sign * pi / 4)), 0.0]
        rows = zip(parameters.alpha, parameters.a, parameters.d, parameters.mass, strict=True)
        for number, (alpha, a, d, mass) in enumerate(rows, start=1):
            body = parent.add_body(
                name=f"arm{arm}_link{number}", pos=position, quat=orientation, explicitinertial=True
            )
            link = DHLink(alpha, a, d, mass, (0.0, 0.0, 0.0))
            body.mass = mass
            body.ipos = [a / 2, 0.0, d / 2]
            body.iquat = quaternion_x(alpha)
            body.inertia = rod_link_inertia(link, parameters.link_radius)
            name, reach = f"arm{arm}_joint{number}", parameters.joint_reach
            _add_joint(spec, body, name, reach, parameters.torque_limit, parameters.rotor_inertia)
            parent, position, orientation = body, [a, 0.0, d], quaternion_x(alpha)
        # DH frame 7, whose z axis is the approach axis. It is perpendicular to joint 7: with a tool along
        # its axis that joint would have no effect, and the other six would be over-constrained.
        parent.add_site(
            name=f"end_effector{arm}", pos=position, quat=orientation, size=[0.01, 0.01, 0.01], group=4
        )
        _add_gripper(parent, arm, position, parameters.target.gripper)

    target = _target(spec, parameters.target)
    target.add_freejoint(name=TARGET)
    half = parameters.target.half_width
    for name, sign in zip(GRAPPLES, (1.0, -1.0), strict=True):
        # z of the fixture is its approach axis: an end-effector's z axis has to point along it.
        into = [float(np.cos(pi / 4)), 0.0, float(np.sin(-sign * pi / 4)), 0.0]
        target.add_site(name=name, pos=[sign * half, 0.0, 0.0], quat=into, size=[0.01, 0.01, 0.01], group=4)
    at = [0.0, 1.6, 0.0, 1.0, 0.0, 0.0, 0.0]
    spec.add_key(name="home", qpos=[0, 0, 0, 1, 0, 0, 0, *parameters.home, *at])


def _base(spec: mujoco.MjSpec, mass: float, inertia: tuple[float, float, float]) -> mujoco.MjsBody:
    satellite = spec.worldbody.add_body(name=SATELLITE, explicitinertial=True)
    satellite.mass, satellite.ipos, satellite.inertia = mass, [0.0, 0.0, 0.0], inertia
    satellite.add_site(name=SATELLITE, size=[0.01, 0.01, 0.01], group=4)
    return satellite


def _target(spec: mujoco.MjSpec, parameters: TargetParameters) -> mujoco.MjsBody:
    """Target body with a free joint or planar joints; the keyframe sets its position."""
    target = spec.worldbody.add_body(name=TARGET, explicitinertial=True)
    target.mass, target.ipos, target.inertia = parameters.mass, [0.0, 0.0, 0.0], parameters.inertia
    target.add_site(name=TARGET, size=[0.01, 0.01, 0.01], group=4)
    return target


def _add_gripper(link: mujoco.MjsBody, arm: int, end: Sequence[float], length: float) -> None:
    """Mark where the gripper begins on the last link, `length` m before its end."""
    place = np.array(end) * (1.0 - length / np.linalg.norm(end))
    link.add_site(name=f"gripper{arm}", pos=place, size=[0.01, 0.01, 0.01], group=4)


def _move_in_plane(body: mujoco.MjsBody, name: str) -> None:
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    for kind, axis, joint in (
        (slide, [1, 0, 0], PLANE[0]),
        (slide, [0, 1, 0], PLANE[1]),
        (hinge, [0, 0, 1], PLANE[2]),
    ):
        body.add_joint(name=f"{name}_{joint}", type=kind, axis=axis)


def _add_joint(
    spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, reach: float, torque: float, rotor: float = 0.0
) -> None:
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0, 0, 1],
        armature=rotor,
        range=[-reach, reach],
    )
    spec.add_actuator(
        name=name,
        target=name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        ctrlrange=[-torque, torque],
        forcerange=[-torque, torque],
    ).set_to_motor()


@dataclass(frozen=True)
class DualArmDescription:
    """Description of a dual-arm robot, from which its model is built.

    Attributes:
        parameters: of the robot. shape: of its arms, for contacts.
        build: adds the bodies of robot and target to an empty model.
    """

    parameters: Any
    shape: ArmShape
    build: Callable[[mujoco.MjSpec, Any], None]


DUAL_ARMS = {
    "planar": DualArmDescription(DUAL_ARM_PLANAR, PLANAR_SHAPE, _build_planar),
    "spatial": DualArmDescription(DUAL_ARM_SPATIAL, SPATIAL_SHAPE, _build_spatial),
}
KINDS = tuple(DUAL_ARMS)


@dataclass(frozen=True)
class DualArmOptions:
    """Options of the simulated model.

    Attributes:
        kind: planar or spatial.
        timestep: integration step of RK4, s. docs/momentum.md shows its effect.
        visual: whether geometry, lights and cameras are drawn; they have no mass and do not collide.
        mounts: of the planar arms, in the satellite's frame, m; None is those of the parameters.
    """

    kind: str = "planar"
    timestep: float = 0.02
    visual: bool = False
    mounts: tuple[tuple[float, float], ...] | None = None

    def __post_init__(self) -> None:
        if self.kind not in DUAL_ARMS:
            raise unknown_name("kind of dual-arm robot", self.kind, DUAL_ARMS)
        flag("visual", self.visual)
        positive("timestep", self.timestep, 0.1)
        if self.mounts is not None:
            if not hasattr(DUAL_ARMS[self.kind].parameters, "mounts"):
                raise ConfigurationError("mounts can be chosen for the planar robot only")
            points = numbers(self.mounts)
            if points is None or points.shape != (2, 2) or not (np.abs(points) <= 5.0).all():
                raise ConfigurationError(
                    f"mounts must be two points (x, y) within 5 m of the satellite, got {shown(self.mounts)}"
                )
            object.__setattr__(self, "mounts", tuple((float(x), float(y)) for x, y in points))


def dual_arm_spec(options: DualArmOptions = DualArmOptions()) -> mujoco.MjSpec:
    """Build the editable model.

    Body `arm{a}_link{i}` carries joint `arm{a}_joint{i}`; sites `end_effector{a}` and `grapple{a}` belong
    together. The satellite's frame is at its centre of mass. Masses and inertias are written explicitly.
    """
    spec = mujoco.MjSpec()
    spec.modelname = f"dual_arm_{options.kind}"
    spec.compiler.degree = False
    spec.compiler.balanceinertia = False
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.timestep = options.timestep
    robot = DUAL_ARMS[options.kind]
    parameters = robot.parameters
    if options.mounts is not None:
        parameters = replace(parameters, mounts=options.mounts)
    robot.build(spec, parameters)
    if options.visual:
        draw(spec, find_robot({"planar": "shah2013", "spatial": "spatial_dual_arm"}[options.kind]))
    _add_sensors(spec)
    if robot.shape.half is not None:
        add_point_sensors(spec, robot.shape, ARMS, SATELLITE)
    add_point_sensors(spec, robot.shape, ARMS, TARGET)
    _add_half_width_sensor(spec)
    return spec


@lru_cache(maxsize=32)
def dual_arm_model(options: DualArmOptions = DualArmOptions()) -> mujoco.MjModel:
    """Compile the model. The result is shared: treat it as read-only, copy it to change it."""
    return dual_arm_spec(options).compile()


def _add_sensors(spec: mujoco.MjSpec) -> None:
    """Sensors by name; the task selects those that it observes."""
    sensor, obj = mujoco.mjtSensor, mujoco.mjtObj

    def add(name: str, type: mujoco.mjtSensor, of: mujoco.mjtObj, object_name: str) -> None:
        spec.add_sensor(name=name, type=type, objtype=of, objname=object_name)

    joints = [actuator.name for actuator in spec.actuators]
    for joint in joints:
        add(f"{joint}_position", sensor.mjSENS_JOINTPOS, obj.mjOBJ_JOINT, joint)
    for joint in joints:
        add(f"{joint}_velocity", sensor.mjSENS_JOINTVEL, obj.mjOBJ_JOINT, joint)
    for site in (SATELLITE, TARGET, *END_EFFECTORS, *GRAPPLES):
        add(f"{site}_position", sensor.mjSENS_FRAMEPOS, obj.mjOBJ_SITE, site)
        if site in (SATELLITE, TARGET):
            if len(spec.body(site).joints) > 1:  # two slides and a hinge in the plane
                add(f"{site}_angle", sensor.mjSENS_JOINTPOS, obj.mjOBJ_JOINT, f"{site}_turn")
            else:
                add(f"{site}_quaternion", sensor.mjSENS_FRAMEQUAT, obj.mjOBJ_SITE, site)
            add(f"{site}_angular_velocity", sensor.mjSENS_FRAMEANGVEL, obj.mjOBJ_SITE, site)
        else:
            add(f"{site}_axis", sensor.mjSENS_FRAMEZAXIS, obj.mjOBJ_SITE, site)
        add(f"{site}_linear_velocity", sensor.mjSENS_FRAMELINVEL, obj.mjOBJ_SITE, site)


def _add_half_width_sensor(spec: mujoco.MjSpec) -> None:
    """Add a sensor of a grapple point in the target's frame, which gives the target's size."""
    spec.add_sensor(
        name="half_width",
        type=mujoco.mjtSensor.mjSENS_FRAMEPOS,
        objtype=mujoco.mjtObj.mjOBJ_SITE,
        objname=GRAPPLES[0],
        reftype=mujoco.mjtObj.mjOBJ_XBODY,
        refname=TARGET,
    )
