"""Motion of several end-effectors that does not rotate the base, batched.

All quantities are in base axes. At zero momentum a joint motion rotates the base at w0 = W thetadot, W being
the angular half of the base map; W thetadot = 0 is the reactionless constraint, eq. 4 of shah2013.
"""

from typing import NamedTuple

import numpy as np

from space_envs.dynamics.floating import FloatingRobot, Kinematics
from space_envs.dynamics.rotations import Array, cross

_TINY = 1e-12  # of W W', which in the plane has two rows of zeros
_STEPS = 90
_LARGEST_STEP = 0.06  # rad


class EndEffectors(NamedTuple):
    """End-effectors of a robot: position (..., k, 3) m, approach axis z (..., k, 3), and their Jacobians at
    zero momentum, linear and angular (..., k, 3, n); turning (..., 3, n) is W."""

    position: Array
    axis: Array
    linear: Array
    angular: Array
    turning: Array


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
    turn: Array | None = None,
    base_rate: Array | None = None,
    posture: Array | None = None,
    damping: float = 0.03,
    weight: float = 0.5,
) -> Array:
    """Joint rates (..., n) rad/s that move the end-effectors as nearly as possible as asked, at a base rate.

    The base rate is exact, whatever the damping: eq. 9 of shah2013 with a damped inverse.

    Args:
        now: of `end_effectors`. velocity: (..., k, 3) m/s of the end-effectors, inertial but in base axes.
        turn: (..., k, 3) rad/s, angular velocity across the approach axis; None leaves it free.
        base_rate: (..., 3) rad/s of the base; None is zero.
        posture: (..., n) rad/s of the joints in the directions that are free; None is rest.
        damping: of the inverse, in m/rad. weight: m/rad, of rotation against displacement.
    """
    n = now.turning.shape[-1]
    batch, asked = now.turning.shape[:-2], 3 * now.position.shape[-2]
    square = now.turning @ now.turning.swapaxes(-1, -2) + _TINY * np.eye(3)
    back = now.turning.swapaxes(-1, -2) @ np.linalg.inv(square)
    # Applied twice: the small regularisation leaves a share of _TINY / W W' of the rotation, then its square.
    null = np.eye(n) - back @ now.turning
    null = null - back @ (now.turning @ null)
    rows = now.linear.reshape(*batch, asked, n)
    wanted = velocity.reshape(*batch, asked)
    if turn is not None:
        across = np.eye(3) - now.axis[..., :, None] * now.axis[..., None, :]
        rows = np.concatenate([rows, weight * (across @ now.angular).reshape(*batch, asked, n)], axis=-2)
        wanted = np.concatenate([wanted, weight * turn.reshape(*batch, asked)], axis=-1)
    given = np.zeros((*batch, n)) if base_rate is None else (back @ base_rate[..., None])[..., 0]
    if posture is not None:
        given = given + (null @ posture[..., None])[..., 0]
    rest = wanted - (rows @ given[..., None])[..., 0]
    free = rows @ null
    inner = free @ free.swapaxes(-1, -2) + damping**2 * np.eye(rows.shape[-2])
    return given + (free.swapaxes(-1, -2) @ np.linalg.solve(inner, rest[..., None]))[..., 0]


def reactionless_projection(
    turning: Array,
    rate: Array,
    base_rate: Array | None = None,
    free: Array | None = None,
    regularisation: float = _TINY,
) -> Array:
    """Joint rates (..., n) nearest to others with which the base rotates at `base_rate` (..., w).

    Args:
        turning: (..., w, n), angular velocity of the base per joint rate; w is 3, or 1 in the plane.
        rate: (..., n) rad/s. base_rate: rad/s, in the axes of `turning`; None is zero.
        free: (..., n), 1 for the joints that may change and 0 for the others; None lets all change.
        regularisation: added to W W'.
    """
    missing = -(turning @ rate[..., None])[..., 0]
    if base_rate is not None:
        missing = base_rate + missing
    through = turning if free is None else turning * free[..., None, :]
    square = through @ turning.swapaxes(-1, -2) + regularisation * np.eye(turning.shape[-2])
    return rate + (through.swapaxes(-1, -2) @ np.linalg.solve(square, missing[..., None]))[..., 0]


def axis_turn(axis: Array, wanted: Array) -> Array:
    """Rotation vectors (..., 3), rad, that rotate unit vectors (..., 3) onto others by the smaller angle."""
    normal = cross(axis, wanted)
    sine = np.sqrt((normal * normal).sum(axis=-1, keepdims=True))
    cosine = (axis * wanted).sum(axis=-1, keepdims=True)
    opposite = (sine < 1e-9) & (cosine < 0.0)
    if opposite.any():
        # Any perpendicular will do.
        least = np.eye(3)[np.abs(axis).argmin(axis=-1)]
        other = cross(axis, least)
        other = other / np.sqrt((other * other).sum(axis=-1, keepdims=True))
        normal, sine = np.where(opposite, 1e-9 * other, normal), np.where(opposite, 1e-9, sine)
    return normal * (np.arctan2(sine, cosine) / np.maximum(sine, 1e-300))


class Reached(NamedTuple):
    """End of a roll-out: q (K, n) rad, and residual distance, m, and angle of the approach axes, rad (K,)."""

    q: Array
    distance: Array
    angle: Array


def reach(robot: FloatingRobot, start: Array, position: Array, axis: Array | None = None) -> Reached:
    """Roll out a reactionless motion that takes the end-effectors to points at rest.

    The base keeps its attitude and starts at the origin; steps are of second order, so the motion that is
    approximated is reactionless all along. A goal that it reaches can be reached.

    Args:
        start: (K, n) rad. position: (K, k, 3) m, inertial frame. axis: (K, k, 3) approach axes, or None.
    """
    q = np.array(start, dtype=np.float64)
    origin = robot.centre_of_mass(robot.kinematics(q))
    turn = None
    for _ in range(_STEPS):
        now, left, turn = _residual(robot, q, origin, position, axis)
        change = reactionless_rates(now, 0.3 * left, None if turn is None else 0.3 * turn)
        change *= np.minimum(_LARGEST_STEP / np.maximum(np.abs(change).max(axis=-1), 1e-12), 1.0)[:, None]
        # The step is projected at its middle.
        q = q + reactionless_projection(robot.base_map(q + 0.5 * change)[..., 3:, :], change)
    _, left, turn = _residual(robot, q, origin, position, axis)
    distance = np.sqrt((left * left).sum(axis=-1)).max(axis=-1)
    angle = np.zeros(len(q)) if turn is None else np.sqrt((turn * turn).sum(axis=-1)).max(axis=-1)
    return Reached(q, distance, angle)


def _residual(
    robot: FloatingRobot, q: Array, origin: Array, position: Array, axis: Array | None
) -> tuple[EndEffectors, Array, Array | None]:
    kinematics = robot.kinematics(q)
    now = end_effectors(robot, q, kinematics)
    # The common centre of mass stays, so the base moves against what it does in the base frame.
    base = (origin - robot.centre_of_mass(kinematics))[:, None]
    return now, position - (now.position + base), None if axis is None else axis_turn(now.axis, axis)
