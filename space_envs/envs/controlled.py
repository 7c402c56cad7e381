"""Simulations of a task's robot under a control mode: the dynamics of an environment."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.control import MODES
from space_envs.drives import Drive
from space_envs.dynamics.rotations import Array, base_rotation
from space_envs.envs.starts import Start
from space_envs.simulation import Simulation
from space_envs.tasks.base import CaptureTask


class ControlledSimulation:
    """N simulations of a task's robot, its drives and its control mode.

    Attributes:
        simulation: N simulations. drive: joint drives. mode: control mode.
    """

    def __init__(self, task: CaptureTask, n: int, control_mode: str, threads: int | None) -> None:
        self._task, self._peak = task, task.layout.slices["peak_attitude"].start
        self.simulation = Simulation(task.model, n, threads)
        self.drive = Drive(self.simulation, task.control_period, task.robot)
        self.mode = MODES[control_mode](self.drive)

    def begin(self, rows: NDArray[np.int64], start: Start) -> None:
        """Set rows (k,) to the state of k starts."""
        simulation = self.simulation
        simulation.reset(rows)
        simulation.scale_base(rows, start.goals.mass_scale)
        self._task.place(simulation, rows, start.goals)
        simulation.joint_position[rows] = start.goals.joint_position
        if start.joint_velocity is not None:
            simulation.joint_velocity[rows] = start.joint_velocity
            simulation.set_base_velocity(rows)
        simulation.refresh(rows)
        self.drive.reset(rows)

    def advance(
        self, action: Array, running: NDArray[np.int64] | None, watched: bool
    ) -> tuple[NDArray[np.int64] | None, Array]:
        """Simulate a control period.

        Args:
            action: (N, m) in [-1, 1]. running: rows (k,) to advance; None is all.
            watched: whether contacts are checked.

        Returns:
            Codes (N,) of the first contacts, None if contacts are not checked; and the largest angles (N,) of
            the satellites from their initial attitudes after the steps of the simulation, rad.
        """
        simulation, task = self.simulation, self._task
        self.drive.begin()
        simulation.ctrl[:] = self.mode.torques(action)
        before = simulation.sensors.copy() if watched else None
        rotation = base_rotation(simulation.step(task.substeps, running)).max(axis=1)
        if running is None:
            return None if before is None else task.collided(before, simulation.sensors), rotation
        largest, touched = np.zeros(simulation.n), np.zeros(simulation.n, dtype=np.int64)
        largest[running] = rotation
        if before is not None and len(running):
            touched[running] = task.collided(before[running], simulation.sensors[running])
        return None if before is None else touched, largest

    def observe(
        self, time: Array, rotation: Array, previous: Array, ended: NDArray[np.bool_] | None
    ) -> tuple[Array, NDArray[np.bool_] | None]:
        """Observations (N, size), and the mask (N,) of diverged simulations, None if there are none.

        Rows that ended before or have diverged have their previous observations.

        Args:
            time: (N,) s. rotation: (N,) rad, largest angle of the satellite in the control period.
            previous: (N, size). ended: (N,); None if no row has.
        """
        peak = np.maximum(previous[:, self._peak], rotation)
        observation = self._task.observe(self.simulation.sensors, time, peak)
        if ended is not None:
            observation[ended] = previous[ended]
        if not self.simulation.warned() and np.isfinite(observation).all():
            return observation, None
        diverged = self.simulation.diverged() | ~np.isfinite(observation).all(axis=1)
        observation[diverged] = previous[diverged]
        return observation, diverged

    def snapshot(self) -> dict[str, Any]:
        """State for `restore`."""
        return {"simulation": self.simulation.snapshot(), "drive": self.drive.snapshot()}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Restore a snapshot of the same number of simulations of the same task."""
        self.simulation.restore(snapshot["simulation"])
        self.drive.restore(snapshot["drive"])
