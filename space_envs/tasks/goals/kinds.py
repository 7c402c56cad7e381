"""Kinds of goals: how much of a grapple's pose an end-effector has to take."""

from typing import Literal, cast

import numpy as np

from space_envs.dynamics.reactionless import axis_rotation
from space_envs.dynamics.rotations import (
    Array,
    angle_between,
    canonical,
    conjugate,
    logarithm,
    multiply,
    z_axis,
)
from space_envs.errors import unknown_name

GoalKind = Literal["pose", "axis", "position"]
"""The whole pose; position and approach axis (z), with any rotation about it; or position alone."""
GOAL_KINDS: tuple[GoalKind, ...] = ("pose", "axis", "position")
GOAL_ROWS: dict[GoalKind, int] = {"pose": 6, "axis": 5, "position": 3}  # independent equations of a goal


def checked_kind(value: object) -> GoalKind:
    """A kind of goal. Raises ConfigurationError for another value, with the nearest valid name."""
    if not isinstance(value, str) or value not in GOAL_KINDS:
        raise unknown_name("kind of goal", value, GOAL_KINDS)
    return cast("GoalKind", value)


def rotation_to_goal(kind: GoalKind, quaternion: Array, goal: Array) -> Array:
    """Smallest rotation vectors (..., 3), rad, that bring end-effectors to what a goal asks of them.

    Args:
        quaternion, goal: (..., 4) of the end-effectors and of the grapples in one frame, whose axes the
            vectors have.
    """
    if kind == "pose":
        return logarithm(multiply(goal, conjugate(quaternion)))
    if kind == "axis":
        return axis_rotation(z_axis(quaternion), z_axis(goal))
    return np.zeros((*np.broadcast_shapes(quaternion.shape, goal.shape)[:-1], 3))


def goal_angle(kind: GoalKind, quaternion: Array, goal: Array) -> Array:
    """Angles (...,), rad in [0, pi], of the rotations of `rotation_to_goal`."""
    if kind == "pose":
        return angle_between(quaternion, goal)
    return np.linalg.norm(rotation_to_goal(kind, quaternion, goal), axis=-1)


def asked_jacobian(kind: GoalKind, jacobian: Array, axis: Array) -> Array:
    """Jacobians (..., 6, n) without the angular velocities that change nothing that a goal asks for.

    Args:
        jacobian: (..., 6, n) of end-effectors, linear first. axis: (..., 3) their approach axes, in the same
            axes as the velocities.
    """
    if kind == "pose":
        return jacobian
    asked = jacobian.copy()
    if kind == "position":
        asked[..., 3:, :] = 0.0
    else:
        angular = jacobian[..., 3:, :]
        asked[..., 3:, :] -= axis[..., :, None] * (axis[..., None, :] @ angular)
    return asked


def asked_attitude(kind: GoalKind, quaternion: Array) -> Array:
    """Quaternions (..., 4), w >= 0, of grapples without what a goal does not ask: equal for equal goals."""
    if kind == "pose":
        return canonical(quaternion)
    if kind == "position":
        return np.broadcast_to(np.array([1.0, 0.0, 0.0, 0.0]), quaternion.shape)
    # The rotation about z is left out (swing-twist decomposition); at half a revolution any axis will do.
    w, x, y, z = (quaternion[..., k] for k in range(4))
    length = np.sqrt(w * w + z * z)
    safe = np.maximum(length, 1e-300)
    swing = np.stack([length, (w * x - y * z) / safe, (w * y + x * z) / safe, np.zeros_like(w)], axis=-1)
    half = np.array([0.0, 1.0, 0.0, 0.0])
    return np.where(length[..., None] < 1e-12, half, swing)
