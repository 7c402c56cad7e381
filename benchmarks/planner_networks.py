"""Networks that plan against what they are made from: captures, attitude, disturbance and planning time."""

import sys
import time
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from agents.policies.registry import make_policy
from benchmarks.arguments import check_goals, split, whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.evaluation.play.steps import steps
from space_envs.policy import PolicyContext
from space_envs.system.command_line import Parser, exit_status, output_path

ENV = "SpaceCapture/SingleArm-v0"
# Policies, and what each of them is made from.
MADE_FROM = {
    "mpc": "the paper's controller, which makes its demonstrations",
    "promp": "the distribution of the demonstrations, best of 100 samples",
    "promp_optimal_kept": "a search from stored optimal motions",
    "planner_network_alone": "a network",
    "planner_network": "the network and two corrections",
}
SETTINGS = (("medium", 1.0), ("hard", 1.0), ("medium", 0.9), ("medium", 1.1))  # difficulty, mass factor
HEADS = (
    ("policy", ""),
    ("difficulty", ""),
    ("mass", ""),
    ("captured", "%"),
    ("at most 1 deg", "%"),
    ("at most 0.1 deg", "%"),
    ("peak", "deg"),
    ("eq. 20", "cm^2/s"),
    ("plan", "ms"),
)
DRAWN = (
    (4, "eq. 20, cm$^2$/s"),
    (2, "captured, final attitude\nat most 0.1 deg, %"),
    (5, "planning, ms"),
)  # column of `play`, and its title
TIMED = 10  # plans whose times are measured


def play(name: str, difficulty: str, scale: float, goals: NDArray[np.int64], split: str) -> list[float]:
    """Shares captured, and so with a final attitude of at most 1 and 0.1 deg, in %; medians over captures of
    the peak attitude, deg, and the disturbance by eq. 20, cm^2/s; median time of a plan, ms.

    Args:
        scale: of the satellite's mass and inertia, which the policies do not know.
    """
    n = len(goals)
    env = CaptureVectorEnv(ENV, n, difficulty=difficulty, split=split, autoreset_mode="disabled")
    observation, _ = env.reset(seed=0, options={"index": goals})
    rows = np.arange(n)
    env.simulation.scale_base(rows, np.full(n, scale))
    env.simulation.refresh(rows)
    env.drive.reset(rows)
    policy, task = make_policy(name, PolicyContext.from_env(env), 0), env.task
    planning = plan_time(policy, observation)
    final, peak, cost = np.zeros((3, n))
    captured = np.zeros(n, dtype=bool)
    for step in steps(policy, env, observation):
        attitude = np.rad2deg(task.attitude(step.observation))
        final = np.where(step.running, attitude, final)
        peak = np.maximum(peak, np.where(step.running, attitude, 0.0))
        cost += step.running * task.errors(step.observation).base_speed ** 2 * task.control_period
        captured |= step.info["outcome"] == "captured"
    shares = [100.0 * float((captured & (final <= limit)).mean()) for limit in (np.inf, 1.0, 0.1)]
    return [*shares, float(np.median(peak[captured])), 1e4 * float(np.median(cost[captured])), planning]


def plan_time(policy: object, observation: Array) -> float:
    """Median processor time of the first call of an episode, ms, one episode at a time."""
    predict, times = policy.predict, []  # type: ignore[attr-defined]
    for row in range(min(TIMED, len(observation) - 1) + 1):
        before = time.thread_time()
        predict(observation[row : row + 1], None, np.array([True]))
        times.append(1e3 * (time.thread_time() - before))
    return float(np.median(times[1:]))  # the first one finds its code cold


def main() -> None:
    """Print the table, and draw the figure if asked for."""
    parser = Parser(prog="python -m benchmarks.planner_networks", description=__doc__)
    parser.add_argument("--goals", type=whole, default=100, help="of each difficulty (default %(default)s)")
    parser.add_argument("--split", type=split, default="test", help="default %(default)s")
    parser.add_argument("--plots", type=output_path, metavar="FOLDER", help="draw the medium goals there")
    options = parser.parse_args()
    check_goals(ENV, options.split, options.goals)
    goals, found = np.arange(options.goals), {}
    for name in MADE_FROM:
        for difficulty, scale in SETTINGS:
            found[name, difficulty, scale] = play(name, difficulty, scale, goals, options.split)
    rows = [
        [f"`{name}`", difficulty, f"{scale:g}", *(f"{v:.3g}" for v in values)]
        for (name, difficulty, scale), values in found.items()
    ]
    heads = [f"{head}, {unit}" if unit else head for head, unit in HEADS]
    print(f"{options.goals} goals of the {options.split} split each, {machine_class()}, processor time.\n")
    print(markdown_table(heads, rows))
    if options.plots is not None:
        draw({name: found[name, "medium", 1.0] for name in MADE_FROM}, Path(options.plots))


def draw(values: dict[str, list[float]], folder: Path) -> None:
    """Draw disturbance, peak attitude and planning time of the policies on medium goals."""
    figure = Figure(figsize=(9.0, 2.8), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(1, 3, sharey=True)
    for axis, (column, title) in zip(axes, DRAWN, strict=True):
        axis.barh(list(values), [each[column] for each in values.values()], color="#4477aa")
        axis.set_xlabel(title)
    axes[2].set_xscale("log")
    axes[0].invert_yaxis()
    figure.savefig(folder / "planner_networks.png", dpi=120)


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.planner_networks", main))
