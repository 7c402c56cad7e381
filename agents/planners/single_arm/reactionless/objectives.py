"""Sums of squares that the search for a path makes small."""

from collections.abc import Callable

import numpy as np

from agents.planners.single_arm.reactionless.limits import PathLimits
from agents.planners.single_arm.reactionless.paths import PathSpace, Samples, Sensitivities
from space_envs.dynamics.rotations import Array

Objective = Callable[[Samples, Sensitivities], tuple[Array, Array]]
"""A path and its derivatives -> residuals (r,) and their slopes (r, m)."""

COST_UNIT = 1e-4  # m^2/s, of eq. 20: violations weigh against costs in this unit
NEGLIGIBLE = 0.2  # share of a limit, below which its power does not count
PENALTY = 150.0  # of a share above the allowed one, or of a violation, throughout the path; its root in costs


def least_disturbance(
    space: PathSpace, limits: PathLimits, duration: float, share: float, unit: float = COST_UNIT
) -> Objective:
    """Eq. 20 times dt of a path at a duration in s, and penalties on more than a share of the limits.

    Args:
        unit: m^2/s, of costs; the larger, the more do violations weigh against costs.
    """
    weight = np.sqrt(space.series.weight)
    scale = (weight / np.sqrt(duration * unit))[:, None]
    to_drift = scale * space.series.even

    def residuals(path: Samples, by: Sensitivities) -> tuple[Array, Array]:
        drift, by_drift = (scale * path.drift).ravel(), (to_drift @ by.shift.reshape(len(scale), -1))
        value, slope, time = limits.shares(path, by, duration, share)
        beyond, by_beyond = (
            PENALTY * weight[time] * (value - share),
            (PENALTY * weight[time])[:, None] * slope,
        )
        parts = [(drift, by_drift.reshape(-1, space.size)), (beyond, by_beyond)]
        return _with_violations(space, limits, path, by, parts)

    return residuals


def shortest_duration(space: PathSpace, limits: PathLimits, duration: float, power: float) -> Objective:
    """Squares of a power of the shares of limits, at a duration in s near the shortest one.

    The higher the power, the nearer is the result to the path whose largest share is least.
    """
    weight = np.sqrt(space.series.weight)

    def residuals(path: Samples, by: Sensitivities) -> tuple[Array, Array]:
        value, slope, time = limits.shares(path, by, duration, NEGLIGIBLE)
        by_raised = (power * weight[time] * value ** (power - 1.0))[:, None] * slope
        return _with_violations(space, limits, path, by, [(weight[time] * value**power, by_raised)])

    return residuals


def _with_violations(
    space: PathSpace,
    limits: PathLimits,
    path: Samples,
    by: Sensitivities,
    parts: list[tuple[Array, Array]],
) -> tuple[Array, Array]:
    value, slope = limits.violations(path, by)
    factor = PENALTY * np.sqrt(space.series.weight[1])
    values, slopes = zip(*parts, (factor * value, factor * slope), strict=True)
    return np.concatenate(values), np.concatenate(slopes)
