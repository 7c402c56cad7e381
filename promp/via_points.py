"""Via-points: a position, a velocity or both that a motion shall meet at a phase, with a stated accuracy."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from promp.basis import GaussianBasis
from promp.checks import Array, finite_array, number, phase_array
from promp.errors import PrompError


@dataclass(frozen=True, eq=False)
class ViaPoint:
    """A state x*_t with its accuracy Sigma*_x (shyam2020, eq. 18, 19); start and goal are via-points too.

    Args:
        phase: when, in [0, 1].
        position: (k,) rad, or None to leave it free.
        velocity: (k,) rad/s, or None to leave it free; `duration` is then needed.
        duration: s, of the whole motion.
        accuracy: standard deviation of the position, rad, a number or (k,). 0 means exactly.
        velocity_accuracy: the same for the velocity, rad/s.
        covariance: instead of the two accuracies, the covariance of [position, velocity], of whichever are
            given: (k, k) or (2 k, 2 k).
        dofs: which k of the DoFs, in the order of the values; None for all.

    Values are checked when the via-point meets a ProMP, since only that knows the number of DoFs.
    """

    phase: float
    position: ArrayLike | None = None
    velocity: ArrayLike | None = None
    duration: float | None = None
    accuracy: ArrayLike = 0.0
    velocity_accuracy: ArrayLike = 0.0
    covariance: ArrayLike | None = None
    dofs: Sequence[int] | None = None


@dataclass(frozen=True)
class LinearTarget:
    """features (m, n nb) @ weights = target (m,) + noise of covariance (m, m); a label for each row."""

    features: Array
    target: Array
    noise: Array
    labels: tuple[str, ...]


def linear_target(via_points: Sequence[ViaPoint], basis: GaussianBasis, n_dof: int) -> LinearTarget:
    """Stack via-points into one linear target on the flat weights of `n_dof` DoFs, or raise PrompError."""
    if not via_points:
        raise PrompError("via-points: expected at least one, got none")
    parts = [_one_target(via_point, basis, n_dof) for via_point in via_points]
    rows = np.cumsum([0] + [part.target.size for part in parts])
    noise = np.zeros((rows[-1], rows[-1]))
    for part, first, last in zip(parts, rows[:-1], rows[1:], strict=True):
        noise[first:last, first:last] = part.noise
    return LinearTarget(
        np.vstack([part.features for part in parts]),
        np.concatenate([part.target for part in parts]),
        noise,
        tuple(label for part in parts for label in part.labels),
    )


def _one_target(via_point: ViaPoint, basis: GaussianBasis, n_dof: int) -> LinearTarget:
    phase = phase_array(via_point.phase, ())
    dofs = _dof_indices(via_point.dofs, n_dof)
    selection = np.eye(n_dof)[dofs]  # (k, n)
    features, targets, deviations, labels = [], [], [], []

    def add(kind: str, row: Array, value: ArrayLike, accuracy: ArrayLike, accuracy_name: str) -> None:
        features.append(np.kron(selection, row))  # psi_t, one block a DoF
        targets.append(finite_array(kind, value, (dofs.size,)))
        deviation = finite_array(accuracy_name, accuracy)
        if deviation.shape not in ((), (dofs.size,)) or (deviation < 0).any():
            expected = f"one standard deviation, or {dofs.size}, of at least 0"
            raise PrompError(f"{accuracy_name}: expected {expected}, got {deviation}")
        deviations.append(np.broadcast_to(deviation, dofs.size))
        labels.extend(f"{kind} of DoF {dof} at phase {phase:g}" for dof in dofs)

    if via_point.position is not None:
        add("position", basis.value(phase), via_point.position, via_point.accuracy, "accuracy")
    if via_point.velocity is not None:
        if via_point.duration is None:
            raise PrompError("duration: expected the seconds the velocity refers to, got None")
        rate = basis.derivative(phase) / number("duration", via_point.duration, 0.0, strict=True)
        add("velocity", rate, via_point.velocity, via_point.velocity_accuracy, "velocity_accuracy")
    if not features:
        raise PrompError("via-point: expected a position, a velocity or both, got neither")
    deviation = np.concatenate(deviations)
    noise = np.diag(deviation**2)
    if via_point.covariance is not None:
        if deviation.any():
            raise PrompError("via-point: expected either accuracies or a covariance, got both")
        noise = finite_array("covariance", via_point.covariance, noise.shape)
    return LinearTarget(np.vstack(features), np.concatenate(targets), noise, tuple(labels))


def _dof_indices(dofs: Sequence[int] | None, n_dof: int) -> np.ndarray:
    if dofs is None:
        return np.arange(n_dof)
    try:
        indices = np.asarray(dofs)
    except ValueError:  # ragged
        indices = np.empty(0)
    if (
        indices.ndim != 1
        or indices.size == 0
        or not np.issubdtype(indices.dtype, np.integer)
        or np.unique(indices).size != indices.size
        or indices.min() < 0
        or indices.max() >= n_dof
    ):
        raise PrompError(f"dofs: expected different integers from 0 to {n_dof - 1}, got {dofs}")
    return indices
