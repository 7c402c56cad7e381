"""Joint rates along prescribed paths: constraints of shah2013, and choices in their null space.

The joint rates solve [J_lin; Ibm~] thetadot = [v; 0] (eq. 4 and 5). The motion in the null space, zeta of
eq. 9, is free: `zeta_zero` makes the dependent angular velocities smallest (coordinate partitioning with the
pseudo-inverse, zeta = 0), `least_energy` the kinetic energy (eq. 12 to 14, in closed form). J_g is never
inverted, so that only true singularities matter.
"""

from collections.abc import Callable

import numpy as np
from scipy.linalg import get_lapack_funcs

from agents.planners.common.plans import Cause, Failure
from agents.planners.dual_arm.prescribed_paths.model import Matrices
from space_envs.dynamics.rotations import Array

METHOD = "null space"
SMALLEST = 1e-4  # m or 1, independent part of a constraint below which a configuration is singular

Choice = Callable[[Matrices, Array, Array], Array | Failure]
"""Coordinates (m,) in the null space, from the matrices, a particular solution (n,) and a basis (n, m)."""
# LAPACK itself: `solutions` is called some thousand times per plan, and numpy's overhead exceeds the work.
_geqrf, _orgqr, _trtrs = get_lapack_funcs(("geqrf", "orgqr", "trtrs"), dtype=np.float64)


def solutions(at: Matrices, velocity: Array) -> tuple[Array, Array] | Failure:
    """Reactionless joint rates (n,) for end-effector velocities (2 d,), and a null-space basis (n, m)."""
    rows, n = at.task.shape
    square = np.zeros((n, n), order="F")
    factors, tau, _, _ = _geqrf(at.task.T)
    if np.abs(np.diagonal(factors)).min() < SMALLEST:
        return _singular("the end-effector velocities and the reactionless constraint depend on each other")
    square[:, :rows] = factors
    q, _, _ = _orgqr(square, tau, overwrite_a=True)
    velocities = np.zeros(rows)
    velocities[: len(velocity)] = velocity
    along, _ = _trtrs(factors[:rows], velocities, trans=1)
    return q[:, :rows] @ along, q[:, rows:]


def zeta_zero(at: Matrices, particular: Array, null: Array) -> Array | Failure:
    """Null-space coordinates (m,) with the smallest dependent angular velocities (zeta = 0)."""
    angular = at.angular @ null
    square = angular.T @ angular
    if square.trace() < SMALLEST**2:
        return _singular("the dependent angular velocities do not tell the motions of the null space apart")
    if angular.shape[1] > angular.shape[0]:  # many motions have these angular velocities: the slowest joints
        return -np.linalg.pinv(angular) @ (at.angular @ particular)
    return _solved(square, angular.T @ (at.angular @ particular))


def least_energy(at: Matrices, particular: Array, null: Array) -> Array | Failure:
    """Null-space coordinates (m,) with the least thetadot' I_m thetadot."""
    return _solved(null.T @ at.mass @ null, null.T @ at.mass @ particular)


def _solved(square: Array, right: Array) -> Array | Failure:
    try:
        return -np.linalg.solve(square, right)
    except np.linalg.LinAlgError as error:
        return _singular(str(error))


def _singular(reason: str) -> Failure:
    return Failure(METHOD, Cause.SINGULAR, reason)
