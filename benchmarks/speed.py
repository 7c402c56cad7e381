"""Environment steps per second, and the time that the environment adds to the bare simulation.

The simulation alone (`Batch.step` of the same states, the same number of substeps, sensors current) is the
physical limit, measured in the same run. With --reference, FetchReach-v4 of gymnasium-robotics is measured
alternately, with the interpreter of another virtual environment:

    python3 -m venv fetch && fetch/bin/pip install gymnasium-robotics mujoco==3.3.7
    python -m benchmarks.speed --reference fetch/bin/python
"""

import argparse
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from time import perf_counter
from typing import Any

import gymnasium as gym
import numpy as np
from tqdm import tqdm

from agents.commands.choice import fitting_ids
from agents.commands.robots import add_robot, robot_keywords, robot_words
from benchmarks.arguments import executable, whole
from benchmarks.machine import machine_class, markdown_table, verdict
from space_envs.control import CONTROL_MODES
from space_envs.envs import CaptureEnv, CaptureVectorEnv
from space_envs.registration import ENTRIES, find
from space_envs.system.command_line import Parser, exit_status

SIZES = (1, 16, 64, 256)
SECONDS = 1.0  # of each measurement
# N, most us that may be added to an env step in every control mode, and the ids: in words, by number of arms.
AIMS = ((1, 150.0, "one arm", {1}), (256, 8.0, "one or two arms", {1, 2}))
REFERENCE = """
import time, gymnasium as gym, gymnasium_robotics
gym.register_envs(gymnasium_robotics)
env = gym.make("FetchReach-v4")
env.action_space.seed(0)
actions = [env.action_space.sample() for _ in range(100)]
def play(seconds):
    env.reset(seed=0)
    steps, start = 0, time.perf_counter()
    while time.perf_counter() - start < seconds:
        *_, terminated, truncated, _ = env.step(actions[steps % 100])
        steps += 1
        if terminated or truncated:
            env.reset()
    return steps / (time.perf_counter() - start)
play(0.5)
print(play(SECONDS))
"""


def rate(step, seconds: float) -> float:
    """Calls of `step` per second."""
    calls, start = 0, perf_counter()
    while (elapsed := perf_counter() - start) < seconds:
        step()
        calls += 1
    return calls / elapsed


def short(env_id: str) -> str:
    """An id without its namespace."""
    return env_id.partition("/")[2]


def vector_rates(
    env_id: str, n: int, mode: str, seconds: float, robot: Mapping[str, Any]
) -> tuple[float, float]:
    """Calls per second of the vector environment's step and of the simulation alone.

    Their calls alternate and the median call counts, so that other load on the machine affects both alike.

    Args:
        robot: keywords of the task that choose it.
    """
    threads = 1 if n == 1 else 2
    env = CaptureVectorEnv(env_id, n, mode, "next_step", threads=threads, **robot)
    rng = np.random.default_rng(0)
    env.task.goals("train", np.arange(env.task.split_size("train")))  # drawn once a process, as in training
    env.reset(seed=0)
    actions = rng.uniform(-1, 1, (64, *env.action_space.shape))
    simulation, substeps = env.simulation, env.task.substeps
    durations: tuple[list[float], list[float]] = ([], [])
    start = perf_counter()
    while perf_counter() - start < seconds or len(durations[0]) < 20:
        action = actions[len(durations[0]) % 64]
        before = perf_counter()
        env.step(action)
        between = perf_counter()
        simulation.ctrl[:] = 0.0
        simulation.step(substeps)
        durations[0].append(between - before)
        durations[1].append(perf_counter() - between)
    return float(1 / np.median(durations[0][10:])), float(1 / np.median(durations[1][10:]))


def single_rate(env_id: str, seconds: float, robot: Mapping[str, Any]) -> float:
    """Steps per second of the environment that `gym.make` returns, including resets.

    Args:
        robot: keywords of the task that choose it.
    """
    env = gym.make(env_id, **robot)
    assert isinstance(env.unwrapped, CaptureEnv)
    env.unwrapped.task.goals("train", np.arange(env.unwrapped.task.split_size("train")))
    env.reset(seed=0)
    size = env.unwrapped.task.mechanics.n_joints
    actions = np.random.default_rng(0).uniform(-1, 1, (100, size))
    count = iter(range(10**9))

    def step() -> None:
        *_, terminated, truncated, _ = env.step(actions[next(count) % 100])
        if terminated or truncated:
            env.reset()

    rate(step, 0.5)
    return rate(step, seconds)


def aims(added: Mapping[tuple[str, str, int], float]) -> str:
    """A sentence for each goal: the largest added time, and whether it is met.

    Args:
        added: us per env step, by id, control mode and N.
    """
    sentences = []
    for n, most, words, arms in AIMS:
        cells = {(short(env), mode): us for (env, mode, size), us in added.items() if size == n}
        fitting = {short(env) for env, _, _ in added if find(env).make({}).arms in arms}
        cells = {cell: us for cell, us in cells.items() if cell[0] in fitting}
        env_id, mode = worst = max(cells, key=lambda cell: cells[cell])
        within = sum(us <= most for us in cells.values())
        sentences.append(
            f"At N = {n} with {words}: at most {cells[worst]:.1f} us added "
            f"({env_id}, {mode}), goal at most {most:g} us, {verdict(cells[worst], most)}; "
            f"{within} of {len(cells)} rows are within it."
        )
    return "\n".join(sentences)


def reference_rate(python: Path) -> float:
    """Steps per second of FetchReach-v4 in another interpreter."""
    code = REFERENCE.replace("SECONDS", str(SECONDS))
    done = subprocess.run([python, "-c", code], capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def main(arguments: list[str] | None = None) -> None:
    """Print the tables of docs/speed.md."""
    parser = Parser(
        prog="python -m benchmarks.speed",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--rounds",
        type=whole,
        default=5,
        help="seconds for each cell and rounds of the comparison (default 5)",
    )
    parser.add_argument(
        "--reference", type=executable, help="python with gymnasium-robotics, to compare FetchReach-v4"
    )
    add_robot(parser.add_argument)
    options = parser.parse_args(arguments)
    robot = robot_keywords(options)
    env_ids = fitting_ids(list(ENTRIES), robot)
    rows, overhead = [], {}
    cells = [(env_id, mode, n) for env_id in env_ids for mode in CONTROL_MODES for n in SIZES]
    for env_id, mode, n in tqdm(cells, unit="cell"):
        env, batch = vector_rates(env_id, n, mode, options.rounds * SECONDS, robot)
        overhead[env_id, mode, n] = added = 1e6 / n * (1 / env - 1 / batch)
        figures = f"{n * env:,.0f}", f"{n * batch:,.0f}", f"{added:.1f}", f"{env / batch:.2f}"
        rows.append([short(env_id), mode, str(n), *figures])
    header = [
        "id",
        "control mode",
        "N",
        "env steps/s",
        "simulation alone, steps/s",
        "added, us per env step",
        "share of limit",
    ]
    print(f"\nVector environment{robot_words(robot)}, 2 threads for N > 1; medians; {machine_class()}\n")
    print(markdown_table(header, rows))
    if not robot:  # the aims are those of the id's own robot
        print(f"\n{aims(overhead)}")
    if options.reference is None:
        return
    found: dict[str, list[float]] = {}
    for _ in tqdm(range(options.rounds), unit="round"):
        found.setdefault("FetchReach-v4, gym.make", []).append(reference_rate(options.reference))
        for env_id in env_ids:
            name = short(env_id)
            found.setdefault(f"{name}, gym.make", []).append(single_rate(env_id, SECONDS, robot))
            vector, _ = vector_rates(env_id, 256, "joint_velocity", SECONDS, robot)
            found.setdefault(f"{name}, gym.make_vec, N = 256", []).append(256 * vector)
    rates = {name: float(np.median(each)) for name, each in found.items()}
    base = next(iter(rates.values()))
    print("\nComparison, env steps per second (medians):\n")
    compared = [[name, f"{rate:,.0f}", f"{rate / base:.3g}"] for name, rate in rates.items()]
    print(markdown_table(["environment", "env steps/s", "ratio"], compared))


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.speed", main))
