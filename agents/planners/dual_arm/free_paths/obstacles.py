"""Clearances of motions of one capture from its surroundings, and the least clearance required."""

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.plans import Cause, Failure
from agents.planners.dual_arm.clearance import Gaps, gaps
from agents.planners.dual_arm.free_paths.nearness import parameters
from agents.planners.dual_arm.free_paths.solver import MESH, METHOD, FreePathSolver
from agents.planners.dual_arm.problem import Capture
from agents.planners.dual_arm.surroundings import Surroundings
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

EXTRA = 0.015  # m, of clearance beyond the margin below which nearness has a cost
LEEWAY = 0.01  # m, between the clearance possible at the start or the end and the one required then
LEAST_SPAN = 0.01  # of the duration, least weight of nearness at a node


class Obstacles:
    """Surroundings of one capture.

    Attributes:
        required: m, least clearance.
    """

    def __init__(
        self, robot: FloatingRobot, capture: Capture, around: Surroundings, solver: FreePathSolver
    ) -> None:
        self._robot, self._capture, self._around, self._solver = robot, capture, around, solver
        self.required = 0.0
        # Poses of the target at the solver's times.
        self._poses = None if around.motion is None else around.motion(solver.times)

    def gaps(self, q: Array, at: NDArray[np.int64]) -> Gaps:
        """Clearances of configurations (K, n) at times of the solver, by their indices (K,)."""
        times, duration, start = self._solver.times[at], self._capture.duration, self._capture.start
        return gaps(self._robot, self._around, times, q, duration, start, self._pose(at))

    def nearness(self, weight: float) -> Array:
        """Parameters of nearness (K, 28) at the nodes of the program, with a weight of deficits."""
        at = self._solver.nodes
        # Nodes are dense at the ends, where deficits would otherwise have little cost.
        weights = weight * np.maximum(LEAST_SPAN / MESH.weights, 1.0)
        start, duration, times = self._capture.start, self._capture.duration, self._solver.times[at]
        return parameters(self._robot, self._around, start, times, duration, self._pose(at), EXTRA, weights)

    def require_margin(self, possible: float) -> None:
        """Require the margin of the surroundings, or less if only `possible` m can be attained."""
        self._require(self._around.margin, possible)

    def limit(self, possible: float) -> None:
        """Require less if only `possible` m can be attained."""
        self._require(self.required, possible)

    def _require(self, gap: float, possible: float) -> None:
        self.required = min(gap, max(possible - LEEWAY, 0.0))

    def _pose(self, at: NDArray[np.int64]) -> tuple[Array, Array] | None:
        return None if self._poses is None else (self._poses[0][at], self._poses[1][at])

    def collision(self, when: str, gap: Gaps, at: NDArray[np.int64]) -> Failure:
        """Failure that names the nearest bodies, where they are and when."""
        what, place = gap.worst()
        time, margin = self._solver.times[at[place]], self.required
        reason = f"{when} {what} come to {gap.least:.3f} m at t = {time:.2f} s, {margin:.3f} m are kept"
        return Failure(METHOD, Cause.CLEARANCE, reason)
