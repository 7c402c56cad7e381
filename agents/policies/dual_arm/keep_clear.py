"""Joint rates that keep two arms clear of the satellite, of the target and of each other, by feedback."""

import numpy as np

from agents.policies.dual_arm.observed import Reader
from space_envs.dynamics.reactionless import reactionless_projection
from space_envs.dynamics.rotations import Array, conjugate, exponential, multiply, rotate
from space_envs.tasks.contacts import Contacts

CLOSING = 0.5  # 1/s, speed at which a gap may close for each metre of it
MARGIN = 0.02  # m, least gap, except between grippers and target, which have to meet
DAMPING = 0.1  # m/rad, of the correction where a gap hardly depends on the joints
NEAR = 0.6  # m; wider gaps are ignored, since nothing closes them fast enough
_SWEEPS = 4  # corrections, each for the gap that violates its bound most
_STEP = 1e-6  # rad and s, of difference quotients


def clear_rates(reader: Reader, observation: Array, q: Array, rate: Array) -> Array:
    """Joint rates (N, n) rad/s near `rate` with which no gap g closes faster than CLOSING (g - MARGIN).

    Where one would, the rates are changed along its gradient, projected so that the angular velocity of the
    base stays that of `rate`. Nothing is changed where the environment checks no collisions.

    Args:
        observation: (N, size). q: (N, n) rad, joint angles at which the rates are evaluated.
        rate: (N, n) rad/s.
    """
    contacts = reader.context.contacts
    if contacts is None:
        return rate
    twist = reader.context.arm.base_map(q)
    gap, slope, drift = _gaps(reader, contacts, observation, q, twist[:, :3])
    margin = np.where(np.isin(np.arange(gap.shape[1]), contacts.grips), 0.0, MARGIN)
    least = -CLOSING * (gap - margin) - drift
    rows = np.arange(len(q))
    for _ in range(_SWEEPS):
        excess = least - (slope * rate[:, None]).sum(axis=-1)
        worst = excess.argmax(axis=1)
        along = slope[rows, worst]
        direction = reactionless_projection(twist[:, 3:], along)
        share = np.maximum(excess[rows, worst], 0.0) / ((along * direction).sum(axis=1) + DAMPING**2)
        rate = rate + share[:, None] * direction
    return rate


def _gaps(
    reader: Reader, contacts: Contacts, observation: Array, q: Array, carried: Array
) -> tuple[Array, Array, Array]:
    """Gaps to close obstacles, and their rates of change.

    Returns:
        Gaps (N, M) m, their gradients (N, M, n) m/rad while the base keeps its attitude, and the rates (N, M)
        m/s at which they change because the target rotates.

    Args:
        q: (N, n) rad. carried: (N, 3, n) m/rad, translation of the base with the joints.
    """
    n, joints = q.shape
    moved = np.concatenate([np.zeros((1, joints)), _STEP * np.eye(joints), np.zeros((1, joints))])
    points = contacts.points(reader.context.arm, q[:, None] + moved)  # (N, joints + 2, P, 3)
    to_base, target = (
        conjugate(reader.quaternion(observation, "base")),
        reader.quaternion(observation, "target"),
    )
    middle = reader.vector(observation, "target_position")
    centre = rotate(to_base, middle - reader.vector(observation, "base_position"))
    spin = np.zeros((n, joints + 2, 3))
    spin[:, -1] = _STEP * reader.vector(observation, "target_angular_velocity")
    attitude = multiply(to_base[:, None], multiply(exponential(spin), target[:, None]))
    shift = moved @ carried.swapaxes(-1, -2) - centre[:, None]
    local = rotate(conjugate(attitude)[:, :, None], points + shift[:, :, None])
    grapple = rotate(conjugate(target), reader.vectors(observation, "goal_position")[:, 0] - middle)
    half = np.abs(grapple).max(axis=1, keepdims=True) * contacts.target_shape
    gap = contacts.all_gaps(points[:, 0], local[:, 0], half)
    row, pair = np.nonzero(gap < NEAR)
    varied = contacts.chosen_gaps(pair, points[row], local[row], half[row])
    change = np.zeros((*gap.shape, joints + 1))
    change[row, pair] = (varied[:, 1:] - varied[:, :1]) / _STEP
    return gap, change[..., :-1], change[..., -1]
