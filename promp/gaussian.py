"""Gaussians whose covariance may be singular: factor, conditioning, density.

Demonstrations share their start and end at rest, so the weights live on a lower-dimensional affine subspace.
Nothing here inverts a covariance: the Gaussian is written as mean + directions @ latent, with latent ~ N(0,
I), and only the latent variables that exist are touched.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from promp.checks import Array, finite_array, number
from promp.errors import ConditioningError, PrompError

# Eigenvalues below this fraction of the largest are rounding (a standard deviation a millionth of the
# largest) and count as zero. Through a covariance, which holds squares, nothing finer than sqrt(machine
# epsilon) can be distinguished.
EIGENVALUE_FLOOR = 1e-12

# Negative eigenvalues down to this fraction of the largest are rounding; below, the matrix is no covariance.
NEGATIVE_EIGENVALUE_LIMIT = 1e-9

# A conditioned quantity could have a standard deviation of |feature| times the largest one. With less than
# this fraction of that it is fixed.
FIXED_FRACTION = 1e-7

# In the same measure, a noise below this fraction is none: what rounding leaves of a fixed quantity, divided
# by the square of a smaller noise, would be read as a motion.
NOISE_FLOOR = 1e-6

# A target that needs the distribution to be off its mean by more standard deviations than this contradicts
# it: following it would bend the rest of the motion by as many.
MOST_DEVIATIONS = 1e3

# A point belongs to the support if it is within this many of the largest standard deviation: ten times the
# standard deviation at which EIGENVALUE_FLOOR drops a direction, so that the data a Gaussian was fitted to
# lie on its support.
SUPPORT_FRACTION = 1e-5


@dataclass(frozen=True)
class Factor:
    """covariance = axes @ diag(deviations^2) @ axes.T; axes (d, r) orthonormal, deviations (r,) > 0."""

    axes: Array
    deviations: Array

    @property
    def directions(self) -> Array:
        """(d, r): covariance = directions @ directions.T."""
        return self.axes * self.deviations

    @property
    def largest(self) -> float:
        """The largest standard deviation in any direction (0 for a point)."""
        return float(self.deviations.max(initial=0.0))


def factor_covariance(covariance: ArrayLike, name: str = "covariance") -> Factor:
    """Symmetric eigen-factor of a covariance (d, d), without the directions of no variance.

    Raises PrompError if the matrix is not symmetric (1e-8 of its largest entry) or has a clearly negative
    eigenvalue.
    """
    matrix = finite_array(name, covariance, (None, None))
    if matrix.shape[0] != matrix.shape[1]:
        raise PrompError(f"{name}: expected a square matrix, got shape {matrix.shape}")
    asymmetry = float(np.abs(matrix - matrix.T).max(initial=0.0))
    if asymmetry > 1e-8 * np.abs(matrix).max(initial=0.0):
        raise PrompError(
            f"{name}: expected a symmetric matrix, got one that differs from its transpose by {asymmetry:g}"
        )
    eigenvalues, axes = np.linalg.eigh((matrix + matrix.T) / 2)
    largest = float(np.abs(eigenvalues).max(initial=0.0))
    if largest > 0 and eigenvalues[0] < -NEGATIVE_EIGENVALUE_LIMIT * largest:
        raise PrompError(
            f"{name}: expected no negative eigenvalue, got {eigenvalues[0]:g} (largest {largest:g})"
        )
    positive = eigenvalues > EIGENVALUE_FLOOR * largest
    return Factor(axes[:, positive], np.sqrt(eigenvalues[positive]))


def condition_gaussian(
    mean: ArrayLike,
    covariance: ArrayLike | Factor,
    features: ArrayLike,
    target: ArrayLike,
    noise: ArrayLike = 0.0,
    tolerance: float = 1e-6,
) -> tuple[Array, Array]:
    """Condition w ~ N(mean, covariance) on features @ w + e = target, e ~ N(0, noise): eq. 18, 19.

    Args:
        mean: (d,).
        covariance: (d, d), singular or not, or its Factor where that is already at hand.
        features: (m, d), the rows psi_t of eq. 18.
        target: (m,), x*_t.
        noise: Sigma*_x as a covariance (m, m), as variances (m,) or as one variance. Zero, in all or in some
            rows, means exactly.
        tolerance: how far a target may be from a value that the distribution fixes and still agree with it,
            absolute up to a target of 1 and relative above it. The default lets float32 pass for the same.

    Returns:
        Mean (d,) and covariance (d, d), symmetric and positive semi-definite by construction.

    What has variance is met to rounding. What has none (less than 1e-7 of the standard deviation it could
    have) stays as it is: if it agrees with the target within the tolerance or the noise, nothing changes,
    otherwise ConditioningError. That error is also raised for rows that contradict each other and for a
    target more than 1000 standard deviations away. Redundant rows are harmless.
    """
    mean = finite_array("mean", mean, (None,))
    factor = covariance if isinstance(covariance, Factor) else factor_covariance(covariance)
    if factor.axes.shape[0] != mean.size:
        raise PrompError(
            f"covariance: expected {mean.size} rows, as many as the mean has, got {factor.axes.shape[0]}"
        )
    features = finite_array("features", features, (None, mean.size))
    target = finite_array("target", target, (features.shape[0],))
    tolerance = number("tolerance", tolerance, 0.0)

    return _condition(mean, factor, features, target, noise, tolerance)


def _condition(
    mean: Array, factor: Factor, features: Array, target: Array, noise: ArrayLike, tolerance: float
) -> tuple[Array, Array]:
    """Mean (d,) and covariance (d, d), of arguments that are checked."""
    directions = factor.directions
    rank = directions.shape[1]
    innovation = target - features @ mean
    largest = np.linalg.norm(features, axis=1) * factor.largest
    response = features @ directions
    noise_deviation, noise_directions = _factor_noise(noise, largest)
    # The noise joins the latent variables; conditioning is then exact, one decomposition for all.
    scale = np.hypot(largest, noise_deviation)
    scale[scale == 0] = 1.0
    joint = np.hstack([response, noise_directions]) / scale[:, None]
    left, singular, right = np.linalg.svd(joint, full_matrices=True)
    met = int(np.count_nonzero(singular > FIXED_FRACTION))
    latent = right[:met].T @ ((left[:, :met].T @ (innovation / scale)) / singular[:met])
    shift = directions @ latent[:rank]
    residual = innovation - features @ shift - noise_directions @ latent[rank:]
    _check_residual(residual, target, noise_deviation, tolerance)
    _check_distance(latent[:rank], response, innovation, target)
    # right[met:] spans the unconditioned directions; their noise part is integrated out by omitting it.
    free = directions @ right[met:, :rank].T
    return mean + shift, free @ free.T


def _check_residual(residual: Array, target: Array, noise_deviation: Array, tolerance: float) -> None:
    """Refuse residuals (m,) beyond the tolerance and the noise."""
    excess = np.abs(residual) - np.maximum(tolerance * np.maximum(1.0, np.abs(target)), noise_deviation)
    if (excess > 0).any():
        row = int(np.argmax(excess))
        problem = f"has a residual of {residual[row]:.3g}, since there is no variance in its direction"
        raise _conflict(target, residual, row, problem)


def _check_distance(latent: Array, response: Array, innovation: Array, target: Array) -> None:
    """Refuse targets too many standard deviations away, in latent variables (r,)."""
    deviations = float(np.linalg.norm(latent))
    if deviations > MOST_DEVIATIONS:
        prior_deviation = np.linalg.norm(response, axis=1)
        row = int(np.argmax(np.abs(innovation) / np.maximum(prior_deviation, np.finfo(float).tiny)))
        raise _conflict(target, innovation, row, f"lies {deviations:.3g} standard deviations from the mean")


def _conflict(target: Array, residual: Array, row: int, problem: str) -> ConditioningError:
    hint = "state a noise (an accuracy) for it, or a target that agrees with the distribution"
    return ConditioningError(f"row {row}: target {target[row]:.9g} {problem}; {hint}", residual, row)


def _factor_noise(noise: ArrayLike, largest: Array) -> tuple[Array, Array]:
    """Standard deviations (m,) and directions (m, q) of a noise given as covariance or variances."""
    rows = largest.size
    array = finite_array("noise", noise)
    if array.shape not in ((), (rows,), (rows, rows)):
        raise PrompError(f"noise: expected shape (), ({rows},) or ({rows}, {rows}), got {array.shape}")
    matrix = array if array.ndim == 2 else np.diag(np.broadcast_to(array, rows))
    variances = np.diagonal(matrix)
    if (variances < 0).any():
        raise PrompError(f"noise: expected variances of at least 0, got {variances.min():g}")
    deviation = np.sqrt(variances)
    # Factored as a correlation, so that a row of 1e-5 rad stays apart from one of 1 rad/s.
    divisor = np.where(deviation > 0, deviation, 1.0)
    correlation = factor_covariance(matrix / np.outer(divisor, divisor), "noise")
    present = np.where(deviation > NOISE_FLOOR * largest, deviation, 0.0)
    return deviation, present[:, None] * correlation.directions


def log_density(mean: Array, factor: Factor, points: Array) -> Array:
    """Log-density of points (..., d) under N(mean, factor), shape (...).

    The density is with respect to the Lebesgue measure of the support mean + span(axes), of dimension r: for
    a full rank it is the usual one. A point off the support has -inf; it counts as on it within 1e-5 of the
    largest standard deviation (plus 1e-12 of the mean's largest entry or 1, for rounding). For r = 0 the
    result is 0 on the mean, -inf elsewhere.
    """
    offset = points - mean
    latent = offset @ factor.axes
    distance = np.linalg.norm(offset - latent @ factor.axes.T, axis=-1)
    slack = SUPPORT_FRACTION * factor.largest + 1e-12 * max(1.0, float(np.abs(mean).max(initial=0.0)))
    log_volume = np.log(factor.deviations).sum() + 0.5 * factor.deviations.size * np.log(2 * np.pi)
    density = -0.5 * ((latent / factor.deviations) ** 2).sum(axis=-1) - log_volume
    return np.where(distance <= slack, density, -np.inf)
