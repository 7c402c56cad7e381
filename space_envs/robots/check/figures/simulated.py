"""Figures of a robot in simulation: momentum, drives, tracking and attitude."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from space_envs.control import CONTROL_MODES
from space_envs.dynamics import minimum_jerk, roll_out_base
from space_envs.dynamics.rotations import Array, angle_between
from space_envs.robots.models.mechanics import robot_mechanics
from space_envs.robots.robot import Robot
from space_envs.step_limits.motions import (
    ControlledRobot,
    SimulationSettings,
    full_range_motion,
    start_at_rest,
)
from space_envs.tasks.robots import usual_period

EPISODES, SECONDS = 10, 20.0
MOTION, FINE = 10.0, 10  # s of a tracked motion; steps of its momentum-level model in a control period
_SHARE = 0.8  # of the rate and acceleration limits that a tracked motion uses at most


@dataclass(frozen=True)
class ModeFigures:
    """Full-range motions in a control mode, with the largest time step and control period.

    Attributes:
        drift: of total momentum, relative to the largest momentum of a body. rate: largest joint rate
            relative to its limit. distance: least, of a joint from the end of its range, rad.
    """

    mode: str
    drift: float
    rate: float
    distance: float


@dataclass(frozen=True)
class TrackingFigures:
    """Minimum-jerk motions of the joints, simulated, against commands and the momentum-level model.

    Attributes:
        rate: largest error of a joint rate, relative to the largest of its motion.
        position, angle: largest error of the satellite, m and rad. torque: largest, relative to its limit.
    """

    rate: float
    position: float
    angle: float
    torque: float


@dataclass(frozen=True)
class AttitudeFigures:
    """Largest angle of the satellite under random actions, rad, in modes reactionless and joint_velocity."""

    reactionless: float
    joint_velocity: float


def mode_figures(robot: Robot, seed: int = 0) -> tuple[ModeFigures, ...]:
    """Figures of each control mode."""
    found = []
    for mode in CONTROL_MODES:
        settings = SimulationSettings(mode, robot.steps.largest_control_period, robot.steps.largest_timestep)
        motion = full_range_motion(robot, settings, SECONDS, EPISODES, seed)
        found.append(ModeFigures(mode, motion.drift, motion.peak_rate, motion.stop_distance))
    return tuple(found)


def tracking(robot: Robot, seed: int = 1) -> TrackingFigures:
    """Tracking of minimum-jerk motions from home, each joint to a random angle within 1 rad."""
    period = usual_period(robot.steps)
    steps = round(MOTION / period)
    duration = steps * period
    start, _ = start_at_rest(robot, EPISODES)
    goal = start + _displacements(robot, np.random.default_rng(seed))
    _, rates, _ = minimum_jerk(start, goal, duration, steps + 1)
    controlled = ControlledRobot(
        robot, EPISODES, SimulationSettings("joint_velocity", period, robot.steps.default_timestep)
    )
    controlled.reset(start, np.zeros_like(start))
    motion = controlled.run(rates[:, 1:].swapaxes(0, 1) / robot.rate_limit)
    fine_q, fine_rates, dt = minimum_jerk(start, goal, duration, FINE * steps + 1)
    position, quaternion = roll_out_base(robot_mechanics(robot), fine_q, fine_rates, dt)
    peak = np.abs(rates).max(axis=(1, 2), keepdims=True)
    return TrackingFigures(
        float((np.abs(motion.qvel[..., 6:] - rates) / peak).max()),
        float(np.linalg.norm(motion.qpos[..., :3] - position[:, ::FINE], axis=-1).max()),
        float(angle_between(motion.qpos[..., 3:7], quaternion[:, ::FINE]).max()),
        float((np.abs(motion.torques) / robot.torque_limit).max()),
    )


def attitude(robot: Robot, seed: int = 2) -> AttitudeFigures:
    """Largest angles of the satellite under random actions from home."""
    peaks = {}
    for mode in ("reactionless", "joint_velocity"):
        controlled = ControlledRobot(
            robot, EPISODES, SimulationSettings(mode, usual_period(robot.steps), robot.steps.default_timestep)
        )
        controlled.reset(*start_at_rest(robot, EPISODES))
        actions = _random_actions(controlled, np.random.default_rng(seed))
        peaks[mode] = float(controlled.run(actions).attitude.max())
    return AttitudeFigures(**peaks)


def _displacements(robot: Robot, rng: np.random.Generator) -> Array:
    """Displacements (E, n) of joints that their ranges, rates and accelerations allow, rad."""
    room = np.abs(robot.joint_range - robot.home[:, None]).min(axis=1) - 0.3
    # A minimum-jerk motion of unit displacement and duration has a rate of 1.875 and an acceleration of 5.77.
    fast = _SHARE * np.minimum(robot.rate_limit * MOTION / 1.875, robot.acceleration_limit * MOTION**2 / 5.77)
    largest = np.clip(np.minimum(room, fast), 0.0, 1.0)
    return rng.uniform(-1.0, 1.0, (EPISODES, robot.n_joints)) * largest


def _random_actions(controlled: ControlledRobot, rng: np.random.Generator) -> Iterator[Array]:
    """Random actions (E, m), held for 0.5 s, at full scale in the second half."""
    period = controlled.drive.control_period
    steps, hold = round(SECONDS / period), max(1, round(0.5 / period))
    action = np.zeros((EPISODES, controlled.mode.size))
    for step in range(steps):
        if step % hold == 0:
            action = rng.uniform(-1.0, 1.0, action.shape)
        yield np.sign(action) if 2 * step >= steps else action
