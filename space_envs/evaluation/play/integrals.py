"""Totals of an episode, integrated over every step of the simulation.

Control that holds a quantity at zero does so once a control period: samples at the control period alone would
not show the motion in between.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.bodies import BodyMotion, body_motion
from space_envs.dynamics.rotations import Array
from space_envs.simulation import Simulation
from space_envs.tasks.base import CaptureTask

_STEPS = 64  # simulation steps whose bodies are computed at once, so that long periods need no more memory


@dataclass(frozen=True)
class Totals:
    """Integrals and largest values (K,) of K episodes over the steps of the simulation.

    Attributes:
        base_angular_impulse: total variation of the satellite's angular momentum about its own centre of
            mass, which is the time integral of the reaction torque's magnitude, N m s.
        kinetic_energy_integral: time integral of twice the kinetic energy (trapezoids), C of shah2013, J s.
        mechanical_work: sum over joints and steps of |torque times change of angle|, which is exact for held
            torques but in a step within which a joint reverses, J.
        peak_power: largest sum over joints of |torque times rate| at either end of a step, W.
        peak_attitude: largest angle of the satellite from its initial attitude, deg.
        linear_momentum_drift, angular_momentum_drift: largest change of the robot's total momentum since the
            start, summed over its bodies, N s and N m s.
    """

    base_angular_impulse: Array
    kinetic_energy_integral: Array
    mechanical_work: Array
    peak_power: Array
    peak_attitude: Array
    linear_momentum_drift: Array
    angular_momentum_drift: Array


class Integrals:
    """Accumulates the totals of N episodes simulated side by side; their `Simulation.watch` calls `see`.

    Args:
        task: what is played.
        simulation: at the start of all episodes.
    """

    def __init__(self, task: CaptureTask, simulation: Simulation) -> None:
        self._task, self._simulation, self._inertia = task, simulation, simulation.inertia()
        n, joints, states = simulation.n, simulation.n_joints, task.substeps + 1
        # Of the present control period, from its beginning to its end.
        self._qpos = np.empty((n, states, 7 + joints))
        self._qvel = np.empty((n, states, 6 + joints))
        self._seen = 0
        self.see()
        self._start = self._motion(np.arange(n), slice(0, 1)).total
        self.totals = Totals(*np.zeros((7, n)))

    def see(self) -> None:
        """Record the state after a step of the simulation."""
        place = self._seen
        self._qpos[:, place], self._qvel[:, place] = self._simulation.robot_state()
        self._seen += 1

    def add(self, rows: NDArray[np.bool_], observation: Array) -> None:
        """Count the control period that was seen, in rows (N,) bool, and begin the next.

        Args:
            observation: (N, size) at its end, which holds the peak attitude.
        """
        counted = np.flatnonzero(rows)
        last = self._seen - 1
        for first in range(0, last, _STEPS):
            self._count(counted, slice(first, min(first + _STEPS, last) + 1))
        peak = self._task.layout.read(observation, "peak_attitude")[:, 0]
        self.totals.peak_attitude[counted] = np.rad2deg(peak[counted])
        for states in (self._qpos, self._qvel):
            states[:, 0] = states[:, last]
        self._seen = 1

    def _motion(self, rows: NDArray[np.int64], steps: slice) -> BodyMotion:
        qpos, qvel = self._qpos[rows, steps], self._qvel[rows, steps]
        inertia = None if self._inertia is None else self._inertia[rows, None]
        factor = self._simulation.mass_factor[rows, None]
        return body_motion(self._task.mechanics, qpos, qvel, factor, inertia)

    def _count(self, rows: NDArray[np.int64], steps: slice) -> None:
        """Count simulation steps, from the first to the last of some states, in rows (k,)."""
        totals, motion = self.totals, self._motion(rows, steps)
        torque = self._simulation.ctrl[rows, None]
        change = np.diff(self._qpos[rows, steps, 7:], axis=1)
        power = np.abs(torque * self._qvel[rows, steps, 6:]).sum(axis=-1)
        doubled = 2.0 * motion.kinetic_energy
        drift = np.linalg.norm((motion.total - self._start[rows]).reshape(*power.shape, 2, 3), axis=-1)
        spun = np.linalg.norm(np.diff(motion.base_spin, axis=1), axis=-1)
        totals.base_angular_impulse[rows] += spun.sum(axis=1)
        trapezoids = 0.5 * (doubled[:, :-1] + doubled[:, 1:]).sum(axis=1)
        totals.kinetic_energy_integral[rows] += self._task.step_size * trapezoids
        totals.mechanical_work[rows] += np.abs(torque * change).sum(axis=(1, 2))
        for largest, value in (
            (totals.peak_power, power),
            (totals.linear_momentum_drift, drift[..., 0]),
            (totals.angular_momentum_drift, drift[..., 1]),
        ):
            largest[rows] = np.maximum(largest[rows], value.max(axis=1))
