"""Arms whose links are given inline, as a table of Denavit-Hartenberg parameters with masses and inertias.

The convention is the standard (classical) one: the pose of frame i in frame i - 1 is
Rz(theta) Tz(d) Tx(a) Rx(alpha), theta being the angle of joint i, which rotates about z of frame i - 1. The
frame of a link here is frame i - 1 rotated by the joint angle, so that the joint's axis is its z axis.
"""

from math import cos, sin

import numpy as np

from space_envs.dynamics.rotations import rotate
from space_envs.robots.description.arms import DescribedArm
from space_envs.robots.description.limits import JointValues, joint_values
from space_envs.robots.description.tables import DescriptionTable
from space_envs.robots.inertias import rod_moments, vector
from space_envs.robots.robot import IDENTITY, ORIGIN, Inertial, Joint, Link, Quaternion, Vector3

ROW_KEYS = ("alpha", "a", "d", "mass", "inertia", "com", "name")
_ROUNDING = 1e-12  # m, of a length along an axis


def inline_arm(arm: DescriptionTable) -> DescribedArm:
    """The arm of a table with `links`, at its mount.

    Raises:
        ConfigurationError: for a value that is missing or not valid.
    """
    rows = arm.tables("links", ROW_KEYS)
    if not rows:
        raise arm.error("links must be a list of tables, one for each joint, got an empty list")
    names = [row.text("name", f"link {number}") for number, row in enumerate(rows, start=1)]
    values = joint_values(arm, [f"joint {number}" for number in range(1, len(rows) + 1)])
    position, orientation = ORIGIN, IDENTITY
    links = []
    for number, row in enumerate(rows):
        alpha, a, d = (row.number(key, 0.0) for key in ("alpha", "a", "d"))
        links.append(
            Link(
                names[number], position, orientation, _joint(values, number), _inertial(arm, row, alpha, a, d)
            )
        )
        position, orientation = (a, 0.0, d), about_x(alpha)
    return DescribedArm(tuple(links), position, orientation)


def about_x(angle: float) -> Quaternion:
    """Quaternion of a rotation about x."""
    return (cos(angle / 2), sin(angle / 2), 0.0, 0.0)


def _joint(values: JointValues, number: int) -> Joint:
    return Joint(
        name=values.names[number],
        range=values.range[number],
        home=values.home[number],
        rate_limit=values.rate[number],
        acceleration_limit=values.acceleration[number],
        torque_limit=values.torque[number],
        rotor_inertia=values.rotor_inertia[number],
    )


def _inertial(arm: DescriptionTable, row: DescriptionTable, alpha: float, a: float, d: float) -> Inertial:
    """Mass properties of a link in its joint's frame; the centre of mass is in the middle unless given.

    `inertia` and `com` of a row are in Denavit-Hartenberg frame i.
    """
    mass = row.positive("mass", hint=", in kg")
    axes = about_x(alpha)
    centre: Vector3 = (a / 2, 0.0, d / 2)
    if "com" in row:
        offset = rotate(np.array(axes), np.array(row.vector("com", 3)))
        centre = vector(np.array([a, 0.0, d]) + offset)
    if arm.flag("rods", False) or "inertia" not in row:
        # The link runs along (a, 0, d) before Rx(alpha).
        along = (a, d * sin(alpha), d * cos(alpha))
        straight = (along[0], along[1], 0.0 if abs(along[2]) < _ROUNDING else along[2])
        if sum(abs(part) > _ROUNDING for part in straight) > 1:
            raise row.error(
                "lacks 'inertia': a solid rod is assumed for links along one axis of their frame only, and "
                f"this one runs along {tuple(round(part, 6) for part in straight)}"
            )
        return Inertial(mass, rod_moments(mass, arm.positive("radius"), straight), centre, axes)
    return Inertial(mass, row.moments("inertia"), centre, axes)
