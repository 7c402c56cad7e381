"""Motion of several end-effectors that does not rotate the base, batched.

All quantities are in base axes. At zero momentum a joint motion rotates the base at w0 = W thetadot, W being
the angular half of the base map; W thetadot = 0 is the reactionless constraint, eq. 4 of shah2013.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.floating import FloatingRobot, Kinematics
from space_envs.dynamics.rotations import Array, conjugate, cross, exponential, multiply, rotate

_TINY = 1e-12  # of W W', which in the plane has two rows of zeros
_STEPS = 90
_LARGEST_STEP = 0.06  # rad


class EndEffectors(NamedTuple):
    """End-effectors of a robot: position (..., k, 3) m, approach axis z (..., k, 3), and their Jacobians at
    zero momentum, linear and angular (..., k, 3, n); base_angular (..., 3, n) is W, that of the base."""

    position: Array
    axis: Array
    linear: Array
    angular: Array
    base_angular: Array


def end_effectors(robot: FloatingRobot, q: Array, kinematics: Kinematics | None = None) -> EndEffectors:
    """All end-effectors for joint angles q (..., n) rad, in the base frame."""
    k = robot.kinematics(q) if kinematics is None else kinematics
    base_map = robot.base_map(q)
    v0, w0 = base_map[..., None, :3, :], base_map[..., 3:, :]
    links = robot.end_effector_link - 1
    rotation = k.rotation[..., links, :, :]
    position = k.position[..., links, :] + (rotation @ robot.end_effector_offset[..., None])[..., 0]
    axis = (rotation @ robot.end_effector_mounting)[..., 2]
    carries = robot.carries.T[links][..., None]  # (k, n, 1)
    axes = k.axis[..., None, :, :] * carries
    arm = cross(axes, position[..., :, None, :] - k.position[..., None, :, :])
    # A rotation w0 of the base moves the point at p at w0 x p.
    carried = -cross(position[..., :, None, :], w0.swapaxes(-1, -2)[..., None, :, :])
    linear = (arm + carried).swapaxes(-1, -2) + v0
    angular = axes.swapaxes(-1, -2) + w0[..., None, :, :]
    return EndEffectors(position, axis, linear, angular, w0)


def reactionless_rates(
    now: EndEffectors,
    velocity: Array,
    angular_velocity: Array | None = None,
    base_rate: Array | None = None,
    posture: Array | None = None,
    damping: float = 0.03,
    weight: float = 0.5,
) -> Array:
    """Joint rates (..., n) rad/s that move the end-effectors as close as possible to the command.

    The base rate is met exactly for any damping: eq. 9 of shah2013 with a damped inverse.

    Args:
        now: from `end_effectors`. velocity: (..., k, 3) m/s of the end-effectors, inertial, in base axes.
        angular_velocity: (..., k, 3) rad/s, perpendicular to the approach axis; None does not constrain it.
        base_rate: (..., 3) rad/s of the base; None is zero.
        posture: (..., n) rad/s preferred joint rates, in the remaining null space; None is zero.
        damping: of the inverse, m/rad. weight: of rotation relative to displacement, m/rad.
    """
    n = now.base_angular.shape[-1]
    batch, n_rows = now.base_angular.shape[:-2], 3 * now.position.shape[-2]
    square = now.base_angular @ now.base_angular.swapaxes(-1, -2) + _TINY * np.eye(3)
    back = now.base_angular.swapaxes(-1, -2) @ np.linalg.inv(square)
    # Applied twice: the regularisation passes a share _TINY / W W' of the rotation, then its square.
    null = np.eye(n) - back @ now.base_angular
    null = null - back @ (now.base_angular @ null)
    rows = now.linear.reshape(*batch, n_rows, n)
    command = velocity.reshape(*batch, n_rows)
    if angular_velocity is not None:
        across = np.eye(3) - now.axis[..., :, None] * now.axis[..., None, :]
        rows = np.concatenate([rows, weight * (across @ now.angular).reshape(*batch, n_rows, n)], axis=-2)
        command = np.concatenate([command, weight * angular_velocity.reshape(*batch, n_rows)], axis=-1)
    given = np.zeros((*batch, n)) if base_rate is None else (back @ base_rate[..., None])[..., 0]
    if posture is not None:
        given = given + (null @ posture[..., None])[..., 0]
    rest = command - (rows @ given[..., None])[..., 0]
    reduced = rows @ null
    inner = reduced @ reduced.swapaxes(-1, -2) + damping**2 * np.eye(rows.shape[-2])
    return given + (reduced.swapaxes(-1, -2) @ np.linalg.solve(inner, rest[..., None]))[..., 0]


def reactionless_projection(
    base_angular: Array,
    rate: Array,
    base_rate: Array | None = None,
    adjustable: NDArray[np.bool_] | None = None,
    regularisation: float = _TINY,
) -> Array:
    """Joint rates (..., n) nearest to given ones for which the base rotates at `base_rate` (..., w).

    Args:
        base_angular: (..., w, n), angular velocity of the base per joint rate; w is 3, or 1 in the plane.
        rate: (..., n) rad/s. base_rate: rad/s, in the axes of `base_angular`; None is zero.
        adjustable: (..., n) bool, joints whose rates may change; None is all.
        regularisation: added to W W'.
    """
    error = (0.0 if base_rate is None else base_rate) - (base_angular @ rate[..., None])[..., 0]
    used = base_angular if adjustable is None else base_angular * adjustable[..., None, :]
    square = used @ base_angular.swapaxes(-1, -2)
    square += regularisation * _identity(base_angular.shape[-2])
    return rate + (used.swapaxes(-1, -2) @ np.linalg.solve(square, error[..., None]))[..., 0]


@cache
def _identity(size: int) -> Array:
    return np.eye(size)


def axis_rotation(axis: Array, goal: Array) -> Array:
    """Rotation vectors (..., 3), rad, that rotate unit vectors (..., 3) onto others by the smaller angle."""
    normal = cross(axis, goal)
    sine = np.sqrt((normal * normal).sum(axis=-1, keepdims=True))
    cosine = (axis * goal).sum(axis=-1, keepdims=True)
    opposite = (sine < 1e-9) & (cosine < 0.0)
    if opposite.any():
        # The axis of a rotation by pi is any perpendicular.
        least = np.eye(3)[np.abs(axis).argmin(axis=-1)]
        other = cross(axis, least)
        other = other / np.sqrt((other * other).sum(axis=-1, keepdims=True))
        normal, sine = np.where(opposite, 1e-9 * other, normal), np.where(opposite, 1e-9, sine)
    return normal * (np.arctan2(sine, cosine) / np.maximum(sine, 1e-300))


class Reached(NamedTuple):
    """End of a roll-out.

    Attributes:
        q: (K, n) rad. distance: (K,) m, largest residual. angle: (K,) rad, likewise, of the approach axes.
        attitude: (K, 4) of the base, which was the identity at the start.
    """

    q: Array
    distance: Array
    angle: Array
    attitude: Array


def reach(robot: FloatingRobot, start: Array, position: Array, axis: Array | None = None) -> Reached:
    """Roll out a reactionless motion that takes the end-effectors to points at rest.

    The base starts at the origin and does not rotate. Steps are of second order, so the approximated motion
    is reactionless throughout: a goal that it reaches is reachable.

    Args:
        start: (K, n) rad. position: (K, k, 3) m, inertial frame. axis: (K, k, 3) approach axes, or None.
    """
    q = np.array(start, dtype=np.float64)
    origin = robot.centre_of_mass(robot.kinematics(q))
    rotation = None
    for _ in range(_STEPS):
        now, residual, rotation = _residual(robot, q, origin, position, axis)
        change = reactionless_rates(now, 0.3 * residual, None if rotation is None else 0.3 * rotation)
        change *= _step_factor(change)
        # Each step is projected with the map at its midpoint.
        q = q + reactionless_projection(robot.base_map(q + 0.5 * change)[..., 3:, :], change)
    _, residual, rotation = _residual(robot, q, origin, position, axis)
    return Reached(q, *_largest(residual, rotation), np.tile([1.0, 0.0, 0.0, 0.0], (len(q), 1)))


def reach_rotating(robot: FloatingRobot, start: Array, position: Array, axis: Array | None = None) -> Reached:
    """Roll out a motion that takes the end-effectors to points at rest, while the base rotates as it may.

    Arguments as of `reach`. For robots that have too few joints to keep the attitude too.
    """
    q = np.array(start, dtype=np.float64)
    origin = robot.centre_of_mass(robot.kinematics(q))
    attitude = np.tile([1.0, 0.0, 0.0, 0.0], (len(q), 1))

    def seen() -> tuple[EndEffectors, Array, Array | None]:
        """End-effectors and what they lack, in base axes."""
        back = conjugate(attitude)[:, None]
        now, rest, rotation = _residual(
            robot,
            q,
            0.0 * origin,
            rotate(back, position - origin[:, None]),
            None if axis is None else rotate(back, axis),
        )
        return now, rest, rotation

    for _ in range(_STEPS):
        now, residual, rotation = seen()
        change = _nearest_rates(now, 0.3 * residual, None if rotation is None else 0.3 * rotation)
        change *= _step_factor(change)
        spin = (robot.base_map(q + 0.5 * change)[..., 3:, :] @ change[..., None])[..., 0]
        q, attitude = q + change, multiply(attitude, exponential(spin))
    _, residual, rotation = seen()
    return Reached(q, *_largest(residual, rotation), attitude)


def _nearest_rates(
    now: EndEffectors,
    velocity: Array,
    angular_velocity: Array | None,
    damping: float = 0.03,
    weight: float = 0.5,
) -> Array:
    """Joint rates (..., n) that move the end-effectors, by the damped generalised Jacobian."""
    n, batch = now.base_angular.shape[-1], now.base_angular.shape[:-2]
    rows, command = now.linear.reshape(*batch, -1, n), velocity.reshape(*batch, -1)
    if angular_velocity is not None:
        across = np.eye(3) - now.axis[..., :, None] * now.axis[..., None, :]
        rows = np.concatenate([rows, weight * (across @ now.angular).reshape(*batch, -1, n)], axis=-2)
        command = np.concatenate([command, weight * angular_velocity.reshape(*batch, -1)], axis=-1)
    inner = rows @ rows.swapaxes(-1, -2) + damping**2 * np.eye(rows.shape[-2])
    return (rows.swapaxes(-1, -2) @ np.linalg.solve(inner, command[..., None]))[..., 0]


def _step_factor(change: Array) -> Array:
    """Factor (K, 1) up to 1 on steps (K, n), rad, after which no joint moves by more than the largest."""
    return np.minimum(_LARGEST_STEP / np.maximum(np.abs(change).max(axis=-1), 1e-12), 1.0)[:, None]


def _largest(residual: Array, rotation: Array | None) -> tuple[Array, Array]:
    """Largest distance and angle (K,) over the end-effectors."""
    distance = np.sqrt((residual * residual).sum(axis=-1)).max(axis=-1)
    if rotation is None:
        return distance, np.zeros(len(distance))
    return distance, np.sqrt((rotation * rotation).sum(axis=-1)).max(axis=-1)


def _residual(
    robot: FloatingRobot, q: Array, origin: Array, position: Array, axis: Array | None
) -> tuple[EndEffectors, Array, Array | None]:
    kinematics = robot.kinematics(q)
    now = end_effectors(robot, q, kinematics)
    # The system's centre of mass is at rest, so the base moves opposite to it as seen in the base frame.
    base = (origin - robot.centre_of_mass(kinematics))[:, None]
    return now, position - (now.position + base), None if axis is None else axis_rotation(now.axis, axis)
