"""A rigid body that rotates freely: the tumbling of a target, forwards and backwards in time."""

import numpy as np

from space_envs.dynamics.rotations import Array, conjugate, cross, multiply, rotate

_STEP = 0.1  # s, largest step of the integration; a target rotates by less than 0.02 rad in it


def tumble(
    quaternion: Array, angular_velocity: Array, inertia: Array, times: Array, step: float = _STEP
) -> tuple[Array, Array]:
    """Attitude and angular velocity of torque-free bodies (Euler's equations), by Runge-Kutta of order 4.

    Args:
        quaternion: (..., 4) body to inertial at time 0. angular_velocity: (..., 3) rad/s, inertial axes.
        inertia: (3,) principal moments along the body's axes, kg m^2; only their ratios matter.
        times: (T,) s, monotonic, of any sign; time 0 need not be among them.
        step: s, the largest of the integration.

    Returns:
        Quaternions (..., T, 4) and angular velocities (..., T, 3) in inertial axes.
    """
    inertia = np.asarray(inertia, dtype=np.float64)
    batch = np.broadcast_shapes(quaternion.shape[:-1], angular_velocity.shape[:-1])
    attitude = np.broadcast_to(quaternion, (*batch, 4))
    # Angular momentum is constant in inertial axes, so only the attitude is integrated.
    local = rotate(conjugate(attitude), np.broadcast_to(angular_velocity, (*batch, 3)))
    momentum = rotate(attitude, inertia * local)

    def rate(q: Array) -> Array:
        spin = rotate(conjugate(q), momentum) / inertia
        return 0.5 * multiply(q, np.concatenate([np.zeros((*batch, 1)), spin], axis=-1))

    quaternions, velocities = np.empty((*batch, len(times), 4)), np.empty((*batch, len(times), 3))
    now = 0.0
    for place, time in enumerate(np.asarray(times, dtype=np.float64)):
        steps = int(np.ceil(abs(time - now) / step - 1e-9))
        h = (time - now) / max(steps, 1)
        for _ in range(steps):
            a = rate(attitude)
            b = rate(attitude + 0.5 * h * a)
            c = rate(attitude + 0.5 * h * b)
            d = rate(attitude + h * c)
            attitude = attitude + h / 6.0 * (a + 2.0 * b + 2.0 * c + d)
            attitude = attitude / np.sqrt((attitude * attitude).sum(axis=-1, keepdims=True))
        now = time
        quaternions[..., place, :] = attitude
        spin = rotate(conjugate(attitude), momentum) / inertia
        velocities[..., place, :] = rotate(attitude, spin)
    return quaternions, velocities


def point_motion(
    centre: Array, quaternion: Array, angular_velocity: Array, point: Array
) -> tuple[Array, Array]:
    """Position and velocity (..., 3) of a body's point in the inertial frame, its centre at rest.

    Args:
        centre: (..., 3) m. quaternion: (..., 4). angular_velocity: (..., 3) rad/s, inertial axes.
        point: (..., 3) m, in the body's frame.
    """
    arm = rotate(quaternion, point)
    return centre + arm, cross(angular_velocity, arm)
