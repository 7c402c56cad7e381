"""Plans from a network's outputs: corrected, checked, or a failure."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.amortised.motions import MotionBatch, Problems
from agents.planners.single_arm.amortised.steps import MotionLoss, Penalties
from agents.planners.single_arm.weights.legendre import LegendreBasis
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

METHOD = "planner_network"
BASIS = LegendreBasis(10)  # the remainder of a motion is a motion of the same basis
CORRECTION_DAMPING = 1e-3  # of a correction, m^2/s per squared coordinate
MOST_CORRECTIONS = 50
TOLERANCE = 0.04, 0.07, 0.0175  # m, rad and rad: largest errors of the end-effector and the base in a plan
LIMIT_TOLERANCE = 1.3
LIMITED = ("joint angles", "joint rates", "joint accelerations")


class NetworkMotions(NamedTuple):
    """Motions of S problems.

    Attributes:
        weights: (S, n, nb) of `BASIS`. failures: (S,) None, or the `Failure` of a motion that is no plan.
    """

    weights: Array
    failures: NDArray[np.object_]


class NetworkPlanner:
    """Corrects and checks motions that a network gives, many at once.

    Args:
        robot: of one arm. limits: on angles, rates and accelerations; others are not checked. c: m/rad, of
            eq. 20. corrections: Gauss-Newton steps onto the goal, within limits as far as that goes.
    """

    def __init__(self, robot: FloatingRobot, limits: Limits, c: float, corrections: int) -> None:
        self._robot, self._c, self.corrections = robot, c, corrections
        self._objective = MotionLoss(limits.checked(robot), robot.n_joints, Penalties())

    def batch(self, problems: Problems) -> MotionBatch:
        """Motions of problems."""
        return MotionBatch(self._robot, BASIS, problems, self._c)

    def plan(self, batch: MotionBatch, y: Array, corrections: int | None = None) -> NetworkMotions:
        """Motions from coordinates (S, n, m), after as many corrections as here or usual.

        One that is a plan only without corrections stays as it is.
        """
        if not len(y):
            return NetworkMotions(batch.weights(y), np.full(0, None, dtype=object))
        corrected = y
        for _ in range(self.corrections if corrections is None else corrections):
            at = batch.linearised(corrected)
            corrected = corrected + self._objective.correction(batch, corrected, at, CORRECTION_DAMPING)
        failures = self._failures(batch, corrected)
        worse = np.array([failure is not None for failure in failures], dtype=bool)
        if worse.any():
            before = self._failures(batch, y)
            kept = worse & np.array([failure is None for failure in before], dtype=bool)
            corrected = np.where(kept[:, None, None], y, corrected)
            failures[kept] = None
        return NetworkMotions(batch.weights(corrected), failures)

    def _failures(self, batch: MotionBatch, y: Array) -> NDArray[np.object_]:
        errors = np.linalg.norm(batch.effect(y)[1].reshape(-1, 3, 3), axis=2)
        ratios = self._objective.violation(batch, y)
        found = np.full(len(y), None, dtype=object)
        for row in np.flatnonzero(~(ratios <= LIMIT_TOLERANCE).all(axis=1)):
            worst = int(ratios[row].argmax())
            reason = f"{LIMITED[worst]} of the motion are {ratios[row, worst]:.2f} times their limit"
            cause = Cause.INFEASIBLE if worst else Cause.JOINT_LIMIT
            found[row] = Failure(METHOD, cause, reason, float(ratios[row, worst]) - 1.0)
        for row in np.flatnonzero(~(errors <= TOLERANCE).all(axis=1)):
            position, rotation, attitude = errors[row]
            reason = (
                f"the motion ends {position:.3g} m and {rotation:.3g} rad from the goal and with an attitude "
                f"error of {attitude:.3g} rad"
            )
            found[row] = Failure(METHOD, Cause.INACCURATE, reason, float(errors[row].max()))
        return found
