"""Momentum drift, trajectory error and speed of the simulation against its time step, for every robot.

Random actions are held for 0.1, 0.5, 2 or 3 s, by episode in turn; the second half of each episode uses full
strokes only, which bring the arm to full speed and to its stops.
The error is that of the base after the same torques, against a run with a quarter of the smallest step.
"""

import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from time import perf_counter
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

from benchmarks.arguments import seed, whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.control import CONTROL_MODES
from space_envs.dynamics.bodies import body_motion, momentum_drift
from space_envs.dynamics.rotations import Array, angle_between
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import SpaceEnvsError
from space_envs.registration import ENTRIES, make_task, register, unregister
from space_envs.robots.parameters import VARIANTS
from space_envs.simulation import Simulation
from space_envs.system.command_line import Parser, exit_status


class Robot(NamedTuple):
    """A robot as it is simulated: the environment's id and keywords."""

    name: str
    env_id: str
    keywords: dict[str, Any]


ROBOTS = (
    *(Robot(f"single arm, {v}", "SpaceCapture/SingleArm-v0", {"variant": v}) for v in VARIANTS),
    Robot("dual arm, planar", "SpaceCapture/DualArmPlanar-v0", {}),
    Robot("dual arm, spatial", "SpaceCapture/DualArmSpatial-v0", {}),
)
STEPS = (0.005, 0.01, 0.02, 0.05)
REFERENCE = 0.00125
HOLDS = (1, 5, 20, 30)  # control steps that an action is held, by episode in turn


class Run(NamedTuple):
    """Episodes of one control mode.

    Attributes:
        drift: largest, N s or N m s. ratio: largest, to what a body carried.
        start: (E, n) joint angles, rad. torques: (E, T, n) N m.
    """

    drift: float
    ratio: float
    start: np.ndarray
    torques: np.ndarray


class Motion(NamedTuple):
    """Episodes in states (E, T + 1, ...) and what drove them.

    Attributes:
        qpos, qvel: of the robot, base first. torques: (E, T, n) N m.
        diverged: whether MuJoCo warned of a state; the motion ends there.
    """

    qpos: Array
    qvel: Array
    torques: Array
    diverged: bool


@contextmanager
def unlimited(robot: Robot) -> Iterator[Robot]:
    """The robot under an id of its own, for control periods and time steps that its task would refuse."""
    task = ENTRIES[robot.env_id].task
    limits = {"largest_control_period": 10.0, "largest_timestep": 0.1}
    env_id = robot.env_id.replace("-v", "Unlimited-v")
    register(env_id, type(f"Unlimited{task.__name__}", (task,), limits))
    try:
        yield robot._replace(env_id=env_id)
    finally:
        unregister(env_id)


def environment(robot: Robot, mode: str, episodes: int, seed: int, **keywords: Any) -> CaptureVectorEnv:
    """Episodes at their start, that nothing ends before their horizon.

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


def simulate(env: CaptureVectorEnv, actions: Iterable[Array]) -> Motion:
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
    return Motion(qpos, qvel, np.stack(torques, axis=1), diverged)


def random_actions(env: CaptureVectorEnv, seed: int) -> Iterator[Array]:
    """Actions (E, m) of one control step after the other."""
    rng, hold = np.random.default_rng(seed), np.resize(HOLDS, env.num_envs)
    action = np.zeros(env.action_space.shape)
    for step in range(env.task.horizon):
        drawn = rng.uniform(-1.0, 1.0, action.shape)
        action = np.where((step % hold == 0)[:, None], drawn, action)
        yield np.sign(action) if 2 * step >= env.task.horizon else action


def run(robot: Robot, mode: str, timestep: float, episodes: int, seed: int) -> Run:
    """Whole episodes under random actions.

    Raises:
        SpaceEnvsError: if the simulation diverges.
    """
    env = environment(robot, mode, episodes, seed, timestep=timestep)
    motion = simulate(env, random_actions(env, seed))
    if motion.diverged:
        raise SpaceEnvsError(
            f"{robot.name}, {mode}: the simulation diverges at a time step of {timestep:g} s"
        )
    absolute, ratio = momentum_drift(body_motion(env.task.robot, motion.qpos, motion.qvel))
    return Run(float(absolute.max()), float(ratio.max()), motion.qpos[:, 0, 7:], motion.torques)


def replay(robot: Robot, timestep: float, given: Run) -> tuple[np.ndarray, np.ndarray, float]:
    """Base position and quaternion after 10 s of given torques, and control steps a second on all threads."""
    task = make_task(robot.env_id, {**robot.keywords, "timestep": timestep})
    episodes = len(given.torques)
    simulation = Simulation(task.model, episodes, threads=None)
    simulation.reset(np.arange(episodes))
    simulation.joint_position[:] = given.start
    steps = round(10.0 / task.control_period)
    before = perf_counter()
    for step in range(steps):
        simulation.ctrl[:] = given.torques[:, step]
        simulation.step(round(task.control_period / timestep))
    rate = steps * episodes / (perf_counter() - before)
    qpos, _ = simulation.robot_state()
    return qpos[:, :3], qpos[:, 3:7], rate


def main(arguments: list[str] | None = None) -> None:
    """Print the tables of docs/momentum.md."""
    parser = Parser(prog="python -m benchmarks.momentum", description=__doc__)
    parser.add_argument("--episodes", type=whole, default=64, help="episodes for each cell (default 64)")
    parser.add_argument("--seed", type=seed, default=0, help="of actions and goals (default 0)")
    options = parser.parse_args(arguments)
    rows = []
    references: dict[str, tuple[Run, np.ndarray, np.ndarray]] = {}
    for robot, timestep in tqdm([(r, t) for r in ROBOTS for t in STEPS], unit="cell"):
        with unlimited(robot) as tried:
            results = {m: run(tried, m, timestep, options.episodes, options.seed) for m in CONTROL_MODES}
            if robot.name not in references:
                given = results["joint_velocity"]
                references[robot.name] = (given, *replay(tried, REFERENCE, given)[:2])
            given, position, quaternion = references[robot.name]
            got_position, got_quaternion, rate = replay(tried, timestep, given)
        error = 1e3 * np.linalg.norm(got_position - position, axis=1).max()
        angle = np.rad2deg(angle_between(got_quaternion, quaternion)).max()
        rows.append(
            [robot.name, f"{1e3 * timestep:g}"]
            + [f"{results[m].ratio:.1e}" for m in CONTROL_MODES]
            + [
                f"{max(r.drift for r in results.values()):.1e}",
                f"{error:.1e}",
                f"{angle:.1e}",
                f"{rate:,.0f}",
            ]
        )
    print(
        f"\n{options.episodes} whole episodes a control mode (20 s with one arm, 30 s with two), "
        f"seed {options.seed}; {machine_class()}\n"
    )
    header = [
        "robot",
        "step, ms",
        *CONTROL_MODES,
        "largest drift, N s or N m s",
        "base error, mm",
        "base error, deg",
    ]
    print(markdown_table([*header, "control steps/s"], rows))


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.momentum", main))
