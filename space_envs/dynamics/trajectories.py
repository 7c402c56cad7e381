"""Base motion along a joint trajectory: twist, pose and base disturbance (eq. 20 of shyam2020)."""

import numpy as np

from space_envs.dynamics.compiled import base_twist
from space_envs.dynamics.floating import FloatingRobot
from space_envs.dynamics.rotations import Array, cross, exponential, multiply, rotate
from space_envs.errors import ConfigurationError


def attitude_cost(twist: Array, dt: float, c: float = 1.0) -> Array:
    """Cost (...,) of eq. 20 of shyam2020 times dt: the sum of (c^2 w.w + v.v) dt over time.

    Args:
        twist: (..., T, 6) base twists [v; w] in any axes, m/s and rad/s.
        dt: sampling period, s.
        c: angular to linear conversion, m/rad.
    """
    v, w = twist[..., :3], twist[..., 3:]
    return dt * np.sum(c**2 * np.sum(w * w, axis=-1) + np.sum(v * v, axis=-1), axis=-1)


def trajectory_cost(robot: FloatingRobot, q: Array, qdot: Array, dt: float, c: float = 1.0) -> Array:
    """Cost (...,) of eq. 20 times dt of joint trajectories at zero momentum; the cost is in m^2/s.

    Args:
        q, qdot: (..., T, n) rad and rad/s at times 0, dt, ..., (T - 1) dt.
        dt: sampling period, s.
        c: angular to linear conversion, m/rad.
    """
    return attitude_cost(base_twist(robot, q, qdot), dt, c)


def roll_out_base(
    robot: FloatingRobot,
    q: Array,
    qdot: Array,
    dt: float,
    position: Array | None = None,
    quaternion: Array | None = None,
    twist: Array | None = None,
) -> tuple[Array, Array]:
    """Base pose along a joint trajectory at zero momentum.

    Second order in dt: the twist is taken as linear between nodes, and the pose is the exponential of its
    integral with the commutator of the Magnus expansion, which is exact for a constant
    twist.

    Args:
        q, qdot: (..., T, n) rad and rad/s at times 0, dt, ..., (T - 1) dt.
        dt: s.
        position, quaternion: (..., 3) m and (..., 4) of the base at time 0, inertial frame; identity if None.
        twist: (..., T, 6) base twists, if the caller has them already.

    Returns:
        Position (..., T, 3) and quaternion (..., T, 4) of the base in the inertial frame.
    """
    q, qdot = np.asarray(q, dtype=np.float64), np.asarray(qdot, dtype=np.float64)
    if q.shape != qdot.shape or q.ndim < 2 or q.shape[-1] != robot.n_joints:
        raise ConfigurationError(
            f"q and qdot must both have shape (..., T, {robot.n_joints}), got {q.shape} and {qdot.shape}"
        )
    batch = q.shape[:-2]
    start_position = np.broadcast_to(np.zeros(3) if position is None else position, (*batch, 3))
    start_quaternion = np.broadcast_to(
        [1.0, 0.0, 0.0, 0.0] if quaternion is None else quaternion, (*batch, 4)
    )
    twist = base_twist(robot, q, qdot) if twist is None else twist
    step_position, step_quaternion = _exponential_se3(_magnus(twist[..., :-1, :], twist[..., 1:, :], dt))
    # The pose at node k is the product of the first k steps: a prefix product, in log2(T) rounds.
    quaternions = np.concatenate([start_quaternion[..., None, :], step_quaternion], axis=-2)
    span = 1
    while span < quaternions.shape[-2]:
        product = multiply(quaternions[..., :-span, :], quaternions[..., span:, :])
        quaternions = np.concatenate([quaternions[..., :span, :], product], axis=-2)
        span *= 2
    moved = rotate(quaternions[..., :-1, :], step_position)
    positions = np.concatenate([start_position[..., None, :], moved], axis=-2).cumsum(axis=-2)
    return positions, quaternions


def _magnus(first: Array, second: Array, dt: float) -> Array:
    """Logarithm (..., 6) of the motion over dt whose body twist runs linearly from first to second."""
    v0, w0, v1, w1 = first[..., :3], first[..., 3:], second[..., :3], second[..., 3:]
    commutator = np.concatenate([cross(w0, v1) - cross(w1, v0), cross(w0, w1)], axis=-1)
    return 0.5 * dt * (first + second) + dt**2 / 12.0 * commutator


def _exponential_se3(displacement: Array) -> tuple[Array, Array]:
    """Position (..., 3) and quaternion (..., 4) of the exponential of [v; w] (..., 6)."""
    v, w = displacement[..., :3], displacement[..., 3:]
    angle = np.sqrt(np.sum(w * w, axis=-1, keepdims=True))
    half = np.sinc(angle / (2 * np.pi))
    # (1 - cos) / angle^2 and (angle - sin) / angle^3, the latter by its series near zero.
    first = 0.5 * half**2
    small = angle < 1e-2
    safe = np.where(small, 1.0, angle)
    second = np.where(small, 1.0 / 6.0 - angle**2 / 120.0, (safe - np.sin(safe)) / safe**3)
    rotated = cross(w, v)
    return v + first * rotated + second * cross(w, rotated), exponential(w)


def minimum_jerk(start: Array, end: Array, duration: float, nodes: int) -> tuple[Array, Array, float]:
    """Rest-to-rest joint motion of least integrated squared jerk (the 3-4-5 polynomial).

    Args:
        start, end: (..., n) rad. duration: s. nodes: number of sampling times T, at least 2.

    Returns:
        q, qdot (..., T, n) and the sampling period, s.
    """
    s = np.linspace(0.0, 1.0, nodes)[:, None]
    start, end = np.asarray(start)[..., None, :], np.asarray(end)[..., None, :]
    shape = s**3 * (10.0 + s * (6.0 * s - 15.0))
    slope = 30.0 * s**2 * (1.0 - s) ** 2 / duration
    return start + shape * (end - start), slope * (end - start), duration / (nodes - 1)
