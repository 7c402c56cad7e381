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


def least_disturbance(space: PathSpace, limits: PathLimits, duration: float, share: float) -> Objective:
    """Eq. 20 times dt of a path at a duration in s, and penalties on more than a share of the limits."""
    weight = np.sqrt(space.series.weight)[:, None]

    def residuals(path: Samples, by: Sensitivities) -> tuple[Array, Array]:
        scale = weight / np.sqrt(duration * COST_UNIT)
        drift, by_drift = (scale * path.drift).ravel(), (scale[..., None] * by.drift).reshape(-1, space.size)
        value = limits.shares(path, duration)
        time, place = np.nonzero(value > share)
        beyond = PENALTY * weight[time, 0] * (value[time, place] - share)
        by_beyond = PENALTY * weight[time] * limits.share_slopes(path, by, duration, time, place)
        return _with_violations(space, limits, path, by, [(drift, by_drift), (beyond, by_beyond)])

    return residuals


def shortest_duration(space: PathSpace, limits: PathLimits, duration: float, power: float) -> Objective:
    """Squares of a power of the shares of limits, at a duration in s near the shortest one.

    The higher the power, the nearer is the result to the path whose largest share is least.
    """
    weight = np.sqrt(space.series.weight)[:, None]

    def residuals(path: Samples, by: Sensitivities) -> tuple[Array, Array]:
        value = limits.shares(path, duration)
        time, place = np.nonzero(value > NEGLIGIBLE)
        value, scale = value[time, place], weight[time, 0]
        slope = limits.share_slopes(path, by, duration, time, place)
        by_raised = (power * scale * value ** (power - 1.0))[:, None] * slope
        return _with_violations(space, limits, path, by, [(scale * value**power, by_raised)])

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
