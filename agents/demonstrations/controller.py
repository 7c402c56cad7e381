"""Demonstrations of shyam2020, sec. IV: motions of the linear-quadratic controller, varied in three ways."""

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from agents.demonstrations.elastic_bands import (
    BandObstacles,
    Detour,
    end_effector_path,
    joint_detour,
    task_detour,
)
from agents.demonstrations.variations import (
    KINDS,
    DemonstratorConfig,
    VariationDraws,
    draw,
    sideways_direction,
)
from agents.planners.common.damped_search import JointGoals, Rows
from agents.planners.common.inverse_kinematics import JointMotion, floating_inverse_kinematics
from agents.planners.common.linear_quadratic import closed_loop, receding_gains
from agents.policies.single_arm.mpc import CONTROL_WEIGHT, POSITION_WEIGHT
from agents.policies.single_arm.reaching import motion_duration
from space_envs.drives import STOP_MARGIN
from space_envs.dynamics import FloatingRobot, trajectory_cost
from space_envs.dynamics.rotations import Array
from space_envs.errors import PlanningError
from space_envs.robots.robot import Robot
from space_envs.tasks.single_arm import SPLIT_SIZE, SingleArmTask

ATTEMPTS = 40  # attempts to draw one demonstration
STRIDE = 1597  # between the goals of successive groups; odd, so that all 4096 goals of the split are visited


@dataclass(frozen=True, eq=False)
class Demonstrations:
    """D motions of T samples, from home to goals of the train split.

    Attributes:
        time: (T,) s. position, velocity: (D, T, n) rad and rad/s.
        goal_index: (D,) in the train split. kind: (D,) index into KINDS. attempt: (D,) drawings that failed.
        position_residual, orientation_residual: (D,) m and rad, of the end-effector at the end.
        cost: (D,) eq. 20 times dt with c = 1 m/rad, m^2/s.
    """

    time: Array
    position: Array
    velocity: Array
    goal_index: NDArray[np.int64]
    kind: NDArray[np.int64]
    attempt: NDArray[np.int64]
    position_residual: Array
    orientation_residual: Array
    cost: Array


def demonstrate(
    robot: Robot, config: DemonstratorConfig, seed: int, first: int, count: int
) -> Demonstrations:
    """Demonstrations first ... first + count - 1 of a robot with one arm.

    Each depends on the robot, the config, the seed and its number only.

    Raises:
        PlanningError: if one cannot be drawn in `ATTEMPTS` attempts.
    """
    number = np.arange(first, first + count)
    parts: dict[int, tuple[Demonstrations, int]] = {}
    remaining = number
    for attempt in range(ATTEMPTS):
        tried, good = _attempt(robot, config, seed, remaining, attempt)
        for row in np.flatnonzero(good):
            parts[int(remaining[row])] = tried, int(row)
        remaining = remaining[~good]
        if remaining.size == 0:
            break
    else:
        raise PlanningError(
            f"demonstrations {remaining.tolist()} of seed {seed} failed {ATTEMPTS} times; vary them less"
        )

    def column(name: str) -> NDArray[Any]:
        return np.stack([getattr(part, name)[row] for part, row in (parts[int(i)] for i in number)])

    names = [field.name for field in fields(Demonstrations) if field.name != "time"]
    return Demonstrations(parts[first][0].time, **{name: column(name) for name in names})


def _attempt(
    robot: Robot, config: DemonstratorConfig, seed: int, number: NDArray[np.int64], attempt: int
) -> tuple[Demonstrations, NDArray[np.bool_]]:
    """Demonstrations by number, drawn for the attempt-th time, and whether each is one to learn from."""
    task = SingleArmTask(difficulty=config.difficulty, robot=robot)
    arm = task.mechanics
    time = np.arange(round(motion_duration(robot) / config.dt) + 1) * config.dt
    kind = number % len(KINDS)
    index = (number // config.per_goal * STRIDE) % SPLIT_SIZE["train"]
    goals = task.goals("train", index)
    draws = draw(config, seed, number, attempt, kind, time, arm.home)
    start = np.tile(arm.home, (len(number), 1))
    limits = arm.range + STOP_MARGIN * np.array([1.0, -1.0])

    gains, _ = receding_gains(draws.q, draws.r, time, draws.ramp)
    transition, response = closed_loop(gains, config.dt, draws.disturbance)
    # From rest: only the columns of the position count. (D, T, 2 n, n) and (D, T, 2 n).
    transition, response = transition.swapaxes(0, 1)[..., : arm.n_joints], response.swapaxes(0, 1)

    def motion_with(off: Detour | None, goal: Array, rows: Rows) -> JointMotion:
        offset = (start[rows] - goal)[:, None, :, None]
        x = (transition[rows] @ offset)[..., 0] + response[rows]
        q, qdot = x[..., : arm.n_joints] + goal[:, None, :], x[..., arm.n_joints :]
        if off is not None:
            q, qdot = q + off.position[rows], qdot + off.velocity[rows]
        return JointMotion(q, qdot, config.dt)

    def solve(off: Detour | None, initial: Array) -> JointGoals:
        base = np.zeros((len(number), 3)), np.tile([1.0, 0.0, 0.0, 0.0], (len(number), 1))
        return floating_inverse_kinematics(
            arm,
            goals.position,
            goals.quaternion,
            lambda goal, rows: motion_with(off, goal, rows),
            *base,
            initial,
            limits,
            draws.preferred,
        )

    # First the goal of the undisturbed motion, then the detour from it, then the goal with the detour.
    straight = solve(None, start).position
    off = _detour(config, arm, draws, start, straight, _progress(time))
    found = solve(off, straight)
    motion = motion_with(off, found.position, np.arange(len(number)))
    made = Demonstrations(
        time=time,
        position=motion.position,
        velocity=motion.velocity,
        goal_index=index,
        kind=kind,
        attempt=np.full(len(number), attempt),
        position_residual=found.position_residual,
        orientation_residual=found.orientation_residual,
        cost=trajectory_cost(arm, motion.position, motion.velocity, config.dt),
    )
    return made, found.converged & _usable(made, robot, limits, config)


def _detour(
    config: DemonstratorConfig,
    arm: FloatingRobot,
    draws: VariationDraws,
    start: Array,
    goal: Array,
    progress: Array,
) -> Detour:
    """Detours off the straight motions from start to goal (D, n), around an obstacle of the config's kind."""
    middle = start + draws.obstacle_phase[:, None] * (goal - start)
    if config.bands == "task":
        aside = draws.sphere_side / np.linalg.norm(draws.sphere_side, axis=1, keepdims=True)
        centre = end_effector_path(arm, middle) + config.sphere_offset * aside
        spheres = BandObstacles(centre, draws.sphere_radius)
        return task_detour(arm, start, goal, spheres, progress, config.dt)
    centre = middle + config.offset * sideways_direction(arm, middle, draws.obstacle_side)
    return joint_detour(start, goal, BandObstacles(centre, draws.obstacle_radius), progress, config.dt)


def _usable(
    made: Demonstrations, robot: Robot, limits: Array, config: DemonstratorConfig
) -> NDArray[np.bool_]:
    """Whether each is within the limits of angle, rate and acceleration, and at rest at the end."""
    acceleration = np.diff(made.velocity, axis=1) / config.dt
    inside = ((made.position >= limits[:, 0]) & (made.position <= limits[:, 1])).all(axis=(1, 2))
    slow = (np.abs(made.velocity) < robot.rate_limit).all(axis=(1, 2))
    gentle = (np.abs(acceleration) < robot.acceleration_limit).all(axis=(1, 2))
    resting = np.abs(made.velocity[:, -1]).max(axis=1) < config.rest
    return inside & slow & gentle & resting


def _progress(time: Array) -> Array:
    """Share (T,) of the displacement that the controller of policy `mpc` has made."""
    gains, _ = receding_gains(np.diag([POSITION_WEIGHT, 0.0]), np.array([[CONTROL_WEIGHT]]), time)
    transition, _ = closed_loop(gains, float(time[1]))
    return np.clip(1.0 - transition[:, 0, 0], 0.0, 1.0)
