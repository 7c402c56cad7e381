"""Time of eq. 20 costs of 100 trajectories of 100 points, on one core: `python benchmarks/attitude_cost.py`."""

import argparse
import os
import platform
import time
from collections.abc import Callable
from pathlib import Path

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ[_variable] = "1"  # before numpy is imported

import casadi
import mujoco
import numpy as np

from space_envs.dynamics import FloatingRobot, attitude_cost, base_twist, minimum_jerk, trajectory_cost
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.models.single_arm import single_arm_model

TARGET = 10.0  # ms


def best_time(function: Callable[[], object], repeats: int) -> float:
    """Shortest of some runs, ms: the one that other work on the machine disturbed least."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        function()
        times.append(time.perf_counter() - start)
    return 1e3 * min(times)


def physical_limit(robot: FloatingRobot, samples: int, repeats: int) -> float:
    """Time, ms, that this core needs for the arithmetic alone, measured now.

    The kernel's additions, products and divisions at the rate of a matrix product, which is the most that the
    core can do, and its sines and cosines at numpy's rate over a contiguous array.
    """
    factor = np.random.default_rng(0).normal(size=(500, 500))
    per_operation = best_time(lambda: factor @ factor, repeats) / (2 * 500**3)
    trigonometric = 2 * robot.n_joints
    function = SymbolicRobot(robot).base_twist
    arithmetic = function.n_instructions() - function.nnz_in() - function.nnz_out() - trigonometric
    angles = np.linspace(-3.0, 3.0, samples * robot.n_joints)
    waves = best_time(lambda: (np.sin(angles), np.cos(angles)), repeats)
    return samples * arithmetic * per_operation + waves


def mujoco_time(q: np.ndarray, repeats: int) -> float:
    """Time, ms, in which MuJoCo computes the mass matrix at every configuration, called from Python."""
    model = single_arm_model()
    data = mujoco.MjData(model)

    def run() -> None:
        for row in q.reshape(-1, q.shape[-1]):
            data.qpos[7:] = row
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_makeM(model, data)

    return best_time(run, repeats)


def machine() -> str:
    """Processor, cores and versions in one line."""
    processor = platform.processor() or platform.machine()
    if Path("/proc/cpuinfo").exists():
        lines = Path("/proc/cpuinfo").read_text().splitlines()
        processor = next(
            (line.split(":")[1].strip() for line in lines if line.startswith("model name")), processor
        )
    return (
        f"{processor}, {os.cpu_count()} cores (one used), {platform.system()}; Python {platform.python_version()}, "
        f"numpy {np.__version__}, casadi {casadi.__version__}, mujoco {mujoco.__version__}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--trajectories", type=int, default=100)
    parser.add_argument("--points", type=int, default=100)
    parser.add_argument("--repeats", type=int, default=50, help="the best of so many runs is printed")
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})

    robot = FloatingRobot.from_model(single_arm_model())
    goals = robot.home + np.random.default_rng(0).uniform(-1.0, 1.0, (options.trajectories, robot.n_joints))
    q, qdot, dt = minimum_jerk(robot.home, goals, 10.0, options.points)
    start = time.perf_counter()
    base_twist(robot, q[:1], qdot[:1])
    first = time.perf_counter() - start

    samples, repeats = options.trajectories * options.points, options.repeats
    limit = physical_limit(robot, samples, repeats)
    few = max(repeats // 10, 3)
    compiled = best_time(lambda: trajectory_cost(robot, q, qdot, dt), repeats)
    rows = {
        "limit: the arithmetic alone": limit,
        "compiled (the default)": compiled,
        "numpy (no compiler)": best_time(lambda: attitude_cost(robot.base_twist(q, qdot), dt), few),
        "MuJoCo's mass matrices only": mujoco_time(q, few),
    }
    print(f"Eq. 20 costs of {options.trajectories} trajectories of {options.points} points.\n\n{machine()}\n")
    print("| way | ms | microseconds a point | times the limit |\n| --- | --- | --- | --- |")
    for name, duration in rows.items():
        print(f"| {name} | {duration:.2f} | {1e3 * duration / samples:.3f} | {duration / limit:.1f} |")
    difference = np.abs(base_twist(robot, q, qdot) - robot.base_twist(q, qdot)).max()
    print(
        f"\nFirst call, which compiles or loads: {first:.2f} s. Largest difference of twists: {difference:.1e}."
    )
    if (options.trajectories, options.points) == (100, 100):
        print(f"Target {TARGET:.0f} ms: {'met' if compiled <= TARGET else 'missed'}.")


if __name__ == "__main__":
    main()
