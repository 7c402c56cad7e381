"""Captures along reactionless paths: peak attitude, base disturbance and planning times, one process."""

import sys
import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from agents.planners.common.plans import Failure
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.policies.single_arm.reactionless.policy import PrompReactionless
from benchmarks.arguments import check_goals, split, whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.evaluation.play.steps import steps
from space_envs.perturbations.amounts import Perturbation
from space_envs.policy import PolicyContext
from space_envs.system.command_line import Parser, exit_status

ENV = "SpaceCapture/SingleArm-v0"
SPLITS = ("validation", "test")
SCALES = (1.0, 0.9, 1.1)
BATCH = 50  # episodes simulated together
NOMINAL, MISMATCHED = 0.01, 0.15  # deg, peak attitudes up to which captures are counted


class TimedPolicy(PrompReactionless):
    """Plans each goal once, notes how long that takes, and repeats the plans in further episodes."""

    def __init__(self, context: PolicyContext, known: dict[bytes, ReachPlan | Failure]) -> None:
        super().__init__(context)
        self.known, self.times = known, list[float]()

    def plan(self, asked: list[Reach], observation: Array | None = None) -> list[ReachPlan | Failure]:
        """Plans of all rows."""
        for reach in asked:
            if (key := reach.end.position.tobytes() + reach.end.quaternion.tobytes()) not in self.known:
                before = time.thread_time()
                self.known[key] = self.planner.plan(reach)
                self.times.append(time.thread_time() - before)
        return [self.known[reach.end.position.tobytes() + reach.end.quaternion.tobytes()] for reach in asked]


@dataclass(frozen=True, eq=False)
class Played:
    """Episodes (K,): captured or not, peak attitude deg, eq. 20 times dt m^2/s, and planning times s."""

    captured: NDArray[np.bool_]
    peak: Array
    cost: Array
    times: Array

    def share(self, peak: float) -> str:
        """Percentage of episodes that are captured with at most a peak attitude in deg."""
        return f"{100.0 * (self.captured & (self.peak <= peak)).mean():.1f}"

    def cells(self) -> list[str]:
        """A row of the table, after its names."""
        times = 1e3 * self.times
        return [
            f"{100.0 * self.captured.mean():.1f}",
            self.share(NOMINAL),
            self.share(MISMATCHED),
            f"{np.median(self.peak[self.captured]):.2g}" if self.captured.any() else "-",
            f"{self.peak[self.captured].max():.2g}" if self.captured.any() else "-",
            _interquartile_mean(1e4 * self.cost[self.captured]),
            _interquartile_mean(1e4 * self.cost),
            *([f"{np.median(times):.1f}", f"{np.percentile(times, 95):.1f}"] if len(times) else ["", ""]),
        ]


def _interquartile_mean(values: Array) -> str:
    """Mean of the middle half of the values (K,)."""
    ordered, quarter = np.sort(values), len(values) // 4
    middle = ordered[quarter : len(ordered) - quarter]
    return f"{middle.mean():.1f}" if len(middle) else "-"


def play(
    name: str,
    goals: NDArray[np.int64],
    scale: float,
    known: dict[bytes, ReachPlan | Failure],
    **keywords: Any,
) -> Played:
    """Episodes on some goals of a split with the satellite's mass and inertia scaled."""
    n = len(goals)
    perturbation = Perturbation(satellite_mass=scale)
    env = CaptureVectorEnv(
        ENV, n, split=name, autoreset_mode="disabled", perturbation=perturbation, **keywords
    )
    observation, _ = env.reset(seed=0, options={"index": goals})
    policy = TimedPolicy(PolicyContext.from_env(env), known)
    read, period = policy.context.layout.read, env.task.control_period
    peak, cost, captured, running = np.zeros(n), np.zeros(n), np.zeros(n, dtype=bool), np.ones(n, dtype=bool)
    for step in steps(policy, env, observation):
        seen = step.observation
        peak = np.where(running, np.maximum(peak, np.rad2deg(env.task.attitude(seen))), peak)
        linear, angular = read(seen, "base_linear_velocity"), read(seen, "base_angular_velocity")
        square = (linear**2).sum(axis=1) + env.task.c**2 * (angular**2).sum(axis=1)
        cost += np.where(running, period * square, 0.0)
        captured |= running & (np.asarray(step.info["outcome"]) == "captured")
        running = np.asarray(step.running)
    env.close()
    return Played(captured, peak, cost, np.array(policy.times))


def main() -> None:
    """Print the table."""
    parser = Parser(prog="python -m benchmarks.reactionless_paths", description=__doc__)
    parser.add_argument("--goals", type=whole, default=100, help="of each split (default %(default)s)")
    parser.add_argument("--splits", nargs="+", type=split, default=list(SPLITS), help="default both")
    parser.add_argument("--difficulty", default="medium", help="default %(default)s")
    parser.add_argument("--horizon", type=whole, help="steps (default: the task's)")
    parser.add_argument("--variant", help="of the robot's inertias (default: the task's)")
    options = parser.parse_args()
    keywords = {"difficulty": options.difficulty, "horizon": options.horizon, "variant": options.variant}
    keywords = {name: value for name, value in keywords.items() if value is not None}
    table = []
    with tqdm(total=len(options.splits) * len(SCALES) * options.goals, unit="episode", leave=False) as bar:
        for name in options.splits:
            check_goals(ENV, name, options.goals)
            known: dict[bytes, ReachPlan | Failure] = {}
            for scale in SCALES:
                parts = []
                for first in range(0, options.goals, BATCH):
                    goals = np.arange(first, min(first + BATCH, options.goals))
                    parts.append(play(name, goals, scale, known, **keywords))
                    bar.update(len(goals))
                columns = [
                    [getattr(part, key) for part in parts] for key in ("captured", "peak", "cost", "times")
                ]
                whole_run = Played(*map(np.concatenate, columns))
                table.append([name, f"{scale:g}", *whole_run.cells()])
    head = ["split", "mass and inertia", "captured, %", f"within {NOMINAL:g} deg, %"]
    head += [f"within {MISMATCHED:g} deg, %", "peak attitude, median, deg", "worst, deg"]
    head += ["eq. 20, captures, cm^2/s", "eq. 20, all episodes", "planning, median, ms", "95 %, ms"]
    print(markdown_table(head, table))
    print(
        f"\n{options.goals} {options.difficulty} goals a split; peaks and eq. 20 (base disturbance, times the"
        " control period, interquartile mean) until the end of an episode; CPU time of planning;"
        f" {machine_class()}."
    )


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.reactionless_paths", main))
