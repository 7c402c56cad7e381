"""Sensors of a robot's model: what a task observes, and the points of the arms for contacts."""

import mujoco

from space_envs.robots.models.bodies import (
    SATELLITE,
    anchor_name,
    arm_numbers,
    end_effectors,
    joint_names,
)
from space_envs.robots.robot import Robot

_KIND, _OBJECT = mujoco.mjtSensor, mujoco.mjtObj
_TWIST = {"linear_velocity": _KIND.mjSENS_FRAMELINVEL, "angular_velocity": _KIND.mjSENS_FRAMEANGVEL}


def add_sensors(spec: mujoco.MjSpec, robot: Robot, moving_target: bool = False) -> None:
    """Add `{joint}_position` and `{joint}_velocity`, then poses and velocities of the satellite, the
    end-effectors and what they capture.

    For one arm they have the order of the task's observation, so that an observation is one copy of them;
    the velocity of what it captures is measured where that moves.
    """
    for joint in joint_names(robot):
        _add(spec, f"{joint}_position", _KIND.mjSENS_JOINTPOS, _OBJECT.mjOBJ_JOINT, joint)
    for joint in joint_names(robot):
        _add(spec, f"{joint}_velocity", _KIND.mjSENS_JOINTVEL, _OBJECT.mjOBJ_JOINT, joint)
    if robot.target is None:
        for site in (SATELLITE, *end_effectors(robot)):
            _add_frame(spec, site, "quaternion", *_TWIST)
        _add_frame(spec, "grapple", "quaternion", *(_TWIST if moving_target else ()))
        if moving_target:
            _add_frame(spec, "target", "quaternion", *_TWIST)
        return
    for site in (SATELLITE, "target"):
        _add_frame(
            spec, site, "angle" if robot.planar else "quaternion", "angular_velocity", "linear_velocity"
        )
    for site in (*end_effectors(robot), "grapple1", "grapple2"):
        _add_frame(spec, site, "axis", "linear_velocity")


def _add_frame(spec: mujoco.MjSpec, site: str, *quantities: str) -> None:
    """Add sensors of the position and of more quantities of a site, in the inertial frame."""
    kinds = {"quaternion": _KIND.mjSENS_FRAMEQUAT, "axis": _KIND.mjSENS_FRAMEZAXIS, **_TWIST}
    _add(spec, f"{site}_position", _KIND.mjSENS_FRAMEPOS, _OBJECT.mjOBJ_SITE, site)
    for name in quantities:
        if name == "angle":
            _add(spec, f"{site}_angle", _KIND.mjSENS_JOINTPOS, _OBJECT.mjOBJ_JOINT, f"{site}_turn")
        else:
            _add(spec, f"{site}_{name}", kinds[name], _OBJECT.mjOBJ_SITE, site)


def add_obstacle_sensors(spec: mujoco.MjSpec, robot: Robot, count: int) -> None:
    """Add sensors of the centres and surfaces of keep-out spheres, and `{point}_in_world` of the anchors.

    A surface is measured from its centre, in the axes of the sphere, which do not rotate.
    """
    if not count:
        return
    names = [f"obstacle{number}" for number in range(1, count + 1)]
    for name in names:
        _add(spec, f"{name}_position", _KIND.mjSENS_FRAMEPOS, _OBJECT.mjOBJ_SITE, name)
    for name in names:
        surface = f"{name}_surface"
        _add(
            spec,
            f"{name}_radius",
            _KIND.mjSENS_FRAMEPOS,
            _OBJECT.mjOBJ_SITE,
            surface,
            _OBJECT.mjOBJ_SITE,
            name,
        )
    _add_points(spec, robot, "world")


def add_target_sensors(spec: mujoco.MjSpec, robot: Robot) -> None:
    """Add sensors `{point}_in_satellite` and `{point}_in_target` of the arms' anchors, as contacts need them,
    and of a grapple point in the target's frame, which gives the target's size."""
    frames = [SATELLITE] if robot.satellite.reachable else []
    frames += [] if robot.target is None else ["target"]
    for frame in frames:
        _add_points(spec, robot, frame)
    if robot.target is not None:
        of = _OBJECT.mjOBJ_SITE, "grapple1", _OBJECT.mjOBJ_XBODY, "target"
        _add(spec, "half_width", _KIND.mjSENS_FRAMEPOS, *of)


def _add_points(spec: mujoco.MjSpec, robot: Robot, frame: str) -> None:
    """Add sensors of the anchors of all arms in the frame of a body, one after another."""
    for number, arm in zip(arm_numbers(robot), robot.arms, strict=True):
        for anchor in arm.anchors:
            name = anchor_name(number, anchor)
            kind = _OBJECT.mjOBJ_XBODY if anchor.name is None else _OBJECT.mjOBJ_SITE
            of = () if frame == "world" else (_OBJECT.mjOBJ_XBODY, frame)
            _add(spec, f"{name}_in_{frame}", _KIND.mjSENS_FRAMEPOS, kind, name, *of)


def _add(
    spec: mujoco.MjSpec,
    name: str,
    kind: mujoco.mjtSensor,
    of: mujoco.mjtObj,
    object_name: str,
    reference: mujoco.mjtObj = mujoco.mjtObj.mjOBJ_UNKNOWN,
    reference_name: str = "",
) -> None:
    spec.add_sensor(
        name=name, type=kind, objtype=of, objname=object_name, reftype=reference, refname=reference_name
    )
