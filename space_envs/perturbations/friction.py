"""Dry friction of joints, held over a control period as the drives' torques are.

It opposes the motion and at most stops it. Friction that switched within a step of the integrator would cost
momentum, which internal torques cannot change; one that is constant over the period costs none.
"""

import numpy as np

from space_envs.dynamics.rotations import Array

SWEEPS = 10  # over the joints


def dry_friction(inverse: Array, rate: Array, limit: Array, period: float, guess: Array) -> Array:
    """Friction torques (N, n), N m, by projected Gauss-Seidel sweeps.

    A joint that friction can stop by the end of the period ends at rest; another has its whole friction.

    Args:
        inverse: (N, n, n) joint accelerations per joint torque, rad/s^2 per N m.
        rate: (N, n) joint rates at the end of the period without friction, rad/s.
        limit: (N, n) largest friction, N m. period: s. guess: (N, n) torques to start from, N m.
    """
    torque = np.clip(guess, -limit, limit)
    change = period * inverse
    rate = rate + (change @ torque[..., None])[..., 0]
    for _ in range(SWEEPS):
        for joint in range(rate.shape[1]):
            stopping = torque[:, joint] - rate[:, joint] / change[:, joint, joint]
            new = np.clip(stopping, -limit[:, joint], limit[:, joint])
            rate += change[:, :, joint] * (new - torque[:, joint])[:, None]
            torque[:, joint] = new
    return torque
