"""Limits of a robot on paths: the duration that they ask for, and the rows of a search that keep them."""

from dataclasses import dataclass

import numpy as np

from agents.planners.common.plans import Limits
from agents.planners.single_arm.reactionless.clearances import Clearance
from agents.planners.single_arm.reactionless.paths import PathSpace, Samples
from agents.planners.single_arm.reactionless.rows import (
    AccelerationRows,
    AngleRows,
    BrakingLimit,
    PathRows,
    RateRows,
    TorqueRows,
)
from space_envs.dynamics.rotations import Array


@dataclass(frozen=True, eq=False)
class PathLimits:
    """Limits on paths at any timing.

    Attributes:
        limits: of plans. deceleration: (n,) rad/s^2, with which the drives brake joints before the ends of
            their ranges; None if they do not. clearances: that paths keep.
    """

    limits: Limits
    deceleration: Array | None = None
    clearances: tuple[Clearance, ...] = ()

    def duration(self, space: PathSpace, path: Samples) -> dict[str, float]:
        """Shortest durations, s, by the limit that asks for them; those without a limit are absent."""
        limits, found = self.limits, {}
        fastest = self._braking(path.angle.shape[1]).fastest(path)[0]
        found["rate"] = float((np.abs(path.slope) / fastest).max())
        if limits.acceleration is not None:
            found["acceleration"] = float(np.sqrt((np.abs(path.curve) / limits.acceleration).max()))
        still = np.zeros_like(path.curve)
        for name, curve in (("torque", path.curve), ("coriolis", still)):
            if (limit := getattr(limits, name)) is not None:
                (torque,) = space.arm.torque(path.angle, path.slope, curve)
                found[name] = float(np.sqrt((np.abs(torque) / limit).max()))
        return found

    def beyond(self, path: Samples) -> float:
        """Largest angle beyond its range, rad, negative inside."""
        return float(self.limits.beyond_angles(path.angle).max())

    def rows(self, space: PathSpace, duration: float) -> tuple[PathRows, ...]:
        """Rows of a search for paths that keep the limits at a duration in s, and the clearances."""
        limits, found = self.limits, list[PathRows]()
        found += [AngleRows(limits.angles(space.n)), RateRows(self._braking(space.n), duration)]
        if limits.acceleration is not None:
            found.append(AccelerationRows(np.asarray(limits.acceleration), duration))
        for limit, accelerated in ((limits.torque, True), (limits.coriolis, False)):
            if limit is not None:
                found.append(TorqueRows(space.arm, np.asarray(limit), duration, accelerated))
        return (*found, *self.clearances)

    def _braking(self, n: int) -> BrakingLimit:
        rate = np.asarray(np.inf if self.limits.rate is None else self.limits.rate)
        return BrakingLimit(rate, self.deceleration, self.limits.angles(n))
