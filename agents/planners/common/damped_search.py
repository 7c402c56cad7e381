"""Levenberg-Marquardt search for joint angles with given end-effector poses, batched."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array

Rows = NDArray[np.int64]

POSITION_TOLERANCE = 2e-5  # m
ORIENTATION_TOLERANCE = 2e-5  # rad
SETTLED = 2e-3  # rad, largest step along the redundancy at which it counts as settled
ITERATIONS = 40
DAMPING = 1e-8  # least damping of the normal equations, in squared units of the Jacobian
# Fraction of the remaining displacement to the preferred configuration that a step covers in the null space
# of the pose. Where the two conflict for long, the fraction decays and the pose has priority.
BIAS_RATE = 0.7
PATIENCE = 12  # iterations before the fraction decays
DECAY = 0.75  # factor on the fraction per iteration
LARGEST_STEP = 0.5  # rad per joint
# Further starts for rows that fail from the first one: offsets in rad, uniform, from a fixed seed.
RETRIES = 6
RETRY_RADIUS = 0.9


@dataclass(frozen=True, eq=False)
class JointGoals:
    """Joint goals of inverse kinematics, row by row; the best iterate where a row did not converge.

    Attributes:
        position: (N, n) rad.
        converged: (N,) whether both residuals are within tolerance.
        position_residual: (N,) m. orientation_residual: (N,) rad.
    """

    position: Array
    converged: NDArray[np.bool_]
    position_residual: Array
    orientation_residual: Array

    def take(self, rows: NDArray[Any]) -> "JointGoals":
        """Return the goals of some rows, by number or mask."""
        return JointGoals(**{name: value[rows] for name, value in vars(self).items()})

    def rejected(self, rows: Rows, rest: Array) -> "JointGoals":
        """Return a copy with rows (k,) not converged and their goals replaced by angles `rest` (k, n) rad."""
        position, converged = self.position.copy(), self.converged.copy()
        position[rows], converged[rows] = rest, False
        return replace(self, position=position, converged=converged)


Error = Callable[[Array, Rows], Array]  # angles (k, n) of rows (k,) -> pose errors (k, 6), base axes


def search(
    error: Error,
    jacobian: Callable[[Array], Array],
    start: Array,
    limits: Array,
    preferred: Array,
) -> JointGoals:
    """Joint angles without pose error, by Levenberg-Marquardt from `start`, then from random starts.

    Args:
        jacobian: of the end-effector, (k, n) -> (k, 6, n). start, preferred: (N, n) rad. limits: (n, 2) rad.
    """
    rows = np.arange(len(start))
    q, residual = _descend(error, jacobian, start, limits, preferred, rows)
    failed = rows[~_within(residual)]
    if failed.size:
        offsets = np.random.default_rng(0).uniform(-RETRY_RADIUS, RETRY_RADIUS, (RETRIES, start.shape[1]))
        again = np.repeat(failed, RETRIES)
        others = (start[failed, None] + offsets).reshape(-1, start.shape[1])
        others, remaining = _descend(error, jacobian, others, limits, preferred[again], again)
        # Of the starts that reach the pose, take the one that ends nearest to the preferred configuration.
        distance = np.linalg.norm(others - preferred[again], axis=1)
        score = np.where(_within(remaining), distance, 1e3 + remaining.sum(axis=1)).reshape(-1, RETRIES)
        best = np.arange(failed.size) * RETRIES + score.argmin(axis=1)
        better = remaining[best].sum(axis=1) < residual[failed].sum(axis=1)
        q[failed[better]], residual[failed[better]] = others[best[better]], remaining[best[better]]
    return JointGoals(q, _within(residual), residual[:, 0], residual[:, 1])


def _within(residual: Array) -> NDArray[np.bool_]:
    return (residual[:, 0] < POSITION_TOLERANCE) & (residual[:, 1] < ORIENTATION_TOLERANCE)


def _descend(
    error: Error,
    jacobian: Callable[[Array], Array],
    start: Array,
    limits: Array,
    preferred: Array,
    rows: Rows,
) -> tuple[Array, Array]:
    """Best angles (k, n) and residuals (k, 2) m and rad, from starts (k, n) of the tasks `rows` (k,).

    The result of a row does not depend on the rows next to it.
    """
    q = np.clip(start, limits[:, 0], limits[:, 1])
    best, best_residual = q.copy(), np.full((len(q), 2), np.inf)
    active, step = np.arange(len(q)), np.full_like(q, np.inf)
    for iteration in range(ITERATIONS):
        pose_errors = error(q[active], rows[active])
        square = pose_errors * pose_errors
        residual = np.sqrt(np.stack([square[:, :3].sum(axis=1), square[:, 3:].sum(axis=1)], axis=1))
        within = _within(residual)
        # Within the tolerance later steps only settle the redundancy.
        better = within | (residual.sum(axis=1) < best_residual[active].sum(axis=1))
        best[active[better]], best_residual[active[better]] = q[active[better]], residual[better]
        done = within & (np.abs(step[active]).max(axis=1) < SETTLED)
        active, pose_errors = active[~done], pose_errors[~done]
        if active.size == 0:
            break
        preferred_step = BIAS_RATE * DECAY ** max(0, iteration - PATIENCE) * (preferred[active] - q[active])
        step[active] = _step(jacobian(q[active]), pose_errors, preferred_step, q[active], limits)
        q[active] = np.clip(q[active] + step[active], limits[:, 0], limits[:, 1])
    return best, best_residual


def _step(jacobian: Array, error: Array, preferred_step: Array, q: Array, limits: Array) -> Array:
    """Damped step (k, n) from q that removes the error (k, 6), with the preferred null-space part."""
    step = _damped(jacobian, error, preferred_step)
    # Joints that would leave their range are fixed, and the others compensate.
    stuck = ((q <= limits[:, 0]) & (step < 0.0)) | ((q >= limits[:, 1]) & (step > 0.0))
    if stuck.any():
        again = stuck.any(axis=1)
        free = ~stuck[again]
        step[again] = _damped(jacobian[again] * free[:, None, :], error[again], preferred_step[again] * free)
    return step / np.maximum(np.abs(step).max(axis=1, keepdims=True) / LARGEST_STEP, 1.0)


def _damped(jacobian: Array, error: Array, preferred_step: Array) -> Array:
    """Minimum of |step - preferred_step|^2 + |J step - error|^2 / damping.

    The damping grows with the squared error (Sugihara 2011): near the solution the step is Newton's.
    """
    transpose = jacobian.swapaxes(1, 2)
    damping = DAMPING + 0.02 * (error * error).sum(axis=1)
    square = jacobian @ transpose + damping[:, None, None] * np.eye(6)
    missing = error - (jacobian @ preferred_step[..., None])[..., 0]
    return preferred_step + (transpose @ np.linalg.solve(square, missing[..., None]))[..., 0]
