"""Targets of a ProMP in task space: inertial pose of the end-effector at a phase, by a roll-out of the base.

The frame of all poses is inertial: the base frame at phase 0. Total momentum is zero.
"""

import numpy as np
from numpy.typing import ArrayLike

from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.shapes import INTERVALS, Basis
from space_envs.checks import finite_array
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, positive


class PoseTarget:
    """Error of motions from a pose at a phase, with the derivative by their weights.

    As the `function` of promp.nonlinear.NonlinearTarget it conditions a ProMP on that pose; there is no
    inverse kinematics.

    Args:
        basis: of the weights. duration: s, of the whole motion.
        position: (3,) m, of the end-effector, or None for any.
        rotation: (3, 3), end-effector to inertial, or None for any.
        attitude: (3, 3), base to inertial, or None for any.
        approach: (3, 3) as `rotation`, where only its approach axis z counts, or None.
        phase: above 0 and at most 1. The base is rolled out over [0, phase], so that a pose along the path is
            as accurate as one at the end.

    Raises:
        ConfigurationError: if nothing is constrained, a shape is wrong, the phase is outside (0, 1], or both
            a rotation and an approach axis are given.
    """

    def __init__(
        self,
        robot: FloatingRobot,
        basis: Basis,
        duration: float,
        position: Array | None = None,
        rotation: Array | None = None,
        attitude: Array | None = None,
        phase: float = 1.0,
        approach: Array | None = None,
    ) -> None:
        if rotation is not None and approach is not None:
            raise ConfigurationError("a pose target has a rotation or an approach axis, got both")
        end_effector = approach if rotation is None else rotation
        constrained = [part is not None for part in (position, end_effector, attitude)]
        if not any(constrained):
            raise ConfigurationError("a pose target needs a position, a rotation or an attitude, got none")
        if not positive("phase", phase) <= 1.0:
            raise ConfigurationError(f"phase must be above 0 and at most 1, got {phase!r}")
        self.rows = np.repeat(constrained, (3, 3 if approach is None else 2, 3))
        self._functions = ArmFunctions.of(robot, INTERVALS)
        self._ending = self._functions.ending_of("pose" if approach is None else "axis")
        unit = np.eye(3)
        self._goal = np.concatenate(
            [
                np.zeros(3) if position is None else finite_array("position", position, (3,)),
                (unit if end_effector is None else finite_array("rotation", end_effector, (3, 3))).T.ravel(),
                (unit if attitude is None else finite_array("attitude", attitude, (3, 3))).T.ravel(),
            ]
        )
        step = positive("duration", duration) * phase / INTERVALS
        centre = np.arange(INTERVALS)[:, None] + 0.5
        points = (centre + np.array([-0.5, 0.5]) / np.sqrt(3.0)).ravel() * phase / INTERVALS
        self._gauss = np.stack([basis.value(points), basis.derivative(points) / duration])  # (2, 2 K, nb)
        self._end, self._step = basis.value(phase), np.array([step])

    def __call__(self, weights: ArrayLike) -> tuple[Array, Array]:
        """Errors (S, m) of weights (S, n, nb) and their derivative (S, m, n nb).

        Rows are three each of position m, rotation rad (rotation vector of the end-effector from its goal)
        and attitude rad (the same of the base), as far as they are constrained; those of an approach axis are
        two, its tilt in rad along the axes x and y of its goal.
        """
        weights = np.asarray(weights, dtype=np.float64)
        (s, n, size), points = weights.shape, 2 * INTERVALS
        states = (weights @ self._gauss.swapaxes(1, 2)[:, None]).swapaxes(-1, -2)  # (2, S, 2 K, n)
        xi, slope = self._functions.slopes(*states)
        step = np.broadcast_to(self._step, (s, 1))
        pose, propagation = self._functions.chain(xi.reshape(s, 6 * points), step)
        goal = np.broadcast_to(self._goal, (s, len(self._goal)))
        error, ending = self._ending(weights @ self._end, pose[:, -1], goal)
        # Derivative of the base's displacement by the weights, through every Gauss point.
        influence = (propagation.reshape(s, points, 6, 6) @ slope).reshape(s, points, 12 * n)
        columns = influence.swapaxes(1, 2).reshape(s, 6, 2, n, points)
        angle, rate = self._gauss
        displacement = (columns[:, :, 0] @ angle + columns[:, :, 1] @ rate).reshape(s, 6, n * size)
        by_weight = ending[..., :6] @ displacement
        by_weight += (ending[..., 6:, None] * self._end).reshape(s, len(self.rows), n * size)
        return error[:, self.rows], by_weight[:, self.rows]
