"""Joint rates that keep the arms clear of the satellite, of the target and of each other, reactively."""

import numpy as np

from agents.dual_arm import Reader
from space_envs.dynamics.reactionless import keep_attitude
from space_envs.dynamics.rotations import Array, conjugate, exponential, multiply, rotate

CLOSING = 0.5  # 1/s, most that a gap may close in a second for each metre beyond the margin
MARGIN = 0.04  # m, of gaps but the gripper's to the target, which is to be reached
DAMPING = 0.1  # m/rad, where the joints have little say over a gap
SWEEPS = 4
_STEP = 1e-6  # rad and s, of difference quotients
_FAR = 1e3  # m, instead of the infinite gaps of links that do not count


def clear_rates(reader: Reader, observation: Array, rate: Array) -> Array:
    """Joint rates (N, n), rad/s, as near to `rate` as can be with which no gap closes too fast.

    A gap g of two bodies may change at no less than -CLOSING (g - margin). The gap that is most in excess is
    corrected along its gradient, projected to where it turns the base no more than `rate` did; then the next.

    Args:
        observation: (N, size). rate: (N, n) rad/s, for the end of the control period.
    """
    context = reader.context
    contacts, period = context.contacts, context.control_period
    if contacts is None:
        return rate
    q = reader.field(observation, "joint_position") + period * reader.field(observation, "joint_velocity")
    gap, slope, drift = _gaps(reader, observation, q)
    turning = context.arm.base_map(q)[:, 3:]
    margin = np.full(gap.shape[1], MARGIN)
    margin[contacts.grips] = 0.0
    least = -CLOSING * (gap - margin) - drift
    rows = np.arange(len(q))
    for _ in range(SWEEPS):
        excess = least - (slope * rate[:, None]).sum(axis=-1)
        worst = excess.argmax(axis=1)
        along = slope[rows, worst]
        way = keep_attitude(turning, along)
        size = (along * way).sum(axis=1) + DAMPING**2
        rate = rate + (np.maximum(excess[rows, worst], 0.0) / size)[:, None] * way
    return rate


def _gaps(reader: Reader, observation: Array, q: Array) -> tuple[Array, Array, Array]:
    """Gaps (N, M) m, their gradients (N, M, n) m/rad while the base keeps its attitude, and what the target's
    turning alone does to them, (N, M) m/s; for joint angles q (N, n)."""
    contacts, arm = reader.context.contacts, reader.context.arm
    n, joints = q.shape
    moved = np.concatenate([np.zeros((1, joints)), _STEP * np.eye(joints), np.zeros((1, joints))])
    points = contacts.points(arm, q[:, None] + moved)
    shift = moved @ arm.base_map(q)[:, :3].swapaxes(-1, -2)  # of the base, (N, joints + 2, 3)
    back, target = conjugate(reader.quaternion(observation, "base")), reader.quaternion(observation, "target")
    middle = reader.vector(observation, "target_position")
    centre = rotate(back, middle - reader.vector(observation, "base_position"))
    spin = np.zeros((n, joints + 2, 3))
    spin[:, -1] = _STEP * reader.vector(observation, "target_angular_velocity")
    attitude = multiply(back[:, None], multiply(exponential(spin), target[:, None]))
    local = points + (shift - centre[:, None])[:, :, None, None]
    local = rotate(conjugate(attitude)[:, :, None, None], local)
    grapple = rotate(conjugate(target), reader.vectors(observation, "goal_position")[:, 0] - middle)
    half = np.abs(grapple).max(axis=1, keepdims=True) * contacts.shape.body
    flat = (-1, *points.shape[2:])
    every = contacts.all_gaps(points.reshape(flat), local.reshape(flat), half.repeat(joints + 2, axis=0))
    every = np.minimum(every, _FAR).reshape(n, joints + 2, -1)
    change = (every[:, 1:] - every[:, :1]) / _STEP
    return every[:, 0], change[:, :-1].swapaxes(-1, -2), change[:, -1]
