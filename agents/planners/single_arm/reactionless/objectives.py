"""Sums of squares that the search for a path makes small."""

from typing import Protocol

import numpy as np

from agents.planners.single_arm.reactionless.paths import PathSpace, Samples, Sensitivities
from space_envs.dynamics.rotations import Array

COST_UNIT = 1e-4  # m^2/s, of eq. 20 times dt


class PathObjective(Protocol):
    """A sum of squares."""

    def residual(self, path: Samples) -> Array:
        """Residuals (r,) of a path."""
        ...

    def slopes(self, path: Samples, by: Sensitivities) -> Array:
        """Their derivatives (r, m) by the weights."""
        ...


class LeastDisturbance:
    """Eq. 20 times dt of a path at a duration in s: of displacement alone.

    Args:
        unit: m^2/s, of costs; the larger, the more do violations weigh against them.
    """

    def __init__(self, space: PathSpace, duration: float, unit: float = COST_UNIT) -> None:
        self._scale = np.sqrt(space.series.weight / (duration * unit))[:, None]
        self._to_drift = self._scale * space.series.even

    def residual(self, path: Samples) -> Array:
        """Residuals (3 N + 3,) of a path."""
        return (self._scale * path.drift).ravel()

    def slopes(self, path: Samples, by: Sensitivities) -> Array:
        """Their derivatives by the weights."""
        samples, _, size = by.shift.shape
        return (self._to_drift @ by.shift.reshape(samples, -1)).reshape(-1, size)
