"""Conditioning on a nonlinear function of the weights, by iterated linearisation.

The most likely weights w of a ProMP that meet h(w) + e = x*, e ~ N(0, Sigma*), minimise
(w - mu)' Sigma^-1 (w - mu) + (h(w) - x*)' Sigma*^-1 (h(w) - x*); with Sigma* = 0 they meet h(w) = x* exactly.
Each iteration is the linear conditioning of eq. 18 and 19 of shyam2020 on h linearised where the last one
ended: the iterated extended Kalman update, which is Gauss-Newton on that sum (Bell and Cathey 1993).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from promp.checks import Array, count, finite_array, number
from promp.errors import ConditioningError, PrompError
from promp.gaussian import FIXED_FRACTION, condition_gaussian
from promp.promp import ProMP

Values = NDArray[np.floating]
Function = Callable[[NDArray[Any]], tuple[Values, Values]]

ITERATIONS = 60
TOLERANCE = 1e-9  # of what is missed, in the function's units
STILL = 1e-4  # standard deviations, of a step that is the last
SHORTEST = 1e-6  # share of a step below which it is given up
PROJECTIONS = 12  # iterations of `project`; it converges quadratically or not at all
_DECREASE = 1e-3  # share of the decrease that the linearisation promises, with which a step is taken


@dataclass(frozen=True, eq=False)
class NonlinearTarget:
    """h(w) - x* with its derivative, and how accurately it shall be zero.

    Args:
        function: weights (S, n, nb) -> what is missed (S, m) and its derivative (S, m, n nb) by the weights,
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
        prior: what was conditioned. targets: on what.
        iterations: that it took.
    """

    promp: ProMP
    prior: ProMP
    targets: tuple[NonlinearTarget, ...]
    iterations: int

    def sample(self, rng: np.random.Generator, n: int) -> tuple[Array, NDArray[np.bool_]]:
        """`n` samples (n, n_dof, nb), projected, and which (n,) of them meet the exact targets."""
        return self.project(self.promp.sample(rng, n))

    def project(self, samples: ArrayLike, tolerance: float = 1e-6) -> tuple[Array, NDArray[np.bool_]]:
        """Weights (S, n, nb) that meet the exact targets, near samples (S, n, nb), and which (S,) do.

        Gauss-Newton, all samples at once, with the shortest step in the prior's metric: samples change in
        directions in which the prior varies, and as little as it takes. Targets with an accuracy above 0 are
        left alone. A sample that does not get within `tolerance` is returned as far as it came.
        """
        weights = finite_array("samples", samples, (None, *self.prior.mean.shape)).copy()
        directions = self.prior.factor.directions
        met = np.zeros(len(weights), dtype=bool)
        rows = np.arange(len(weights))
        for left in range(PROJECTIONS if len(weights) else -1, -1, -1):
            missed, slope = _exact(self.targets, weights[rows])
            met[rows] = np.abs(missed).max(axis=1, initial=0.0) <= tolerance
            open_rows = ~met[rows] & np.isfinite(missed).all(axis=1)
            if not left or not open_rows.any():
                break
            rows, missed, slope = rows[open_rows], missed[open_rows], slope[open_rows]
            response = slope @ directions  # (S, m, r)
            latent = np.linalg.pinv(response, rcond=FIXED_FRACTION) @ missed[..., None]
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
        start: weights (n, nb) where the search begins; default the mean. They are first brought to the
            prior's support. Where several motions are locally most likely, the search ends in one near it.
        tolerance: of what exact targets may be missed by, in their units. iterations: at most.

    Raises:
        ConditioningError: with what is missed, if the search does not come within the tolerance of the exact
            targets, or does not come to rest.
        PrompError: for functions whose results have other shapes than NonlinearTarget says.
    """
    targets = (targets,) if isinstance(targets, NonlinearTarget) else tuple(targets)
    if not targets:
        raise PrompError("targets: expected at least one, got none")
    number("tolerance", tolerance, 0.0, strict=True)
    count("iterations", iterations)
    flat, factor = promp.mean.ravel(), promp.factor
    rank = factor.deviations.size
    latent = np.zeros(rank)
    if start is not None:
        latent = (finite_array("start", start, promp.mean.shape).ravel() - flat) @ factor.axes
        latent /= factor.deviations

    def at(unknown: Array) -> tuple[Array, Array, Array]:
        """What is missed, its derivative by the weights, and by the unknowns: latent variables and noise."""
        weights = flat + factor.directions @ unknown[:rank]
        missed, slope, deviation = _together(targets, weights.reshape(1, *promp.mean.shape))
        noise = np.diag(deviation)[:, deviation > 0.0]
        response = np.hstack([slope[0] @ factor.directions, noise])
        return missed[0] + noise @ unknown[rank:], slope[0], response

    deviation = _together(targets, promp.mean[None])[2]
    # The noise joins the unknowns, all of variance one: the shortest of those that meet everything exactly.
    unknown = np.concatenate([latent, np.zeros(np.count_nonzero(deviation))])
    missed, slope, response = at(unknown)
    price, length = 0.0, np.inf
    for iteration in range(1, iterations + 1):
        inverse = np.linalg.pinv(response, rcond=FIXED_FRACTION)
        goal = inverse @ (response @ unknown - missed)
        step = goal - unknown
        length = float(np.linalg.norm(step))
        if np.abs(missed).max() <= tolerance and length <= STILL:
            covariance = condition_gaussian(
                flat, factor, slope, slope @ (flat + factor.directions @ unknown[:rank]), deviation**2
            )[1]
            mean = flat + factor.directions @ unknown[:rank]
            return Conditioned(type(promp)(mean, covariance, promp.basis), promp, targets, iteration)
        # Exact penalty: the multipliers of the linearised problem are inverse' goal.
        price = max(price, 1.5 * float(np.abs(inverse.T @ goal).max()))
        here = _penalty(unknown, missed, price)
        promised = here - _penalty(goal, missed + response @ step, price)
        share = 1.0
        while True:
            trial = unknown + share * step
            there = at(trial)
            # What the step's own curvature adds is taken away to first order.
            bent = trial - inverse @ (there[0] - (1.0 - share) * missed)
            other = at(bent)
            if _penalty(bent, other[0], price) < _penalty(trial, there[0], price):
                trial, there = bent, other
            if here - _penalty(trial, there[0], price) >= _DECREASE * share * promised:
                break
            share *= 0.5
            if share < SHORTEST:
                raise _not_met(missed, length, iteration)
        unknown, (missed, slope, response) = trial, there
    raise _not_met(missed, length, iterations)


def _penalty(unknown: Array, missed: Array, price: float) -> float:
    """Half the squared deviations, and the price of what is missed."""
    return 0.5 * float(unknown @ unknown) + price * float(np.abs(missed).sum())


def _not_met(missed: Array, length: float, iterations: int) -> ConditioningError:
    row = int(np.argmax(np.abs(missed)))
    return ConditioningError(
        f"row {row}: after {iterations} iterations the target is missed by {missed[row]:.3g}, and the last "
        f"step had {length:.3g} standard deviations; state an accuracy, a nearer target or another start",
        missed,
        row,
    )


def _together(targets: Sequence[NonlinearTarget], weights: Array) -> tuple[Array, Array, Array]:
    """What weights (S, n, nb) miss (S, m), the derivatives (S, m, n nb) and the accuracies (m,)."""
    parts = []
    for target in targets:
        missed, slope = target.function(weights)
        missed = np.asarray(missed, dtype=np.float64)
        rows, size = len(weights), weights[0].size
        if missed.ndim != 2 or len(missed) != rows or np.shape(slope) != (*missed.shape, size):
            raise PrompError(
                f"function: expected shapes ({rows}, m) and ({rows}, m, {size}), "
                f"got {missed.shape} and {np.shape(slope)}"
            )
        deviation = finite_array("accuracy", target.accuracy)
        if deviation.shape not in ((), missed.shape[1:]) or (deviation < 0.0).any():
            raise PrompError(
                f"accuracy: expected one standard deviation, or {missed.shape[1]}, of at least 0, "
                f"got {deviation}"
            )
        parts.append((missed, slope, np.broadcast_to(deviation, missed.shape[1:])))
    missed, slopes, deviations = zip(*parts, strict=True)
    return np.concatenate(missed, axis=1), np.concatenate(slopes, axis=1), np.concatenate(deviations)


def _exact(targets: Sequence[NonlinearTarget], weights: Array) -> tuple[Array, Array]:
    """Those rows of `_together` that shall be met exactly."""
    missed, slope, deviation = _together(targets, weights)
    exact = deviation == 0.0
    return missed[:, exact], slope[:, exact]
