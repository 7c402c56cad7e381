"""Motions over the whole range of a robot's joints, in any control mode, and how well they were simulated."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from copy import copy
from dataclasses import dataclass
from typing import NamedTuple

import mujoco
import numpy as np

from space_envs.control import MODES
from space_envs.drives import BRAKING_SHARE, STOP_MARGIN, Drive, JointStops, braking_shares
from space_envs.dynamics.bodies import body_motion, momentum_drift
from space_envs.dynamics.rotations import Array, angle_between
from space_envs.robots.models import SceneOptions, robot_model
from space_envs.robots.models.mechanics import robot_mechanics
from space_envs.robots.robot import Robot
from space_envs.simulation import Simulation

HOLDS = (0.0, 0.2, 0.5, 2.0, 3.0)  # s, how long actions are held, by row in turn; at least a control period
UPRIGHT = np.array([1.0, 0.0, 0.0, 0.0])


class SimulationSettings(NamedTuple):
    """Control mode, control period and time step of a simulation, s."""

    mode: str
    control_period: float
    timestep: float


@dataclass(frozen=True, eq=False)
class RobotMotion:
    """States of N episodes at the ends of control periods: qpos (N, T + 1, 7 + n), qvel (N, T + 1, 6 + n).

    Attributes:
        torques: (N, T, n) N m. diverged: whether MuJoCo found a bad state, at which the motion ends.
    """

    robot: Robot
    qpos: Array
    qvel: Array
    torques: Array
    diverged: bool

    @property
    def drift(self) -> float:
        """Largest drift of total momentum, relative to the largest momentum of a body."""
        if self.diverged:
            return np.inf
        return float(momentum_drift(body_motion(robot_mechanics(self.robot), self.qpos, self.qvel))[1].max())

    @property
    def peak_rate(self) -> float:
        """Largest joint rate relative to the limit of its joint."""
        return np.inf if self.diverged else float((np.abs(self.qvel[..., 6:]) / self.robot.rate_limit).max())

    @property
    def stop_distance(self) -> float:
        """Least distance of a joint from the end of its range, rad; negative beyond it."""
        if self.diverged:
            return -np.inf
        angles, ends = self.qpos[..., 7:], self.robot.joint_range
        return float(np.minimum(angles - ends[:, 0], ends[:, 1] - angles).min())

    @property
    def attitude(self) -> Array:
        """Angle (N, T + 1) of the satellite from its attitude at the start, rad."""
        return angle_between(self.qpos[..., 3:7], self.qpos[:, :1, 3:7])


def start_at_rest(robot: Robot, n: int) -> tuple[Array, Array]:
    """Joint angles and rates (n, joints) of n robots at home, at rest."""
    position = np.tile(robot.home, (n, 1))
    return position, np.zeros_like(position)


def fast_starts(robot: Robot, n: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """Joint angles and rates (n, joints) as near to the ends of the ranges, and as fast, as drives can brake.

    Every third start has joints anywhere in their ranges.
    """
    limits, shape = robot.joint_range, (n, robot.n_joints)
    middle = np.maximum(0.5 * (limits[:, 1] - limits[:, 0]) - STOP_MARGIN, 0.0)
    anywhere = (np.arange(n) % 3 == 0)[:, None]
    room = np.minimum(rng.uniform(0.0, np.where(anywhere, 2.0 * middle, 1.3), shape), middle)
    upper = rng.random(shape) < 0.5
    position = np.where(upper, limits[:, 1] - STOP_MARGIN - room, limits[:, 0] + STOP_MARGIN + room)
    stops = JointStops(robot)
    low, high = stops.rates(position)
    velocity = np.where(upper, high, low) * (1.0 - 1e-9)
    load = braking_shares(_at(robot, position, velocity), stops).max(axis=1, keepdims=True)
    return position, velocity * np.minimum(np.sqrt(BRAKING_SHARE / load), 1.0)


def _at(robot: Robot, position: Array, velocity: Array) -> Simulation:
    """Simulations of a robot at joint angles and rates (n, joints), with the total momentum zero."""
    simulation = Simulation(robot_model(robot, SceneOptions(0.01)), len(position))
    simulation.joint_position[:], simulation.joint_velocity[:] = position, velocity
    simulation.set_base_velocity(np.arange(len(position)))
    simulation.refresh()
    return simulation


def full_strokes(size: int, n: int, period: float, steps: int, rng: np.random.Generator) -> Iterable[Array]:
    """Actions (n, size) of -1 and 1, held as `HOLDS` says; half of the rows reverse, half draw others."""
    hold = np.maximum(1, np.rint(np.resize(HOLDS, n) / period)).astype(int)
    reverses = (np.arange(n) // len(HOLDS) % 2 == 0)[:, None]
    action = np.zeros((n, size))
    for step in range(steps):
        drawn = np.sign(rng.uniform(-1.0, 1.0, action.shape))
        following = np.where(reverses & (step > 0), -action, drawn)
        action = np.where((step % hold == 0)[:, None], following, action)
        yield action


class ControlledRobot:
    """N simulations of a robot under a control mode, without a task.

    Attributes:
        simulation: N simulations. drive: joint drives. mode: control mode.
    """

    def __init__(self, robot: Robot, n: int, settings: SimulationSettings) -> None:
        self.robot = robot
        self.simulation = Simulation(robot_model(robot, SceneOptions(settings.timestep)), n)
        self.drive = Drive(self.simulation, settings.control_period, robot)
        self.mode = MODES[settings.mode](self.drive)
        self._substeps = round(settings.control_period / settings.timestep)

    def reset(self, position: Array, velocity: Array) -> None:
        """Start all simulations at joint angles and rates (N, n), with the total momentum zero."""
        rows, simulation = np.arange(self.simulation.n), self.simulation
        simulation.reset(rows)
        simulation.joint_position[:], simulation.joint_velocity[:] = position, velocity
        simulation.set_base_velocity(rows)
        simulation.refresh()
        self.drive.reset(rows)

    def run(self, actions: Iterable[Array]) -> RobotMotion:
        """The motion under actions (N, m) in [-1, 1], one for each control period."""
        simulation = self.simulation
        states, torques, diverged = [simulation.robot_state()], [], False
        for action in actions:
            self.drive.begin()
            simulation.ctrl[:] = self.mode.torques(action)
            simulation.step(self._substeps)
            states.append(simulation.robot_state())
            torques.append(simulation.ctrl.copy())
            if diverged := bool(simulation.warned()):
                break
        qpos, qvel = (np.stack(part, axis=1) for part in zip(*states, strict=True))
        return RobotMotion(self.robot, qpos, qvel, np.stack(torques, axis=1), diverged)


def full_range_motion(
    robot: Robot, settings: SimulationSettings, seconds: float, n: int, seed: int = 0
) -> RobotMotion:
    """Motion of n robots under full strokes, a third of them from home, the others from fast starts."""
    rng = np.random.default_rng(seed)
    at_rest = -(-n // 3)
    starts = zip(start_at_rest(robot, at_rest), fast_starts(robot, n - at_rest, rng), strict=True)
    controlled = ControlledRobot(robot, n, settings)
    controlled.reset(*(np.concatenate(part) for part in starts))
    steps = max(1, round(seconds / settings.control_period))
    with _unlogged():
        return controlled.run(full_strokes(controlled.mode.size, n, settings.control_period, steps, rng))


@contextmanager
def _unlogged() -> Iterator[None]:
    """MuJoCo does not print or write that a simulation is unstable: that is what is found out."""
    before = mujoco.MjLogConfig.get()
    silent = copy(before)
    silent.logto_console = silent.logto_file = False
    silent.set()
    try:
        yield
    finally:
        before.set()
