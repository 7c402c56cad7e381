"""Time to compute the base disturbance (eq. 20) of 100 trajectories of 100 points on one core."""

import os
import sys
import time
import warnings
from collections.abc import Callable
from importlib.metadata import version

import mujoco
import numpy as np

from benchmarks.arguments import whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.dynamics import (
    FloatingRobot,
    NoCompiledCodeWarning,
    attitude_cost,
    base_twist,
    minimum_jerk,
    trajectory_cost,
)
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.robots.models import robot_mechanics, robot_model
from space_envs.robots.zoo import find_robot
from space_envs.system.command_line import Parser, exit_status

TARGET = 10.0  # ms
ROBOT = "shyam2020"


def best_time(function: Callable[[], object], repeats: int) -> float:
    """Shortest time of several runs, ms: the run that other work on the machine disturbed least."""
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
    # Matrices too small for numpy's library to use a second thread, large enough for its full rate.
    factors = np.random.default_rng(0).normal(size=(200, 60, 60))
    product = np.empty_like(factors)
    per_operation = best_time(lambda: np.matmul(factors, factors, out=product), repeats) / (200 * 2 * 60**3)
    trigonometric = 2 * robot.n_joints
    function = SymbolicRobot(robot).base_twist
    arithmetic = function.n_instructions() - function.nnz_in() - function.nnz_out() - trigonometric
    angles = np.linspace(-3.0, 3.0, samples * robot.n_joints)
    waves = best_time(lambda: (np.sin(angles), np.cos(angles)), repeats)
    return samples * arithmetic * per_operation + waves


def mujoco_time(q: np.ndarray, repeats: int) -> float:
    """Time, ms, in which MuJoCo computes the mass matrix at every configuration, called from Python."""
    model = robot_model(find_robot(ROBOT))
    data = mujoco.MjData(model)

    def run() -> None:
        for row in q.reshape(-1, q.shape[-1]):
            data.qpos[7:] = row
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_makeM(model, data)

    return best_time(run, repeats)


def main() -> None:
    parser = Parser(prog="python -m benchmarks.attitude_cost", description=__doc__)
    parser.add_argument("--trajectories", type=whole, default=100)
    parser.add_argument("--points", type=whole, default=100)
    parser.add_argument(
        "--repeats", type=whole, default=50, help="number of runs, of which the fastest is printed"
    )
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})

    robot = robot_mechanics(find_robot(ROBOT))
    goals = robot.home + np.random.default_rng(0).uniform(-1.0, 1.0, (options.trajectories, robot.n_joints))
    q, qdot, dt = minimum_jerk(robot.home, goals, 10.0, options.points)
    start = time.perf_counter()
    with warnings.catch_warnings(record=True) as lacking:
        warnings.simplefilter("always", NoCompiledCodeWarning)
        base_twist(robot, q[:1], qdot[:1])
    first = time.perf_counter() - start

    samples, repeats = options.trajectories * options.points, options.repeats
    limit = physical_limit(robot, samples, repeats)
    few = max(repeats // 10, 3)
    compiled = best_time(lambda: trajectory_cost(robot, q, qdot, dt), repeats)
    rows = {
        "limit: arithmetic only": limit,
        "default: numpy, see below" if lacking else "default: compiled": compiled,
        "numpy": best_time(lambda: attitude_cost(robot.base_twist(q, qdot), dt), few),
        "MuJoCo, mass matrices only": mujoco_time(q, few),
    }
    cells = [
        [method, f"{duration:.2f}", f"{1e3 * duration / samples:.3f}", f"{duration / limit:.1f}"]
        for method, duration in rows.items()
    ]
    count = f"{options.trajectories} trajectories of {options.points} points"
    print(f"Base disturbance (eq. 20) of {count}, one core used.\n")
    print(f"{machine_class()}, casadi {version('casadi')}\n")
    print(markdown_table(["method", "ms", "microseconds per point", "times the limit"], cells))
    difference = np.abs(base_twist(robot, q, qdot) - robot.base_twist(q, qdot)).max()
    print("", *(warning.message for warning in lacking), sep="\n")
    print(f"First call, which compiles or loads the kernel: {first:.2f} s.")
    print(f"Largest difference between compiled and numpy twists: {difference:.1e}.")
    if (options.trajectories, options.points) == (100, 100):
        print(f"Target {TARGET:.0f} ms: {'met' if compiled <= TARGET else 'missed'}.")


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.attitude_cost", main))
