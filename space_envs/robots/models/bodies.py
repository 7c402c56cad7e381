"""A robot as an MjSpec: its satellite and its arms, with joints, actuators and the points of its shape.

Names are the same for every robot: bodies `satellite` and `link1`, `link2`, ... from the satellite outwards,
each with the joint and the actuator `joint1`, `joint2`, ..., and the site `end_effector`. With two arms they
are `arm1_link1`, `arm1_joint1` and `end_effector1`, and so on.
"""

import mujoco
import numpy as np

from space_envs.robots.robot import Anchor, Arm, Joint, Link, Robot, Satellite

SATELLITE = "satellite"
END_EFFECTOR = "end_effector"
PLANE = ("x", "y", "turn")  # joints of a body that moves in the plane: two slides and a hinge
_SITE = {"size": [0.01, 0.01, 0.01], "group": 4}


def arm_numbers(robot: Robot) -> tuple[int | None, ...]:
    """Number of each arm in names; None for the only one."""
    return (None,) if len(robot.arms) == 1 else (1, 2)


def link_name(arm: int | None, number: int) -> str:
    """Name of the body of a link, numbered from 1."""
    return f"link{number}" if arm is None else f"arm{arm}_link{number}"


def joint_name(arm: int | None, number: int) -> str:
    """Name of the joint and the actuator of a link."""
    return f"joint{number}" if arm is None else f"arm{arm}_joint{number}"


def site_name(arm: int | None, name: str) -> str:
    """Name of a site of an arm."""
    return name if arm is None else f"{name}{arm}"


def anchor_name(arm: int | None, anchor: Anchor) -> str:
    """Name of the site or, at the origin of a link's frame, of the body of an anchor."""
    return link_name(arm, anchor.link) if anchor.name is None else site_name(arm, anchor.name)


def end_effectors(robot: Robot) -> tuple[str, ...]:
    """Names of the sites of the end-effectors."""
    return tuple(site_name(arm, END_EFFECTOR) for arm in arm_numbers(robot))


def joint_names(robot: Robot) -> list[str]:
    """Names of all joints, arm by arm."""
    return [
        joint_name(number, place)
        for number, arm in zip(arm_numbers(robot), robot.arms, strict=True)
        for place in range(1, len(arm.links) + 1)
    ]


def empty_spec(robot: Robot, timestep: float) -> mujoco.MjSpec:
    """Model without bodies or gravity, with explicit inertias and the suite's integrator."""
    spec = mujoco.MjSpec()
    spec.modelname = robot.name
    spec.compiler.degree = False
    spec.compiler.balanceinertia = False
    spec.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_FALSE
    spec.option.gravity = [0.0, 0.0, 0.0]
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
    spec.option.timestep = timestep
    return spec


def add_robot(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add the bodies, joints, actuators and sites of a robot.

    A link's body has the frame in which its joint rotates. Masses and inertias are explicit; no geom has any.
    """
    satellite = _add_satellite(spec, robot.satellite)
    if robot.planar:
        move_in_plane(satellite, SATELLITE)
    else:
        satellite.add_freejoint(name=SATELLITE)
    for number, arm in zip(arm_numbers(robot), robot.arms, strict=True):
        _add_arm(spec, satellite, number, arm)


def add_hollow_site(body: mujoco.MjsBody, name: str, **pose: list[float]) -> None:
    """Add a site that is not drawn."""
    body.add_site(name=name, **pose, **_SITE)


def _add_satellite(spec: mujoco.MjSpec, parameters: Satellite) -> mujoco.MjsBody:
    body = spec.worldbody.add_body(name=SATELLITE, explicitinertial=True)
    inertial = parameters.inertial
    body.mass, body.ipos, body.iquat = inertial.mass, list(inertial.centre), list(inertial.axes)
    body.inertia = list(inertial.moments)
    add_hollow_site(body, SATELLITE)
    return body


def _add_arm(spec: mujoco.MjSpec, satellite: mujoco.MjsBody, number: int | None, arm: Arm) -> None:
    body = satellite
    bodies = []
    for place, link in enumerate(arm.links, start=1):
        body = _add_link(body, link_name(number, place), link)
        _add_joint(spec, body, joint_name(number, place), link.joint)
        bodies.append(body)
    tool = {"pos": list(arm.tool_position), "quat": list(arm.tool_orientation)}
    add_hollow_site(body, site_name(number, END_EFFECTOR), **tool)
    for anchor in arm.anchors:
        if anchor.name is not None and anchor.name != END_EFFECTOR:
            add_hollow_site(bodies[anchor.link - 1], site_name(number, anchor.name), pos=list(anchor.at))


def _add_link(parent: mujoco.MjsBody, name: str, link: Link) -> mujoco.MjsBody:
    body = parent.add_body(
        name=name, pos=list(link.position), quat=list(link.orientation), explicitinertial=True
    )
    inertial = link.inertial
    body.mass, body.ipos, body.iquat = inertial.mass, list(inertial.centre), list(inertial.axes)
    body.inertia = list(inertial.moments)
    return body


def _add_joint(spec: mujoco.MjSpec, body: mujoco.MjsBody, name: str, joint: Joint) -> None:
    torque = joint.torque_limit
    body.add_joint(
        name=name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=list(joint.axis),
        armature=joint.rotor_inertia,
        range=list(joint.range),
    )
    spec.add_actuator(
        name=name,
        target=name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT,
        ctrlrange=[-torque, torque],
        forcerange=[-torque, torque],
    ).set_to_motor()


def move_in_plane(body: mujoco.MjsBody, name: str) -> None:
    """Add the joints of a body that moves in the plane z = 0."""
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    axes = np.eye(3).tolist()
    for kind, axis, joint in zip((slide, slide, hinge), axes, PLANE, strict=True):
        body.add_joint(name=f"{name}_{joint}", type=kind, axis=axis)
