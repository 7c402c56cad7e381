"""Momentum drift, trajectory error and speed of the simulation against its time step, for every robot.

Random actions are held for 0.1, 0.5, 2 or 3 s, a different time in successive episodes; the second half of
each episode uses full-scale actions only, which bring the arm to full speed and to its joint limits.
The error is that of the base after the same torques, against a run with a quarter of the smallest step.
"""

import sys
from collections.abc import Iterator
from time import perf_counter
from typing import NamedTuple

import numpy as np
from tqdm import tqdm

from benchmarks.arguments import seed, whole
from benchmarks.machine import machine_class, markdown_table
from benchmarks.simulated import (
    ROBOT_HELP,
    SimulatedRobot,
    environment,
    held_actions,
    simulate,
    simulated_robots,
    unlimited,
)
from space_envs.control import CONTROL_MODES
from space_envs.dynamics.bodies import body_motion, momentum_drift
from space_envs.dynamics.rotations import Array, angle_between
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import SpaceEnvsError
from space_envs.registration import make_task
from space_envs.simulation import Simulation
from space_envs.system.command_line import Parser, exit_status

STEPS = (0.005, 0.01, 0.02, 0.05)
REFERENCE = 0.00125
HOLDS = (1, 5, 20, 30)  # control steps for which actions are held; episodes cycle through them


class ModeResult(NamedTuple):
    """Episodes of one control mode.

    Attributes:
        drift: largest, N s or N m s. ratio: largest drift relative to the largest momentum of a body.
        start: (E, n) joint angles, rad. torques: (E, T, n) N m.
    """

    drift: float
    ratio: float
    start: np.ndarray
    torques: np.ndarray


def random_actions(env: CaptureVectorEnv, seed: int) -> Iterator[Array]:
    """Actions (E, m) of successive control steps."""
    rng, hold = np.random.default_rng(seed), np.resize(HOLDS, env.num_envs)
    shape, steps = env.action_space.shape, env.task.horizon
    held = held_actions(shape, steps, hold, lambda step, before: rng.uniform(-1.0, 1.0, shape))
    for step, action in enumerate(held):
        yield np.sign(action) if 2 * step >= steps else action


def run(robot: SimulatedRobot, mode: str, timestep: float, episodes: int, seed: int) -> ModeResult:
    """Momentum drift, start and torques of whole episodes under random actions.

    Raises:
        SpaceEnvsError: if the simulation diverges.
    """
    env = environment(robot, mode, episodes, seed, timestep=timestep)
    motion = simulate(env, random_actions(env, seed))
    if motion.diverged:
        raise SpaceEnvsError(
            f"{robot.name}, {mode}: the simulation diverges at a time step of {timestep:g} s"
        )
    absolute, ratio = momentum_drift(body_motion(env.task.mechanics, motion.qpos, motion.qvel))
    return ModeResult(float(absolute.max()), float(ratio.max()), motion.qpos[:, 0, 7:], motion.torques)


def replay(robot: SimulatedRobot, timestep: float, given: ModeResult) -> tuple[np.ndarray, np.ndarray, float]:
    """Base position and quaternion after 10 s of given torques; control steps per second on all threads."""
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
    parser.add_argument("--robot", nargs="+", default=[], metavar="NAME|FILE", help=ROBOT_HELP)
    options = parser.parse_args(arguments)
    robots = simulated_robots(options.robot)
    rows = []
    references: dict[str, tuple[ModeResult, np.ndarray, np.ndarray]] = {}
    for robot, timestep in tqdm([(r, t) for r in robots for t in STEPS], unit="cell"):
        tried = unlimited(robot)
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
