"""From demonstrations to weights: ridge regression (shyam2020, eq. 16), all demonstrations at once."""

import numpy as np
from numpy.typing import ArrayLike

from promp.basis import GaussianBasis
from promp.checks import Array, finite_array, flag, number, phase_array
from promp.errors import PrompError

DEFAULT_RIDGE = 1e-6


def regress_weights(
    positions: ArrayLike,
    velocities: ArrayLike | None = None,
    *,
    basis: GaussianBasis,
    phase: ArrayLike | None = None,
    duration: float | None = None,
    ridge: float = DEFAULT_RIDGE,
    exact_ends: bool = False,
) -> Array:
    """Weights (D, n, nb) of D demonstrations: w_i = (Psi' Psi + ridge I)^-1 Psi' X_i (eq. 16).

    The regression falls apart into one problem for each DoF, all with the same matrix, which is factored
    once.

    Args:
        positions: (D, T, n) rad.
        velocities: (D, T, n) rad/s or None. If given they are fitted together with the positions, with equal
            weight on rad and rad/s; `duration` is then needed.
        phase: (T,) in [0, 1], shared by the demonstrations; default evenly spaced from 0 to 1.
        duration: s, shared by the demonstrations. For demonstrations of different lengths give velocities
            times each one's duration, and duration 1.
        ridge: lambda >= 0. 1e-6 changes the fit of a unit motion by less than 1e-6 with the paper's basis.
        exact_ends: let the first and last sample (positions, and velocities if given) be met exactly and the
            ones between in the least-squares sense. A start that the demonstrations share is then shared by
            the weights too, to rounding; without it every demonstration keeps its own fitting error there.

    Raises:
        PrompError: wrong shapes, NaN, or too few samples for the basis while ridge is 0.
    """
    positions = finite_array("positions", positions, (None, None, None))
    demonstrations, samples, dofs = positions.shape
    if min(positions.shape) == 0:
        raise PrompError(
            f"positions: expected at least one demonstration, sample and DoF, got shape {positions.shape}"
        )
    phase = np.linspace(0.0, 1.0, samples) if phase is None else phase_array(phase, (samples,))
    ridge = number("ridge", ridge, 0.0)
    flag("exact_ends", exact_ends)
    features, observed, ends = basis.value(phase), _columns(positions), [0, samples - 1]
    if velocities is not None:
        if duration is None:
            raise PrompError("duration: expected the seconds the velocities refer to, got None")
        duration = number("duration", duration, 0.0, strict=True)
        velocities = finite_array("velocities", velocities, positions.shape)
        features = np.vstack([features, basis.derivative(phase) / duration])
        observed = np.vstack([observed, _columns(velocities)])
        ends += [samples, 2 * samples - 1]
    flat = _regress(features, observed, ridge, ends if exact_ends else [])
    return np.ascontiguousarray(flat.reshape(basis.size, demonstrations, dofs).transpose(1, 2, 0))


def _columns(values: Array) -> Array:
    """Samples (D, T, n) as rows of one problem for each demonstration and DoF: (T, D n)."""
    return values.transpose(1, 0, 2).reshape(values.shape[1], -1)


def _regress(features: Array, observed: Array, ridge: float, exact: list[int]) -> Array:
    """Weights (nb, D n) of observations (R, D n) by features (R, nb); the rows `exact` are met exactly."""
    rows, size = features.shape
    # The ridge as rows of its own: singular**2 and `right` are then the eigen-decomposition of Psi' Psi +
    # ridge I.
    left, singular, right = np.linalg.svd(
        np.vstack([features, np.sqrt(ridge) * np.eye(size)]), full_matrices=False
    )
    if singular[-1] ** 2 <= np.finfo(float).eps * singular[0] ** 2:
        raise PrompError(
            f"positions: {rows} values at these phases do not determine {size} weights; "
            "expected more samples, or a ridge above 0"
        )
    flat = right.T @ ((left[:rows].T @ observed) / singular[:, None])
    if exact:
        flat += _meet_exactly(features[exact], observed[exact] - features[exact] @ flat, right, singular)
    return flat


def _meet_exactly(constraints: Array, residual: Array, right: Array, singular: Array) -> Array:
    """Least correction (nb, K) of the fit that makes constraints (m, nb) @ weights exact."""
    whiten = right.T / singular
    correction = whiten @ (np.linalg.pinv(constraints @ whiten) @ residual)
    remaining = float(np.abs(residual - constraints @ correction).max())
    if remaining > 1e-9 * max(1.0, float(np.abs(residual).max())):
        raise PrompError(
            f"exact_ends: expected a basis that can meet {constraints.shape[0]} end values, "
            f"got {constraints.shape[1]} functions with a residual of {remaining:.3g}"
        )
    return correction
