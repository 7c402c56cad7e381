"""Damped Newton iterations for final configurations, batched."""

from collections.abc import Callable

import numpy as np

from space_envs.dynamics.rotations import Array


def damped_newton(
    error: Callable[[Array], Array],
    jacobian: Callable[[Array], Array],
    q: Array,
    limits: Array,
    *,
    iterations: int,
    largest_step: float,
    damping: tuple[float, float],
) -> tuple[Array, Array]:
    """Joint angles (S, n) after damped Newton iterations from q (S, n), and their largest errors (S,).

    Args:
        error: of angles (S, n), (S, k). jacobian: of angles, (S, k, n). limits: (n, 2) rad.
        largest_step: rad, of a joint. damping: least and largest; in between it is the largest error.
    """
    low, high = limits.T
    for _ in range(iterations):
        now, slope = error(q), jacobian(q)
        unit = np.eye(now.shape[1])
        share = np.clip(np.abs(now).max(axis=1), *damping)[:, None, None]
        inner = np.linalg.solve(slope @ slope.swapaxes(1, 2) + share * unit, now[..., None])
        step = (slope.swapaxes(1, 2) @ inner)[..., 0]
        step *= np.minimum(largest_step / np.maximum(np.abs(step).max(axis=1), 1e-300), 1.0)[:, None]
        q = np.clip(q + step, low, high)
    return q, np.abs(error(q)).max(axis=1)
