"""Conditioning on a nonlinear function of the weights, by iterated linearisation.

The most likely weights w of a ProMP that meet h(w) + e = x*, e ~ N(0, Sigma*), minimise
(w - mu)' Sigma^-1 (w - mu) + (h(w) - x*)' Sigma*^-1 (h(w) - x*); with Sigma* = 0 they meet h(w) = x* exactly.
Each iteration is the linear conditioning of eq. 18 and 19 of shyam2020 on h linearised where the last one
ended: the iterated extended Kalman update, which is Gauss-Newton on that sum (Bell and Cathey 1993).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from promp.checks import Array, count, finite_array, number
from promp.errors import ConditioningError, PrompError
from promp.gaussian import FIXED_FRACTION, condition_gaussian
from promp.promp import ProMP

Values = NDArray[np.floating]
Function = Callable[[NDArray[Any]], tuple[Values, Values]]

ITERATIONS = 60
TOLERANCE = 1e-9  # of the residual, in the function's units
STILL = 1e-4  # standard deviations, of a step that is the last
SHORTEST = 1e-6  # share of a step below which it is given up
PROJECTIONS = 12  # iterations of `project`; it converges quadratically or not at all
_DECREASE = 1e-3  # share of the predicted decrease with which a step is taken


@dataclass(frozen=True, eq=False)
class NonlinearTarget:
    """h(w) - x* with its derivative, and how accurately it shall be zero.

    Args:
        function: weights (S, n, nb) -> residual (S, m) and its derivative (S, m, n nb) by the weights,
            flattened with the DoF first. It must be smooth where the search goes.
        accuracy: standard deviation, a number or (m,), in the function's units. 0 means exactly.
    """

    function: Function
    accuracy: ArrayLike = 0.0


@dataclass(frozen=True, eq=False)
class Conditioned:
    """A ProMP conditioned on nonlinear targets.

    Attributes:
        promp: its mean is the most likely motion that meets the targets; its covariance is that of eq. 19
            with h linearised there, so that samples meet them to first order.
        prior: the ProMP before. targets: conditions. iterations: of the search.
    """

    promp: ProMP
    prior: ProMP
    targets: tuple[NonlinearTarget, ...]
    iterations: int

    def sample(self, rng: np.random.Generator, n: int) -> tuple[Array, NDArray[np.bool_]]:
        """Samples (n, n_dof, nb), projected, and a mask (n,) of those that meet the exact targets."""
        return self.project(self.promp.sample(rng, n))

    def project(self, samples: ArrayLike, tolerance: float = 1e-6) -> tuple[Array, NDArray[np.bool_]]:
        """Weights (S, n, nb) near samples (S, n, nb), projected onto the exact targets; mask (S,) of success.

        Gauss-Newton, all samples at once, with the shortest step in the prior's metric: samples change in
        directions in which the prior varies, and as little as it takes. Targets with an accuracy above 0 are
        ignored. A sample that does not get within `tolerance` is returned as far as it came.
        """
        weights = finite_array("samples", samples, (None, *self.prior.mean.shape)).copy()
        directions = self.prior.factor.directions
        met = np.zeros(len(weights), dtype=bool)
        rows = np.arange(len(weights))
        for remaining in range(PROJECTIONS if len(weights) else -1, -1, -1):
            residual, slope = _exact(self.targets, weights[rows])
            met[rows] = np.abs(residual).max(axis=1, initial=0.0) <= tolerance
            open_rows = ~met[rows] & np.isfinite(residual).all(axis=1)
            if not remaining or not open_rows.any():
                break
            rows, residual, slope = rows[open_rows], residual[open_rows], slope[open_rows]
            response = slope @ directions  # (S, m, r)
            latent = np.linalg.pinv(response, rcond=FIXED_FRACTION) @ residual[..., None]
            weights[rows] -= (directions @ latent).reshape(-1, *weights.shape[1:])
        return weights, met


def condition_nonlinear(
    promp: ProMP,
    targets: NonlinearTarget | Sequence[NonlinearTarget],
    start: ArrayLike | None = None,
    *,
    tolerance: float = TOLERANCE,
    iterations: int = ITERATIONS,
) -> Conditioned:
    """The distribution of motions that meet nonlinear targets, around the most likely of them.

    Linear via-points come first, by `ProMP.condition_on`: what they fix has no variance and stays.

    Args:
        promp: of any covariance, singular or not. targets: one or several, which are met together.
        start: weights (n, nb), initial guess; default the mean. They are first brought to the
            prior's support. Where several motions are locally most likely, the search ends in one near it.
        tolerance: largest residual of exact targets, in their units. iterations: at most.

    Raises:
        ConditioningError: with the residual, if the search does not come within the tolerance of the exact
            targets, or does not come to rest.
        PrompError: for functions whose results have other shapes than NonlinearTarget says.
    """
    targets = (targets,) if isinstance(targets, NonlinearTarget) else tuple(targets)
    if not targets:
        raise PrompError("targets: expected at least one, got none")
    number("tolerance", tolerance, 0.0, strict=True)
    count("iterations", iterations)
    search = _Search(promp, targets)
    unknown = search.start(start)
    here = search.at(unknown)
    penalty_weight, length = 0.0, np.inf
    for iteration in range(1, iterations + 1):
        inverse = np.asarray(np.linalg.pinv(here.response, rcond=FIXED_FRACTION), dtype=np.float64)
        goal = inverse @ (here.response @ unknown - here.residual)
        length = float(np.linalg.norm(goal - unknown))
        if np.abs(here.residual).max() <= tolerance and length <= STILL:
            return Conditioned(search.conditioned(unknown, here.slope), promp, targets, iteration)
        # Exact penalty: the multipliers of the linearised problem are inverse' goal.
        penalty_weight = max(penalty_weight, 1.5 * float(np.abs(inverse.T @ goal).max()))
        found = search.step(unknown, goal, here, inverse, penalty_weight)
        if found is None:
            raise _not_met(here.residual, length, iteration)
        unknown, here = found
    raise _not_met(here.residual, length, iterations)


class _LinearTargets(NamedTuple):
    """Targets at some unknowns: residual (m,), derivatives by the weights (m, n nb) and by the unknowns."""

    residual: Array
    slope: Array
    response: Array


class _Search:
    """Search in the unknowns: latent variables of the prior (r,), and noise of the targets (q,).

    All have variance one: the shortest unknowns of those that meet everything exactly are the most likely.
    """

    def __init__(self, promp: ProMP, targets: tuple[NonlinearTarget, ...]) -> None:
        self._promp, self._targets = promp, targets
        self._mean, self._factor = promp.mean.ravel(), promp.factor
        self._rank = self._factor.deviations.size
        self._deviation = _together(targets, promp.mean[None])[2]

    def start(self, weights: ArrayLike | None) -> Array:
        """Unknowns (r + q,) of weights (n, nb), brought to the prior's support; of the mean for None."""
        latent = np.zeros(self._rank)
        if weights is not None:
            start = finite_array("start", weights, self._promp.mean.shape)
            latent = (start.ravel() - self._mean) @ self._factor.axes
            latent /= self._factor.deviations
        return np.concatenate([latent, np.zeros(np.count_nonzero(self._deviation))])

    def weights(self, unknown: Array) -> Array:
        """Flat weights (n nb,)."""
        return self._mean + self._factor.directions @ unknown[: self._rank]

    def at(self, unknown: Array) -> _LinearTargets:
        """The targets, linearised."""
        weights = self.weights(unknown).reshape(1, *self._promp.mean.shape)
        residual, slope, deviation = _together(self._targets, weights)
        noise = np.diag(deviation)[:, deviation > 0.0]
        response = np.hstack([slope[0] @ self._factor.directions, noise])
        return _LinearTargets(residual[0] + noise @ unknown[self._rank :], slope[0], response)

    def step(
        self, unknown: Array, goal: Array, here: _LinearTargets, inverse: Array, weight: float
    ) -> tuple[Array, _LinearTargets] | None:
        """Unknowns on the line to `goal`, or near it, that lower the penalty enough; None without any."""
        step, now = goal - unknown, _penalty(unknown, here.residual, weight)
        predicted = now - _penalty(goal, here.residual + here.response @ step, weight)
        share = 1.0
        while share >= SHORTEST:
            trial = unknown + share * step
            there = self.at(trial)
            # The residual that the step's own curvature adds is taken away to first order.
            bent = trial - inverse @ (there.residual - (1.0 - share) * here.residual)
            other = self.at(bent)
            if _penalty(bent, other.residual, weight) < _penalty(trial, there.residual, weight):
                trial, there = bent, other
            if now - _penalty(trial, there.residual, weight) >= _DECREASE * share * predicted:
                return trial, there
            share *= 0.5
        return None

    def conditioned(self, unknown: Array, slope: Array) -> ProMP:
        """The distribution around the weights found, with the targets linearised there."""
        mean = self.weights(unknown)
        target = slope @ mean
        _, covariance = condition_gaussian(self._mean, self._factor, slope, target, self._deviation**2)
        return type(self._promp)(mean, covariance, self._promp.basis)


def _penalty(unknown: Array, residual: Array, weight: float) -> float:
    """Half the squared deviations, and the weighted sum of residuals."""
    return 0.5 * float(unknown @ unknown) + weight * float(np.abs(residual).sum())


def _not_met(residual: Array, length: float, iterations: int) -> ConditioningError:
    row = int(np.argmax(np.abs(residual)))
    return ConditioningError(
        f"row {row}: after {iterations} iterations the residual is {residual[row]:.3g}, and the last "
        f"step had {length:.3g} standard deviations; state an accuracy, a nearer target or another start",
        residual,
        row,
    )


def _together(targets: Sequence[NonlinearTarget], weights: Array) -> tuple[Array, Array, Array]:
    """Residuals (S, m) of weights (S, n, nb), their derivatives (S, m, n nb) and the accuracies (m,)."""
    parts = []
    for target in targets:
        residual, slope = target.function(weights)
        residual = np.asarray(residual, dtype=np.float64)
        rows, size = len(weights), weights[0].size
        if residual.ndim != 2 or len(residual) != rows or np.shape(slope) != (*residual.shape, size):
            raise PrompError(
                f"function: expected shapes ({rows}, m) and ({rows}, m, {size}), "
                f"got {residual.shape} and {np.shape(slope)}"
            )
        deviation = finite_array("accuracy", target.accuracy)
        if deviation.shape not in ((), residual.shape[1:]) or (deviation < 0.0).any():
            raise PrompError(
                f"accuracy: expected one standard deviation, or {residual.shape[1]}, of at least 0, "
                f"got {deviation}"
            )
        parts.append((residual, slope, np.broadcast_to(deviation, residual.shape[1:])))
    residual, slopes, deviations = zip(*parts, strict=True)
    return np.concatenate(residual, axis=1), np.concatenate(slopes, axis=1), np.concatenate(deviations)


def _exact(targets: Sequence[NonlinearTarget], weights: Array) -> tuple[Array, Array]:
    """Rows of `_together` with an accuracy of 0: residuals (S, m) and their derivatives (S, m, n nb)."""
    residual, slope, deviation = _together(targets, weights)
    exact = deviation == 0.0
    return residual[:, exact], slope[:, exact]
