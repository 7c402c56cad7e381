"""Masses and inertias with random errors, physically consistent by construction.

A rigid body is consistent if its pseudo-inertia matrix is positive definite: positive mass, and positive
second moments of mass about the principal axes through its centre of mass (P. M. Wensing, S. Kim and J.-J. E.
Slotine, "Linear matrix inequalities for physically-consistent inertial parameter identification", 2018). So
masses and second moments are multiplied by positive factors, and the moments of inertia, which are sums of
two second moments each, satisfy the triangle inequality. Centres of mass and principal axes are nominal.
"""

import numpy as np

from space_envs.dynamics.rotations import Array


def second_moments(inertia: Array) -> Array:
    """Second moments of mass (..., 3) along the principal axes, from principal moments of inertia (..., 3).

    kg m^2. The one along an axis is half the sum of all moments of inertia less the one about it.
    """
    return np.maximum(0.5 * inertia.sum(axis=-1, keepdims=True) - inertia, 0.0)


def moments_of_inertia(second: Array) -> Array:
    """Principal moments of inertia (..., 3) from second moments of mass (..., 3), kg m^2."""
    return second.sum(axis=-1, keepdims=True) - second


def perturbed_moments(inertia: Array, error: Array) -> Array:
    """Principal moments of inertia (..., 3) with relative errors (..., 3), above -1, of the second moments.

    Args:
        inertia: (..., 3) nominal principal moments of inertia, kg m^2.
    """
    return moments_of_inertia(second_moments(inertia) * (1.0 + error))
