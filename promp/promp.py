"""The probabilistic movement primitive: a Gaussian over the weights of a basis (shyam2020, sec. V)."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike

from promp.basis import GaussianBasis
from promp.checks import Array, count, finite_array, number, phase_array
from promp.errors import ConditioningError, PrompError, StorageError
from promp.gaussian import Factor, condition_gaussian, factor_covariance, log_density
from promp.regression import DEFAULT_RIDGE, regress_weights
from promp.storage import load_arrays, save_arrays
from promp.via_points import ViaPoint, linear_target


class Trajectories(NamedTuple):
    """Batched joint motions, each array (..., T, n): rad, rad/s, rad/s^2."""

    position: Array
    velocity: Array
    acceleration: Array


def _frozen(array: ArrayLike) -> Array:
    copy = np.array(array, dtype=np.float64, order="C")
    copy.flags.writeable = False
    return copy


@dataclass(frozen=True, eq=False)
class ProMP:
    """w ~ N(mu_w, Sigma_w), the joint positions at phase z being sum_i psi_i(z) w_i for each DoF (eq. 13).

    Args:
        mean: mu_w, (n, nb) or flat (n nb,), rad; kept as (n, nb).
        covariance: Sigma_w, (n nb, n nb), rad^2, DoF-major; symmetric, positive semi-definite, singular or
            not.
        basis: the nb basis functions.

    Immutable: the arrays are read-only copies, and conditioning returns a new object. What has less than a
    millionth of the largest standard deviation counts as fixed (see promp.gaussian for every tolerance).
    """

    mean: Array
    covariance: Array
    basis: GaussianBasis = GaussianBasis()

    def __post_init__(self) -> None:
        if not isinstance(self.basis, GaussianBasis):
            raise PrompError(f"basis: expected a GaussianBasis, got {self.basis!r}")
        mean = finite_array("mean", self.mean)
        if mean.ndim == 1 and mean.size % self.basis.size == 0:
            mean = mean.reshape(-1, self.basis.size)
        mean = finite_array("mean", mean, (None, self.basis.size))
        if mean.size == 0:
            raise PrompError(f"mean: expected at least one DoF, got shape {mean.shape}")
        covariance = finite_array("covariance", self.covariance, (mean.size, mean.size))
        object.__setattr__(self, "mean", _frozen(mean))
        object.__setattr__(self, "covariance", _frozen(covariance))
        _ = self.factor  # refuses a matrix that is no covariance now, not at its first use

    def __reduce__(self) -> tuple[type, tuple[Array, Array, GaussianBasis]]:
        # Through the constructor, so that the arrays are read-only in a worker process too.
        return type(self), (self.mean, self.covariance, self.basis)

    @property
    def n_dof(self) -> int:
        """Number of DoFs n."""
        return self.mean.shape[0]

    @cached_property
    def factor(self) -> Factor:
        """Eigen-factor of the covariance, without the directions of no variance."""
        return factor_covariance(self.covariance)

    # Learning

    @classmethod
    def fit(
        cls,
        positions: ArrayLike,
        velocities: ArrayLike | None = None,
        *,
        phase: ArrayLike | None = None,
        duration: float | None = None,
        basis: GaussianBasis | None = None,
        ridge: float = DEFAULT_RIDGE,
        exact_ends: bool = False,
        weight_noise: float = 0.0,
    ) -> Self:
        """Learn from demonstrations: eq. 16 (regress_weights, which takes the same arguments), then eq. 17.

        `exact_ends` is what a planner wants that conditions on a start which all demonstrations share:
        otherwise that start has, in the weights, the tiny variance of the fitting errors, and asking for it
        exactly can be a many-sigma event that bends the rest of the motion. `weight_noise`: see fit_weights.
        """
        basis = GaussianBasis() if basis is None else basis
        weights = regress_weights(
            positions,
            velocities,
            basis=basis,
            phase=phase,
            duration=duration,
            ridge=ridge,
            exact_ends=exact_ends,
        )
        return cls.fit_weights(weights, basis, weight_noise)

    @classmethod
    def fit_weights(
        cls, weights: ArrayLike, basis: GaussianBasis | None = None, weight_noise: float = 0.0
    ) -> Self:
        """Mean and covariance (divided by D, not D - 1) of demonstrated weights (D, n, nb): eq. 17.

        `weight_noise` (rad) adds weight_noise^2 to the variance of every weight: a prior belief that motions
        unlike the demonstrations are possible too. At 0, the default, the covariance is that of eq. 17, and
        has a rank of at most D - 1.
        """
        basis = GaussianBasis() if basis is None else basis
        weights = finite_array("weights", weights, (None, None, basis.size))
        if weights.shape[0] == 0:
            raise PrompError("weights: expected at least one demonstration, got none")
        noise = number("weight_noise", weight_noise, 0.0)
        flat = weights.reshape(weights.shape[0], -1)
        mean = flat.mean(axis=0)
        centred = flat - mean
        covariance = centred.T @ centred / flat.shape[0] + noise**2 * np.eye(mean.size)
        return cls(mean, covariance, basis)

    # The distribution of motions

    def position(self, phase: ArrayLike) -> Array:
        """Mean position, rad, at phases of shape S: S + (n,)."""
        return self.basis.value(phase) @ self.mean.T

    def velocity(self, phase: ArrayLike, duration: float) -> Array:
        """Mean velocity, rad/s, at phases of shape S of a motion of `duration` s: S + (n,)."""
        return self.basis.derivative(phase) @ self.mean.T / number("duration", duration, 0.0, strict=True)

    def state(self, phase: ArrayLike, duration: float) -> tuple[Array, Array]:
        """Mean S + (2 n,) and covariance S + (2 n, 2 n) of the state [q, qd] at phases of shape S: eq. 15.

        Without the observation noise Sigma_x, which belongs to whoever observes; add it if there is one.
        """
        seconds = number("duration", duration, 0.0, strict=True)
        features = np.stack(
            [self.basis.value(phase), self.basis.derivative(phase) / seconds], axis=-2
        )  # S + (2, nb)
        mean = np.einsum("...kb,ib->...ki", features, self.mean)
        # Through the factor the result is positive semi-definite and what is fixed has exactly no variance.
        rank = self.factor.deviations.size
        directions = self.factor.directions.reshape(self.n_dof, self.basis.size, rank)
        spread = np.einsum("...kb,ibr->...kir", features, directions)
        size = 2 * self.n_dof
        spread = spread.reshape(*spread.shape[:-3], size, rank)
        return mean.reshape(*mean.shape[:-2], size), spread @ np.swapaxes(spread, -1, -2)

    def trajectories(self, weights: ArrayLike, phase: ArrayLike, duration: float) -> Trajectories:
        """Motions of weights (..., n, nb) at phases (T,): position, velocity, acceleration (..., T, n)."""
        weights = self._weights(weights)
        phase = phase_array(phase, (None,))
        seconds = number("duration", duration, 0.0, strict=True)
        columns = np.swapaxes(weights, -1, -2)
        return Trajectories(
            self.basis.value(phase) @ columns,
            self.basis.derivative(phase) / seconds @ columns,
            self.basis.second_derivative(phase) / seconds**2 @ columns,
        )

    def sample(self, rng: np.random.Generator, n: int) -> Array:
        """`n` independent weights (n, n_dof, nb), exactly on the support of the distribution."""
        n = count("n", n, 0)
        latent = rng.standard_normal((n, self.factor.deviations.size))
        return self.mean + (latent @ self.factor.directions.T).reshape(n, *self.mean.shape)

    def log_likelihood(self, weights: ArrayLike) -> Array:
        """Log-density of weights (..., n, nb), shape (...), on the support of the covariance; -inf off it.

        With a singular covariance it is the density on the affine subspace that carries the distribution, so
        only values of the same ProMP can be compared; promp.gaussian.log_density states what counts as off
        it.
        """
        weights = self._weights(weights)
        return log_density(
            self.mean.ravel(), self.factor, weights.reshape(*weights.shape[:-2], self.mean.size)
        )

    # Conditioning

    def condition(
        self,
        phase: float,
        position: ArrayLike | None = None,
        velocity: ArrayLike | None = None,
        *,
        duration: float | None = None,
        accuracy: ArrayLike = 0.0,
        velocity_accuracy: ArrayLike = 0.0,
        covariance: ArrayLike | None = None,
        dofs: Sequence[int] | None = None,
        tolerance: float = 1e-6,
    ) -> Self:
        """The distribution of motions that meet one via-point (eq. 18, 19); ViaPoint has the arguments."""
        via_point = ViaPoint(
            phase, position, velocity, duration, accuracy, velocity_accuracy, covariance, dofs
        )
        return self.condition_on([via_point], tolerance=tolerance)

    def condition_on(self, via_points: Sequence[ViaPoint], *, tolerance: float = 1e-6) -> Self:
        """The distribution of motions that meet all via-points, in one update.

        Where the accuracy is 0 (or below about 1e-6 rad), the mean and every sample meet the value to
        rounding. Asking for what is already fixed, within `tolerance` (rad, rad/s; relative for values above
        1), changes nothing. ConditioningError names the value that cannot be met: one that is fixed
        elsewhere, contradicts another, or is over 1000 standard deviations away, which would bend the rest of
        the motion as far.
        """
        target = linear_target(via_points, self.basis, self.n_dof)
        try:
            mean, covariance = condition_gaussian(
                self.mean.ravel(), self.factor, target.features, target.target, target.noise, tolerance
            )
        except ConditioningError as error:
            message = f"{target.labels[error.row]} cannot be met: {error}"
            raise ConditioningError(message, error.residual, error.row) from error
        return type(self)(mean, covariance, self.basis)

    # Files

    def save(self, path: str | Path) -> None:
        """Write an npz without pickles, with a checksum; the same ProMP gives the same bytes."""
        save_arrays(
            path,
            {
                "mean": self.mean,
                "covariance": self.covariance,
                "centres": np.array(self.basis.centres),
                "bandwidth": np.array(self.basis.bandwidth),
            },
        )

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote; StorageError names a file that is not whole, or of another version."""
        stored = load_arrays(path, ("mean", "covariance", "centres", "bandwidth"))
        try:
            basis = GaussianBasis(tuple(stored["centres"].tolist()), stored["bandwidth"].item())
            return cls(stored["mean"], stored["covariance"], basis)
        except (PrompError, TypeError, ValueError) as error:
            raise StorageError(f"{path}: expected a ProMP: {error}") from error

    def _weights(self, weights: ArrayLike) -> Array:
        array = finite_array("weights", weights)
        if array.shape[-2:] != self.mean.shape:
            raise PrompError(
                f"weights: expected shape (..., {self.n_dof}, {self.basis.size}), got {array.shape}"
            )
        return array
