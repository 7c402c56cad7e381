"""Splines of the collocation program: their mesh, and what follows from it alone."""

import numpy as np
from scipy.interpolate import BSpline

from agents.planners.common.splines import DEGREE, Mesh
from agents.planners.single_arm.collocation.interval import GAUSS, ORDER
from space_envs.dynamics.rotations import Array

INTERVALS = 20  # of the splines: 0.5 s each where a motion takes 10 s
MESH = Mesh.graded(INTERVALS, 1.0, 0)


def sample_times() -> Array:
    """Values (2 N + 1,) of s at which torques are bounded: breaks and middles of the MESH."""
    return np.sort(np.concatenate([MESH.breaks, MESH.middles]))


def at_gauss_points() -> tuple[Array, Array]:
    """Values and slopes (ORDER, N GAUSS) of the splines that are nonzero on each interval."""
    points, _ = np.polynomial.legendre.leggauss(GAUSS)
    nodes = MESH.middles[:, None] + 0.5 * np.diff(MESH.breaks)[:, None] * points
    found = []
    for derivative in (0, 1):
        basis = MESH.basis(nodes.ravel(), derivative).reshape(*nodes.shape, MESH.size)
        found.append(np.concatenate([basis[k, :, k : k + ORDER].T for k in range(len(nodes))], axis=1))
    return found[0], found[1]


def curvature() -> Array:
    """Quadratic form (size, size) whose half is the integral over s of the squared second derivative."""
    lengths = np.diff(MESH.breaks)
    spline = BSpline(MESH.knots, np.eye(MESH.size), DEGREE).derivative(2)
    points, weights = np.polynomial.legendre.leggauss(2)  # exact: the square is of second degree
    total = np.zeros((MESH.size, MESH.size))
    for point, share in zip(points, weights, strict=True):
        basis = np.asarray(spline(MESH.middles + 0.5 * lengths * point))
        total += basis.T @ ((share * lengths)[:, None] * basis)
    return total
