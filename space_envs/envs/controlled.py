"""Simulations of a task's robot under a control mode: the dynamics of an environment."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.control import MODES
from space_envs.drives import Drive
from space_envs.dynamics.rotations import Array
from space_envs.envs.starts import Start
from space_envs.simulation import Simulation
from space_envs.tasks.base import CaptureTask


class ControlledSimulation:
    """N simulations of a task's robot, its drives and its control mode.

    Attributes:
        simulation: N simulations. drive: joint drives. mode: control mode.
    """

    def __init__(self, task: CaptureTask, n: int, control_mode: str, threads: int | None) -> None:
        self._task = task
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
    ) -> NDArray[np.int64] | None:
        """Simulate a control period.

        Args:
            action: (N, m) in [-1, 1]. running: rows (k,) to advance; None is all.
            watched: whether contacts are checked.

        Returns:
            Codes (N,) of the first contacts; None if contacts are not checked.
        """
        simulation, task = self.simulation, self._task
        self.drive.begin()
        simulation.ctrl[:] = self.mode.torques(action)
        before = simulation.sensors.copy() if watched else None
        simulation.step(task.substeps, running)
        if before is None:
            return None
        if running is None:
            return task.collided(before, simulation.sensors)
        touched = np.zeros(simulation.n, dtype=np.int64)
        if len(running):
            touched[running] = task.collided(before[running], simulation.sensors[running])
        return touched

    def observe(
        self, time: Array, previous: Array, ended: NDArray[np.bool_] | None
    ) -> tuple[Array, NDArray[np.bool_] | None]:
        """Observations (N, size), and the mask (N,) of diverged simulations, None if there are none.

        Rows that ended before or have diverged have their previous observations.

        Args:
            time: (N,) s. previous: (N, size). ended: (N,); None if no row has.
        """
        observation = self._task.observe(self.simulation.sensors, time)
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
