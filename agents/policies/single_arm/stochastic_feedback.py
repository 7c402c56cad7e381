"""Stochastic feedback from a ProMP: accelerations under which motions have the distribution of the ProMP.

The paper leaves the controller to future work; Paraschos, Daniel, Peters and Neumann (2018) give it: a linear
law whose gains and noise reproduce the mean and the covariance of the ProMP's state from one instant to the
next. Computed torque makes every joint a double integrator, whose accelerations are held over a control
period here, so that their limit of short steps is not needed. Deviations that are likely under the ProMP are
hardly corrected; those that would violate its conditions are, and the more the nearer these are in time.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from promp import ProMP
from space_envs.checks import non_negative
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, positive

# Share of the largest variance of a state that is added to every variance, so that gains stay finite where
# the distribution has no variance, such as at the start.
REGULARIZATION = 1e-6


@dataclass(frozen=True, eq=False)
class StochasticFeedback:
    """Accelerations a = mean + gain (x - state) + e, e ~ N(0, spread spread'), of the state x = [q; qdot].

    Attributes:
        period: s, over which accelerations are held. state: (K + 1, 2 n), of the mean, rad and rad/s.
        mean: (K, n) rad/s^2. gain: (K, n, 2 n) 1/s^2 and 1/s.
        spread: (K, n, n) rad/s^2, factor of the covariance.
    """

    period: float
    state: Array
    mean: Array
    gain: Array
    spread: Array

    @classmethod
    def of(
        cls,
        promp: ProMP,
        duration: float,
        period: float,
        position_noise: float = 0.0,
        rate_noise: float = 0.0,
    ) -> Self:
        """Feedback law of a ProMP.

        With x_k and the acceleration a_k = (qdot_k+1 - qdot_k) / period jointly Gaussian under the ProMP, the
        law is their conditional a_k | x_k: gain = cov(a, x) cov(x)^-1, and noise with the covariance that the
        rates then lack. The state gets the ProMP's mean and covariance at every step, but for the error of
        the trapezoidal rule in the angles, of second order in the period.

        Args:
            duration: s, a multiple of the period. position_noise, rate_noise: standard deviations with which
                the state is measured, rad and rad/s: they are added to cov(x), which lowers gains where
                measurements are less informative than the ProMP.

        Raises:
            ConfigurationError: if the duration is no multiple of the period or a noise is negative.
        """
        positive("period", period)
        count = round(positive("duration", duration) / period)
        if count < 1 or abs(count * period - duration) > 1e-9 * duration:
            raise ConfigurationError(f"duration must be a multiple of {period} s, got {duration}")
        for name, value in (("position_noise", position_noise), ("rate_noise", rate_noise)):
            non_negative(name, value)
        n, phase = promp.n_dof, np.linspace(0.0, 1.0, count + 1)
        basis = np.stack([promp.basis.value(phase), promp.basis.derivative(phase) / duration], axis=1)
        position, rate = np.einsum("kcb,ib->cki", basis, promp.mean)
        state = _held_states(position, rate, period)
        rank = promp.factor.deviations.size
        directions = promp.factor.directions.reshape(n, promp.basis.size, rank)
        varied = np.einsum("kcb,ibr->kcir", basis, directions).reshape(count + 1, 2 * n, rank)
        noise = np.repeat([position_noise**2, rate_noise**2], n)
        gain = _gains(varied, noise, duration, period)
        rate_covariance = varied[1:, n:] @ varied[1:, n:].swapaxes(1, 2)
        return cls(
            period=period,
            state=state,
            mean=(state[1:, n:] - state[:-1, n:]) / period,
            gain=gain,
            spread=_spread(gain, rate_covariance, noise, period),
        )

    def feedback(self, step: NDArray[np.int64], deviation: Array) -> Array:
        """Accelerations (N, n), rad/s^2, against deviations (N, 2 n) from the mean in periods `step` (N,).

        After the last period its gain stays.
        """
        return np.einsum("nij,nj->ni", self.gain[np.minimum(step, len(self.gain) - 1)], deviation)

    def noise(self, step: NDArray[np.int64], rng: np.random.Generator) -> Array:
        """Random accelerations (N, n), rad/s^2, of periods `step` (N,); zero after the last."""
        spread = self.spread[np.minimum(step, len(self.spread) - 1)]
        drawn = np.einsum("nij,nj->ni", spread, rng.standard_normal(spread.shape[:2]))
        return drawn * (step < len(self.spread))[:, None]

    def acceleration(
        self, step: int, position: Array, rate: Array, rng: np.random.Generator | None = None
    ) -> Array:
        """Accelerations (N, n), rad/s^2, of period `step` from measured angles and rates (N, n).

        With a generator they are drawn, as the ProMP's motions vary; without, they are expected values.
        """
        steps = np.full(len(position), step)
        deviation = np.concatenate([position, rate], axis=-1) - self.state[step]
        expected = self.mean[step] + self.feedback(steps, deviation)
        return expected if rng is None else expected + self.noise(steps, rng)


def _held_states(position: Array, rate: Array, period: float) -> Array:
    """States (K + 1, 2 n) to which held accelerations with the mean's rates (K + 1, n) lead.

    Gains that expect spread would otherwise take the difference for a deviation and enlarge it.
    """
    moved = 0.5 * period * (rate[1:] + rate[:-1]).cumsum(axis=0)
    return np.concatenate([np.vstack([position[:1], position[0] + moved]), rate], axis=1)


def _gains(varied: Array, noise: Array, duration: float, period: float) -> Array:
    """Gains (K, n, 2 n) cov(a, x) cov(x)^-1 of states with factors (K + 1, 2 n, r) of their covariance."""
    n = varied.shape[1] // 2
    change, before = (varied[1:, n:] - varied[:-1, n:]) / period, varied[:-1]
    # A change of unit makes angles and rates comparable.
    unit = np.repeat([1.0, duration / 2.0], n)
    measured = (before @ before.swapaxes(1, 2) + np.diag(noise)) * np.outer(unit, unit)
    measured += REGULARIZATION * np.trace(measured, axis1=1, axis2=2).max() * np.eye(2 * n)
    inverse = np.linalg.inv(measured) * np.outer(unit, unit)
    return change @ before.swapaxes(1, 2) @ inverse


def _spread(gain: Array, rate_covariance: Array, noise: Array, period: float) -> Array:
    """Factors (K, n, n) of the accelerations' noise that bring the rates to covariances (K, n, n).

    The covariance of the state under the law is carried along: the noise makes up for what lowered gains
    lose.
    """
    n = len(noise) // 2
    unit = np.eye(n)
    step = np.block([[unit, period * unit], [np.zeros((n, n)), unit]])
    enter = np.concatenate([0.5 * period**2 * unit, period * unit])
    covariance, spread = np.zeros((2 * n, 2 * n)), np.empty((len(gain), n, n))
    for k, law in enumerate(gain):
        closed = step + enter @ law
        known = closed @ covariance @ closed.T + enter @ (law * noise) @ law.T @ enter.T
        missing = (rate_covariance[k] - known[n:, n:]) / period**2
        variance, axes = np.linalg.eigh(0.5 * (missing + missing.T))
        spread[k] = axes * np.sqrt(np.maximum(variance, 0.0))
        covariance = known + enter @ spread[k] @ spread[k].T @ enter.T
    return spread
