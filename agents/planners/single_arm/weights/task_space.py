"""Targets of a ProMP in task space: the end-effector's inertial pose at a phase, through the base's roll-out.

The frame of all poses is inertial: the base frame at phase 0. Total momentum is zero.
"""

import numpy as np
from numpy.typing import ArrayLike

from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.weight_space import INTERVALS, Basis
from space_envs.checks import finite_array
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, positive


class PoseTarget:
    """What motions miss of a pose at a phase, with the derivative by their weights.

    As the `function` of promp.nonlinear.NonlinearTarget it conditions a ProMP on that pose; there is no
    inverse kinematics.

    Args:
        basis: of the weights. duration: s, of the whole motion.
        position: (3,) m, of the end-effector, or None to leave it free.
        rotation: (3, 3), end-effector to inertial, or None to leave it free.
        attitude: (3, 3), base to inertial, or None to leave it free.
        phase: when, above 0 and at most 1. The base is rolled out over [0, phase], so that a pose on the way
            is as accurate as one at the end.

    Raises:
        ConfigurationError: if everything is free, a shape is wrong, or the phase is none.
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
    ) -> None:
        asked = [part is not None for part in (position, rotation, attitude)]
        if not any(asked):
            raise ConfigurationError("a pose target needs a position, a rotation or an attitude, got none")
        if not positive("phase", phase) <= 1.0:
            raise ConfigurationError(f"phase must be above 0 and at most 1, got {phase!r}")
        self.rows = np.repeat(asked, 3)
        self._functions = ArmFunctions.of(robot, INTERVALS)
        unit = np.eye(3)
        self._goal = np.concatenate(
            [
                np.zeros(3) if position is None else finite_array("position", position, (3,)),
                (unit if rotation is None else finite_array("rotation", rotation, (3, 3))).T.ravel(),
                (unit if attitude is None else finite_array("attitude", attitude, (3, 3))).T.ravel(),
            ]
        )
        step = positive("duration", duration) * phase / INTERVALS
        centre = np.arange(INTERVALS)[:, None] + 0.5
        points = (centre + np.array([-0.5, 0.5]) / np.sqrt(3.0)).ravel() * phase / INTERVALS
        self._gauss = np.stack([basis.value(points), basis.derivative(points) / duration])  # (2, 2 K, nb)
        self._end, self._step = basis.value(phase), np.array([step])

    def __call__(self, weights: ArrayLike) -> tuple[Array, Array]:
        """What weights (S, n, nb) miss (S, m), and its derivative (S, m, n nb).

        Rows are those of position m, rotation rad (of the end-effector from its goal, a rotation vector) and
        attitude rad (of the base likewise) that are asked for, three each.
        """
        weights = np.asarray(weights, dtype=np.float64)
        (s, n, size), points = weights.shape, 2 * INTERVALS
        states = (weights @ self._gauss.swapaxes(1, 2)[:, None]).swapaxes(-1, -2)  # (2, S, 2 K, n)
        xi, slope = self._functions.slopes(*states)
        step = np.broadcast_to(self._step, (s, 1))
        pose, pull = self._functions.chain(xi.reshape(s, 6 * points), step)
        goal = np.broadcast_to(self._goal, (s, len(self._goal)))
        missed, ending = self._functions.ending(weights @ self._end, pose[:, -1], goal)
        # Of the base's displacement at the phase, by the weights: through every Gauss point.
        pushes = (pull.reshape(s, points, 6, 6) @ slope).reshape(s, points, 12 * n)
        columns = pushes.swapaxes(1, 2).reshape(s, 6, 2, n, points)
        angle, rate = self._gauss
        drift = (columns[:, :, 0] @ angle + columns[:, :, 1] @ rate).reshape(s, 6, n * size)
        by_weight = ending[..., :6] @ drift
        by_weight += (ending[..., 6:, None] * self._end).reshape(s, 9, n * size)
        return missed[:, self.rows], by_weight[:, self.rows]
