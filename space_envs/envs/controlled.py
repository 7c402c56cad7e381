"""Simulations of a task's robot under a control mode: the dynamics of an environment."""

from dataclasses import replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from space_envs.control import MODES
from space_envs.drives import Drive
from space_envs.dynamics.rotations import Array, base_rotation
from space_envs.envs.starts import Start
from space_envs.perturbations.brakes import BRAKE_INERTIA, BrakedDrive
from space_envs.perturbations.delays import Delay
from space_envs.perturbations.draws import EpisodeDraws, episode_draws
from space_envs.perturbations.friction import dry_friction
from space_envs.perturbations.masses import perturbed_moments
from space_envs.perturbations.sensors import SensorErrors
from space_envs.simulation import Simulation
from space_envs.tasks.base import CaptureTask


class ControlledSimulation:
    """N simulations of a task's robot, its drives and its control mode.

    Attributes:
        simulation: N simulations. drive: joint drives. mode: control mode.
    """

    _drive: ClassVar[type[Drive]] = Drive
    _fields: ClassVar[tuple[str, ...]] = ()  # of the simulation

    def __init__(self, task: CaptureTask, n: int, control_mode: str, threads: int | None) -> None:
        self._task, self._peak = task, task.layout.slices["peak_attitude"].start
        self.simulation = Simulation(task.model, n, threads, self._fields)
        self.drive = self._drive(self.simulation, task.control_period, task.robot)
        self.mode = MODES[control_mode](self.drive)

    def begin(self, rows: NDArray[np.int64], start: Start) -> None:
        """Set rows (k,) to the state of k starts."""
        simulation = self.simulation
        simulation.reset(rows)
        self._set_robots(rows, start)
        self._task.place(simulation, rows, start.goals)
        simulation.joint_position[rows] = start.goals.joint_position
        if start.joint_velocity is not None:
            simulation.joint_velocity[rows] = start.joint_velocity
            simulation.set_base_velocity(rows)
        simulation.refresh(rows)
        self.drive.reset(rows)

    def _set_robots(self, rows: NDArray[np.int64], start: Start) -> None:
        """Give the robots of rows (k,) the masses of k starts."""
        self.simulation.scale_base(rows, start.goals.mass_scale)

    def _actuate(self, action: Array) -> None:
        """Set the torques of a control period for actions (N, m)."""
        self.simulation.ctrl[:] = self.mode.torques(action)

    def seen(self, observation: Array) -> Array:
        """Observations (N, size) that policies get for the true ones (N, size), a copy."""
        return observation.copy()

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
        self._actuate(action)
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


class PerturbedSimulation(ControlledSimulation):
    """N simulations of robots that differ from the model that policies know, by the task's perturbation.

    Observations are true ones: outcomes, rewards and metrics follow from them. `seen` gives what is measured.
    """

    _drive = BrakedDrive
    _fields = ("qfrc_applied",)
    drive: BrakedDrive
    _draws: EpisodeDraws  # of the rows that are being set

    def __init__(self, task: CaptureTask, n: int, control_mode: str, threads: int | None) -> None:
        super().__init__(task, n, control_mode, threads)
        amounts, model = task.perturbation, task.model
        self.drive.locked = np.zeros((n, self.simulation.n_joints), dtype=bool)
        self._viscous, self._dry, self._friction = np.zeros((3, n, self.simulation.n_joints))
        self._errors = SensorErrors(model, n, amounts.noise, amounts.bias)
        self._commanded = Delay(amounts.action_delay, n, self.mode.size)
        self._measured = Delay(amounts.observation_delay, n, model.nsensordata)
        self._seen, self._bound = np.zeros((n, task.layout.size)), task.layout.bound

    def begin(self, rows: NDArray[np.int64], start: Start) -> None:
        """Set rows (k,) to the state of k starts, with perturbations drawn by their keys."""
        simulation = self.simulation
        bodies, joints = simulation.mass_factor.shape[1], simulation.n_joints
        self._draws = episode_draws(self._task.perturbation, start.keys, bodies, joints)
        self.drive.locked[rows] = self._draws.locked
        if start.joint_velocity is not None:
            start = replace(start, joint_velocity=np.where(self._draws.locked, 0.0, start.joint_velocity))
        super().begin(rows, start)
        self._errors.begin(rows, start.keys)
        self._commanded.begin(rows, 0.0)
        sensors = self._errors.measured(simulation.sensors[rows], np.zeros_like(rows), rows)
        self._measured.begin(rows, sensors)
        self._seen[rows, self._peak] = 0.0
        self._seen[rows] = self._look(sensors, np.zeros(len(rows)), rows)
        self._seen[rows, self._peak] = 0.0

    def _set_robots(self, rows: NDArray[np.int64], start: Start) -> None:
        """Give the robots of rows (k,) the masses, friction and locked joints that were drawn."""
        draws, robot, simulation = self._draws, self._task.robot, self.simulation
        factor = draws.mass.copy()
        factor[:, 0] *= start.goals.mass_scale
        moments = None
        if self._task.perturbation.inertia:
            moments = perturbed_moments(simulation.nominal_moments, draws.inertia)
        simulation.set_masses(rows, factor, moments)
        self._viscous[rows] = draws.viscous_friction * robot.torque_limit / robot.rate_limit
        self._dry[rows], self._friction[rows] = draws.dry_friction * robot.torque_limit, 0.0
        simulation.set_joints(rows, self._viscous[rows], BRAKE_INERTIA * draws.locked)

    def _look(self, sensors: Array, time: Array, rows: NDArray[np.int64]) -> Array:
        """Observations (k, size) of rows (k,) from measured sensors (k, s) and times (k,), s."""
        seen = self._task.observe(sensors, time, self._seen[rows, self._peak])
        seen[:, self._peak] = np.maximum(seen[:, self._peak], self._task.attitude(seen))
        return np.clip(seen, -self._bound, self._bound)

    def seen(self, observation: Array) -> Array:
        """Observations (N, size) that policies get for the true ones (N, size), a copy."""
        return self._seen.copy()

    def _actuate(self, action: Array) -> None:
        """Set the torques of a control period for actions (N, m) that are delayed, and the dry friction."""
        super()._actuate(self._commanded.passed(action))
        if not self._task.perturbation.dry_friction:
            return
        simulation, b = self.simulation, self.simulation.n_base
        inverse, force = np.linalg.inv(simulation.mass_matrix()), -simulation.bias()
        force[:, b:] += simulation.ctrl - self._viscous * simulation.joint_velocity
        period = self._task.control_period
        rate = simulation.joint_velocity + period * (inverse[:, b:] @ force[..., None])[..., 0]
        self._friction = dry_friction(inverse[:, b:, b:], rate, self._dry, period, self._friction)
        simulation.qfrc_applied[:, b : b + simulation.n_joints] = self._friction

    def observe(
        self, time: Array, rotation: Array, previous: Array, ended: NDArray[np.bool_] | None
    ) -> tuple[Array, NDArray[np.bool_] | None]:
        """True observations, as in the base class; what is measured is `seen` afterwards."""
        observation, diverged = super().observe(time, rotation, previous, ended)
        rows = np.arange(self.simulation.n)
        steps = np.rint(time / self._task.control_period).astype(np.int64)
        sensors = self._measured.passed(self._errors.measured(self.simulation.sensors, steps, rows))
        before, self._seen = self._seen, self._look(sensors, time, rows)
        for frozen in (ended, diverged):
            if frozen is not None:
                self._seen[frozen] = before[frozen]
        return observation, diverged

    def snapshot(self) -> dict[str, Any]:
        """State for `restore`."""
        own = {
            "locked": self.drive.locked.copy(),
            "commanded": self._commanded.snapshot(),
            "measured": self._measured.snapshot(),
            "seen": self._seen.copy(),
            "viscous": self._viscous.copy(),
            "dry": self._dry.copy(),
            "friction": self._friction.copy(),
        }
        return {**super().snapshot(), "perturbed": own, "errors": self._errors.snapshot()}

    def restore(self, snapshot: dict[str, Any]) -> None:
        """Restore a snapshot of the same number of simulations of the same task."""
        super().restore(snapshot)
        own = snapshot["perturbed"]
        self.drive.locked, self._seen = own["locked"].copy(), own["seen"].copy()
        self._viscous, self._dry = own["viscous"].copy(), own["dry"].copy()
        self._friction = own["friction"].copy()
        self._commanded.restore(own["commanded"])
        self._measured.restore(own["measured"])
        self._errors.restore(snapshot["errors"])


def controlled_simulation(
    task: CaptureTask, n: int, control_mode: str, threads: int | None
) -> ControlledSimulation:
    """N simulations of a task's robot, perturbed if the task says so."""
    kind = ControlledSimulation if task.perturbation.nominal else PerturbedSimulation
    return kind(task, n, control_mode, threads)
