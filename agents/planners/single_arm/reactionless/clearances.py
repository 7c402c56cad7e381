"""Clearances that paths keep: rows of inequalities, one class for each kind of obstacle."""

from collections.abc import Callable
from typing import Protocol

import numpy as np

from agents.planners.common.plans import Cause
from agents.planners.single_arm.inequalities.spheres import NearestPoints
from agents.planners.single_arm.reactionless.paths import Samples, Sensitivities
from agents.planners.single_arm.reactionless.rows import PathRows, Places
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.spheres import sphere_gaps

Gaps = Callable[[Array], Array]
"""Joint angles (..., n), rad -> gaps (..., S), m, between capsules of the arm and its satellite."""

CLEARANCE = 0.005  # m, of plans, or that at the start if it is less
AIMED_CLEARANCE = 0.015  # m, of the search, likewise
CLEARANCE_SCALE = 0.05  # m, of missing clearance that counts as a rate at twice its limit does
SPHERE_CLEARANCE, SPHERE_SCALE = 0.012, 0.2  # m, of the search as the two above, around spheres
_STEP = 1e-6  # rad, of difference quotients


class Clearance(PathRows, Protocol):
    """Clearance from some obstacle.

    Attributes:
        obstacle: its name in reasons.
    """

    obstacle: str

    def missing(self, path: Samples) -> float:
        """Largest clearance that a plan lacks, m, negative if none is."""
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

    def excess(self, path: Samples) -> Array:
        """Clearances missing (M + 1, S) at the samples, as shares of a scale."""
        gap = self._gaps(path.angle)
        return (np.minimum(AIMED_CLEARANCE, gap[0]) - gap) / CLEARANCE_SCALE

    def slopes(self, path: Samples, by: Sensitivities, at: Places) -> Array:
        """Derivatives (k, m) of the values at some places, by difference quotients."""
        time, capsule = at
        if not len(time):
            return np.zeros((0, by.angle.shape[2]))
        n = path.angle.shape[1]
        moved = path.angle[time, None] + _STEP * np.eye(n + 1)[:, :n]  # the last one is where it is
        gap = self._gaps(moved)[np.arange(len(time)), :, capsule]
        slope = (gap[:, n:] - gap[:, :n]) / _STEP
        return (slope[:, None] @ by.between_all("angle", time))[:, 0] / CLEARANCE_SCALE


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

    def excess(self, path: Samples) -> Array:
        """Clearances missing (M + 1, n, K) at the samples, as shares of a scale."""
        return (SPHERE_CLEARANCE - self._gaps(self._ends(path)[0])) / SPHERE_SCALE

    def slopes(self, path: Samples, by: Sensitivities, at: Places) -> Array:
        """Derivatives (k, m) of the values at some places, by the points of the links nearest to spheres."""
        time, link, sphere = at
        ends, axes = self._ends(path)
        near = NearestPoints.of(ends[time], axes[time], link, self._spheres[sphere, :3])
        by_gap = (
            near.lever[:, None] @ by.between_all("angle", time)
            + near.out[:, None] @ by.between_all("shift", time)
        )[:, 0]
        return -by_gap / SPHERE_SCALE

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
