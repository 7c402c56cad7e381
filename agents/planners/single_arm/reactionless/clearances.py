"""Clearances that paths keep: rows of inequalities, one class for each kind of obstacle."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from agents.planners.common.plans import Cause
from agents.planners.single_arm.inequalities.spheres import NearestPoints
from agents.planners.single_arm.reactionless.paths import Samples, Sensitivities
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.spheres import sphere_gaps

Gaps = Callable[[Array], Array]
"""Joint angles (..., n), rad -> gaps (..., S), m, between capsules of the arm and its satellite."""

CLEARANCE = 0.005  # m, of plans, or that at the start if it is less
AIMED_CLEARANCE = 0.015  # m, of the search, likewise
CLEARANCE_SCALE = 0.02  # m, of missing clearance that counts as a rate at twice its limit does
SPHERE_CLEARANCE, SPHERE_SCALE = 0.02, 0.1  # m, of the search as the two above, around spheres
_STEP = 1e-6  # rad, of difference quotients


class Clearance(Protocol):
    """Clearance from some obstacle.

    Attributes:
        obstacle: its name in reasons.
    """

    obstacle: str

    def missing(self, path: Samples) -> float:
        """Largest clearance that a plan lacks, m, negative if none is."""
        ...

    def violations(self, path: Samples, by: Sensitivities) -> tuple[Array, Array]:
        """Clearances missing (k,), the positive ones as shares of a scale, with their slopes (k, m)."""
        ...


class SatelliteKeepOut:
    """Capsules of the arm keep out of their satellite, by joint angles alone."""

    obstacle = "the satellite"

    def __init__(self, gaps: Gaps) -> None:
        self._gaps = gaps

    def missing(self, path: Samples) -> float:
        """Largest clearance that a plan lacks, m, negative if none is."""
        gap = self._gaps(path.angle)
        return float((np.minimum(CLEARANCE, gap[0]) - gap).max())

    def violations(self, path: Samples, by: Sensitivities) -> tuple[Array, Array]:
        """Clearances missing at the samples, with slopes by difference quotients."""
        gap = self._gaps(path.angle)
        missing = np.minimum(AIMED_CLEARANCE, gap[0]) - gap
        time, capsule = np.nonzero(missing > 0.0)
        moved = path.angle[time, None] + _STEP * np.eye(path.angle.shape[1])
        varied = self._gaps(moved)[np.arange(len(time)), :, capsule]
        slope = (gap[time, capsule][:, None] - varied) / _STEP  # (k, n)
        by_missing = (slope[:, None] @ by.angle[time])[:, 0]
        return missing[time, capsule] / CLEARANCE_SCALE, by_missing / CLEARANCE_SCALE


class SphereKeepOut:
    """Links keep out of spheres at rest, while the base is displaced and does not rotate.

    Args:
        spheres: (K, 4) centre and radius, m, in the frame of the base at the start.
        link_radius: m, (n,) or one for all, of links that are capsules from joint to joint.
    """

    obstacle = "a sphere"

    def __init__(self, robot: FloatingRobot, spheres: Array, link_radius: Array | float) -> None:
        self._robot, self._spheres, self._radius = robot, spheres, link_radius

    def missing(self, path: Samples) -> float:
        """Largest clearance that a plan lacks, m, negative if none is."""
        return float((CLEARANCE - self._gaps(self._ends(path)[0])).max())

    def violations(self, path: Samples, by: Sensitivities) -> tuple[Array, Array]:
        """Clearances missing at the samples, with slopes by the points of the links nearest to spheres."""
        ends, axes = self._ends(path)
        missing = SPHERE_CLEARANCE - self._gaps(ends)
        time, link, sphere = np.nonzero(missing > 0.0)
        near = NearestPoints.of(ends[time], axes[time], link, self._spheres[sphere, :3])
        by_gap = (near.lever[:, None] @ by.angle[time] + near.out[:, None] @ by.shift[time])[:, 0]
        return missing[time, link, sphere] / SPHERE_SCALE, -by_gap / SPHERE_SCALE

    def _ends(self, path: Samples) -> tuple[Array, Array]:
        """Ends of the links (M + 1, n + 1, 3) m and axes of the joints (M + 1, n, 3)."""
        k = self._robot.kinematics(path.angle)
        points = np.concatenate([k.position, self._robot.end_effector_pose(path.angle)[0][:, None]], axis=1)
        return path.shift[:, None] + points, k.axis

    def _gaps(self, ends: Array) -> Array:
        return sphere_gaps(ends, self._spheres, self._radius)


def clearance_fault(path: Samples, clearances: tuple[Clearance, ...]) -> tuple[Cause, str, float] | None:
    """Cause, reason and size of the largest clearance that a path lacks; None if it keeps all of them."""
    found = [(clearance.missing(path), clearance.obstacle) for clearance in clearances]
    missing, obstacle = max(found, default=(-np.inf, ""))
    if missing <= 0.0:
        return None
    return Cause.CLEARANCE, f"the path found comes {missing:.3f} m too close to {obstacle}", missing
