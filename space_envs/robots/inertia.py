"""Mass properties of bodies that are fixed to each other, and of single ones as matrices."""

from collections.abc import Iterable

import mujoco
import numpy as np

from space_envs.dynamics.rotations import Array
from space_envs.robots.pose import Pose, vector
from space_envs.robots.robot import IDENTITY, ORIGIN, Inertial

_DIGITS = 12  # significant, of masses and moments; the others are rounding errors of one machine


def principal(mass: float, centre: Array, inertia: Array) -> Inertial:
    """Mass properties from the inertia matrix (3, 3) about the centre of mass, in the body's axes, kg m^2."""
    scale = float(np.abs(inertia).max()) or 1.0
    # Rounded, so that the axes of two equal moments are the same on every machine.
    symmetric = np.round((inertia + inertia.T) / (2 * scale), _DIGITS)
    moments, axes = np.diag(symmetric), IDENTITY
    if not np.array_equal(symmetric, np.diag(moments)):
        moments, vectors, quaternion = np.empty(3), np.empty(9), np.empty(4)
        mujoco.mju_eig3(moments, vectors, quaternion, symmetric.ravel())
        axes = Pose.of(ORIGIN, quaternion).quaternion
    first, second, third = (_significant(scale * moment) for moment in moments)
    return Inertial(_significant(mass), (first, second, third), vector(centre), axes)


def _significant(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")


def matrix(inertial: Inertial) -> Array:
    """(3, 3) inertia about the centre of mass in the body's axes, kg m^2."""
    axes = Pose.of(ORIGIN, inertial.axes).rotation
    return axes @ (np.array(inertial.moments)[:, None] * axes.T)


def moved(inertial: Inertial, pose: Pose) -> Inertial:
    """The same body seen from a frame in which its own has this pose."""
    centre = vector(pose.point(inertial.centre))
    if np.array_equal(pose.rotation, np.eye(3)):
        return Inertial(inertial.mass, inertial.moments, centre, inertial.axes)
    return Inertial(
        inertial.mass, inertial.moments, centre, (pose @ Pose.of(ORIGIN, inertial.axes)).quaternion
    )


def lumped(parts: Iterable[Inertial]) -> Inertial:
    """Mass properties of bodies in one frame that are fixed to each other; of none, zero mass."""
    parts = [part for part in parts if part.mass > 0.0 or any(part.moments)]
    if len(parts) == 1:
        return parts[0]
    mass = sum(part.mass for part in parts)
    if mass == 0.0:
        inertia = sum((matrix(part) for part in parts), np.zeros((3, 3)))
        return principal(0.0, np.zeros(3), inertia) if parts else Inertial(0.0, ORIGIN, ORIGIN, IDENTITY)
    centre = sum((part.mass * np.array(part.centre) for part in parts), np.zeros(3)) / mass
    about = sum((matrix(part) + _steiner(part, centre) for part in parts), np.zeros((3, 3)))
    return principal(mass, centre, about)


def _steiner(part: Inertial, centre: Array) -> Array:
    """Inertia (3, 3) of a body's mass at its own centre about another point, by the parallel-axis theorem."""
    arm = np.array(part.centre) - centre
    return part.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm))
