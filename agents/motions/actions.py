"""Actions that are whole joint motions: the free weights of a ProMP, within the limits of the drives."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from agents.planners.single_arm.weights.shapes import Basis, Shapes
from promp import GaussianBasis
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, positive, positive_integer
from space_envs.policy import PolicyContext

SCALE = 2.0  # rad, root of the integral over phase of a joint's squared rate, per function and unit action
SHARE = 0.85  # of an episode, that a motion lasts by default; the rest is for the hold
SAMPLES = 33  # at which limits are imposed


class Motions(NamedTuple):
    """Joint motions of N episodes that come to rest, from now on.

    Attributes:
        basis: of the weights. weights: (N, n, nb), rad. duration: s.
    """

    basis: Basis
    weights: Array
    duration: float

    def sample(self, times: Array) -> tuple[Array, Array]:
        """Angles and rates (N, T, n), rad and rad/s, at times (T,) s; at rest after the end."""
        phase = np.minimum(times / self.duration, 1.0)
        rate = self.basis.derivative(phase) / self.duration * (times <= self.duration)[:, None]
        return tuple((self.weights @ x.T).swapaxes(1, 2) for x in (self.basis.value(phase), rate))  # type: ignore[return-value]


@dataclass(frozen=True, eq=False)
class MotionActions:
    """Maps actions (N, n m) in [-1, 1] to joint motions.

    An episode is divided into equal parts. At the start of each the action chooses the rest of the motion,
    from the present angles and rates to rest at the motion's end. A motion that would exceed a limit of the
    joints is shortened towards the one of least squared rates until it does not.

    Attributes:
        duration: s, of the motion of an episode. parts: actions in an episode.
        period: s, of control. horizon: control periods of an episode.
        position: (n, 2) rad. rate, acceleration: (n,) largest ones, rad/s and rad/s^2.
        basis: of the weights.

    Raises:
        ConfigurationError: for a value out of its range.
    """

    duration: float
    parts: int
    period: float
    horizon: int
    position: Array
    rate: Array
    acceleration: Array
    basis: Basis = GaussianBasis()

    def __post_init__(self) -> None:
        positive_integer("motions", self.parts, self.horizon)
        steps = round(positive("duration", self.duration) / self.period)
        object.__setattr__(self, "duration", steps * self.period)
        if not (self.parts - 1) * self.steps < steps <= self.horizon:
            last, end = (self.parts - 1) * self.steps * self.period, self.horizon * self.period
            raise ConfigurationError(
                f"a motion must last longer than {last:g} s, where the last of {self.parts} parts begins, "
                f"and at most {end:g} s, the episode; got {self.duration:g} s"
            )

    @classmethod
    def of(cls, context: PolicyContext, parts: int = 1, duration: float | None = None) -> Self:
        """Motions of a task's robot.

        Args:
            parts: of an episode. duration: s; None is the usual share of the episode.
        """
        duration = SHARE * context.horizon * context.control_period if duration is None else duration
        return cls(
            duration,
            parts,
            context.control_period,
            context.horizon,
            context.joint_limits,
            context.rate_limit,
            context.acceleration_limit,
        )

    @property
    def steps(self) -> int:
        """Control periods in a part of an episode."""
        return math.ceil(self.horizon / self.parts)

    @property
    def size(self) -> int:
        """Number of components of an action, n m."""
        return len(self.rate) * Shapes.of(self.basis).free.shape[1]

    def part(self, time: Array) -> NDArray[np.int64]:
        """Part (N,) of an episode that begins at times (N,) s."""
        return np.rint(time / (self.steps * self.period)).astype(np.int64)

    def plan(self, part: int, angle: Array, rate: Array, action: Array) -> Motions:
        """Motions of N episodes that are at the beginning of a part.

        Args:
            angle, rate: (N, n) rad and rad/s, at present. action: (N, n m) in [-1, 1].
        """
        shapes, remaining = Shapes.of(self.basis), self.duration - part * self.steps * self.period
        given = np.stack([angle, rate * remaining, np.zeros_like(rate)], axis=2)
        least = given @ shapes.fixed.T
        added = SCALE * np.clip(action, -1.0, 1.0).reshape(*angle.shape, -1) @ shapes.free.T
        return Motions(self.basis, least + self._share(least, added, remaining) * added, remaining)

    def _share(self, least: Array, added: Array, duration: float) -> Array:
        """Largest share (N, 1, 1) of added weights (N, n, nb) that keeps the limits."""
        share = np.ones((len(least), 1, 1))
        for order, low, high in self._limits:
            functions = self._sampled[order].T / duration**order
            now, more = least @ functions, added @ functions
            room = np.where(more > 0.0, high - now, now - low)
            most = room / np.maximum(np.abs(more), 1e-12)
            share = np.minimum(share, most.min(axis=(1, 2), keepdims=True))
        return np.maximum(share, 0.0)

    @cached_property
    def _limits(self) -> tuple[tuple[int, Array, Array], ...]:
        """Order of the derivative, least and largest value (n, 1) of each limit."""
        low, high = self.position[:, :1], self.position[:, 1:]
        rate, acceleration = self.rate[:, None], self.acceleration[:, None]
        return (0, low, high), (1, -rate, rate), (2, -acceleration, acceleration)

    @cached_property
    def _sampled(self) -> tuple[Array, Array, Array]:
        phase = np.linspace(0.0, 1.0, SAMPLES)
        functions: tuple[Callable[[Array], Array], ...] = (
            self.basis.value,
            self.basis.derivative,
            self.basis.second_derivative,
        )
        return tuple(function(phase) for function in functions)  # type: ignore[return-value]
