"""Robots and episodes that always last until their horizon, for benchmarks of the simulation."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.registration import make_task
from space_envs.robots.check.figures.goals import task_of
from space_envs.robots.robot import StepLimits
from space_envs.robots.zoo import find_robot
from space_envs.step_limits.measured import measured_steps


class SimulatedRobot(NamedTuple):
    """A simulated robot: its name in tables, the environment's id and keywords."""

    name: str
    env_id: str
    keywords: dict[str, Any]


ROBOTS = (
    SimulatedRobot("single arm, paper", "SpaceCapture/SingleArm-v0", {"variant": "paper"}),
    SimulatedRobot("single arm, physical", "SpaceCapture/SingleArm-v0", {"variant": "physical"}),
    SimulatedRobot("dual arm, planar", "SpaceCapture/DualArmPlanar-v0", {}),
    SimulatedRobot("dual arm, spatial", "SpaceCapture/DualArmSpatial-v0", {}),
)

ROBOT_HELP = "robots by name or description file (default: the built-in ones of every id)"


def simulated_robots(sources: Sequence[str]) -> tuple[SimulatedRobot, ...]:
    """Robots by name or description file, each in the first task that takes it; the built-in ones for none.

    Raises:
        ConfigurationError: for an unknown name, a file that is not valid, or a robot for no task.
    """
    if not sources:
        return ROBOTS
    robots = [find_robot(source, measure=measured_steps) for source in sources]
    return tuple(SimulatedRobot(robot.name, task_of(robot), {"robot": robot}) for robot in robots)


class SimulatedMotion(NamedTuple):
    """Motion of E episodes: states (E, T + 1, ...) and torques.

    Attributes:
        qpos, qvel: of the robot, base first. torques: (E, T, n) N m.
        diverged: whether MuJoCo reported an unstable state, at which the motion ends.
    """

    qpos: Array
    qvel: Array
    torques: Array
    diverged: bool


def unlimited(robot: SimulatedRobot) -> SimulatedRobot:
    """The robot with control periods and time steps that its task refuses otherwise."""
    found = make_task(robot.env_id, robot.keywords).robot
    steps = StepLimits(found.steps.default_timestep, 0.1, 10.0)
    return robot._replace(keywords={"robot": replace(found, steps=steps)})


def environment(
    robot: SimulatedRobot, mode: str, episodes: int, seed: int, **keywords: Any
) -> CaptureVectorEnv:
    """Environment at the start of episodes that always last until their horizon.

    Args:
        keywords: of the task.
    """
    env = CaptureVectorEnv(
        robot.env_id,
        num_envs=episodes,
        autoreset_mode="disabled",
        control_mode=mode,
        attitude_limit=179.9,
        hold_time=1e3,
        collisions=False,
        **robot.keywords,
        **keywords,
    )
    env.reset(seed=seed)
    return env


def held_actions(
    shape: tuple[int, ...], steps: int, hold: NDArray[np.int64], following: Callable[[int, Array], Array]
) -> Iterator[Array]:
    """Actions (E, m) of successive control steps, each held for `hold` (E,) steps.

    Args:
        following: number of a step and the actions before it -> the actions that follow, where one ends.
    """
    action = np.zeros(shape)
    for step in range(steps):
        action = np.where((step % hold == 0)[:, None], following(step, action), action)
        yield action


def simulate(env: CaptureVectorEnv, actions: Iterable[Array]) -> SimulatedMotion:
    """The motion of the robot under actions (E, m), one for each control step."""
    simulation, torques, diverged = env.simulation, [], False
    states = [simulation.robot_state()]
    for action in actions:
        env.step(action)
        torques.append(simulation.ctrl.copy())
        states.append(simulation.robot_state())
        if diverged := bool(simulation.warned()):
            break
    qpos, qvel = (np.stack(part, axis=1) for part in zip(*states, strict=True))
    return SimulatedMotion(qpos, qvel, np.stack(torques, axis=1), diverged)
