"""Inertias of simple bodies, and of bodies that are fixed to each other."""

from collections.abc import Sequence

import mujoco
import numpy as np

from space_envs.dynamics.rotations import Array, from_matrix, to_matrix
from space_envs.robots.pose import Pose
from space_envs.robots.robot import Inertial, Quaternion, Vector3

_DIGITS = 12  # significant, of masses and moments


def rod_moments(mass: float, radius: float, along: Vector3) -> Vector3:
    """Principal inertia of a solid cylinder whose axis is one of the frame's axes, kg m^2.

    Args:
        mass: kg.
        radius: m.
        along: the cylinder's axis times its length, m, with at most one component that is not zero.
            A link of length zero is a cylinder as long as its diameter, about z.
    """
    length = max(map(abs, along)) or 2 * radius
    axis = max(range(3), key=lambda i: abs(along[i])) if any(along) else 2
    transverse = mass * (3 * radius**2 + length**2) / 12
    moments = [transverse] * 3
    moments[axis] = mass * radius**2 / 2
    return (moments[0], moments[1], moments[2])


def box_moments(mass: float, sides: Vector3) -> Vector3:
    """Principal inertia of a homogeneous box, kg m^2; sides in m."""
    x, y, z = (side**2 for side in sides)
    return (mass * (y + z) / 12, mass * (z + x) / 12, mass * (x + y) / 12)


def principal(mass: float, centre: Array, inertia: Array) -> Inertial:
    """Mass properties from an inertia matrix (3, 3) about the centre of mass, in the body's axes, kg m^2."""
    scale = float(np.abs(inertia).max()) or 1.0
    # Rounded, so that the axes of two equal moments are the same on every machine.
    symmetric = np.round((inertia + inertia.T) / (2.0 * scale), _DIGITS)
    moments, axes = np.diag(symmetric), np.array([1.0, 0.0, 0.0, 0.0])
    if not np.array_equal(symmetric, np.diag(moments)):
        moments, vectors, axes = np.empty(3), np.empty(9), np.empty(4)
        mujoco.mju_eig3(moments, vectors, axes, symmetric.ravel())
    return rounded(Inertial(mass, vector(scale * moments), vector(centre), quaternion(axes)))


def rounded(body: Inertial) -> Inertial:
    """The same mass properties without the rounding errors of one machine, which change a robot's digest."""
    pose = Pose.of(body.centre, body.axes)
    first, second, third = map(_significant, body.moments)
    return Inertial(_significant(body.mass), (first, second, third), pose.vector, pose.quaternion)


def _significant(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def matrix(body: Inertial) -> Array:
    """Inertia (3, 3) about the centre of mass, in the body's axes, kg m^2."""
    axes = to_matrix(np.array(body.axes))
    return axes @ np.diag(body.moments) @ axes.T


def moved(
    body: Inertial, position: Sequence[float] | Array, orientation: Sequence[float] | Array
) -> Inertial:
    """Mass properties of a body in the frame in which its own has this pose, m and quaternion."""
    rotation = to_matrix(np.array(orientation))
    centre = np.array(position) + rotation @ np.array(body.centre)
    return Inertial(
        body.mass,
        body.moments,
        vector(centre),
        quaternion(from_matrix(rotation @ to_matrix(np.array(body.axes)))),
    )


def combined(bodies: Sequence[Inertial]) -> Inertial:
    """Mass properties of bodies in one frame that are fixed to each other; at least one has mass."""
    if len(bodies) == 1:
        return bodies[0]
    mass = sum(body.mass for body in bodies)
    centre = sum((body.mass * np.array(body.centre) for body in bodies), np.zeros(3)) / mass
    inertia = np.zeros((3, 3))
    for body in bodies:
        away = np.array(body.centre) - centre
        inertia += matrix(body) + body.mass * (away @ away * np.eye(3) - np.outer(away, away))
    return principal(mass, centre, inertia)


def vector(values: Sequence[float] | Array) -> Vector3:
    """Three numbers as a tuple of floats, without negative zeros."""
    x, y, z = (float(value) + 0.0 for value in values)
    return (x, y, z)


def quaternion(values: Sequence[float] | Array) -> Quaternion:
    """Four numbers as a tuple of floats, without negative zeros."""
    w, x, y, z = (float(value) + 0.0 for value in values)
    return (w, x, y, z)
