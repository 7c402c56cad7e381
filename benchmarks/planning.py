"""Planning times of the reactionless methods on the validation goals of both dual-arm tasks, one process."""

import sys
import time
from collections import Counter

import numpy as np

from agents.planners.common.plans import Failure
from agents.planners.dual_arm.prescribed_paths.model import PathModel
from agents.policies.dual_arm.reactionless import (
    ReactionlessFree,
    ReactionlessLocal,
    ReactionlessOCP,
    ReactionlessPolicy,
    ReactionlessZetaZero,
)
from benchmarks.arguments import check_goals, whole
from benchmarks.machine import machine_class, markdown_table, verdict
from space_envs.envs import CaptureVectorEnv
from space_envs.policy import PolicyContext
from space_envs.system.command_line import Parser, exit_status

METHODS: dict[str, tuple[type[ReactionlessPolicy], dict[str, float]]] = {
    # Allowed median planning time, s, by task.
    "reactionless": (ReactionlessZetaZero, {"Planar": 0.1, "Spatial": 0.1}),
    "reactionless_local": (ReactionlessLocal, {"Planar": 0.1, "Spatial": 0.1}),
    "reactionless_ocp": (ReactionlessOCP, {"Planar": 5.0, "Spatial": 20.0}),
    "reactionless_free": (ReactionlessFree, {"Planar": 5.0, "Spatial": 20.0}),
}


def measured(method: type[ReactionlessPolicy], task: str, goals: int) -> tuple[list[float], Counter[str]]:
    """Planning times, s, after one plan that is not timed, and the number of each result."""
    env = CaptureVectorEnv(f"SpaceCapture/DualArm{task}-v0", goals)
    observation, _ = env.reset(options={"split": "validation", "index": np.arange(goals)})
    inputs = method(PolicyContext.from_env(env)).inputs(observation)
    method.plan(inputs[0])
    times, outcomes = [], Counter[str]()
    for given in inputs:
        before = time.perf_counter()
        plan = method.plan(given)
        times.append(time.perf_counter() - before)
        outcomes[plan.cause if isinstance(plan, Failure) else "plan"] += 1
    return times, outcomes


def evaluation_time(task: str, repeats: int = 2000) -> float:
    """Time, s, of the compiled matrices at one configuration; every method does this hundreds of times."""
    env = CaptureVectorEnv(f"SpaceCapture/DualArm{task}-v0", 1)
    robot = env.task.mechanics
    model = PathModel.of(robot)
    model(robot.home)
    before = time.perf_counter()
    for _ in range(repeats):
        model(robot.home)
    return (time.perf_counter() - before) / repeats


def main() -> None:
    """Print the table."""
    parser = Parser(prog="python -m benchmarks.planning", description=__doc__)
    parser.add_argument("--goals", type=whole, default=20, help="plans of each method (default %(default)s)")
    options = parser.parse_args()
    for task in ("Planar", "Spatial"):
        check_goals(f"SpaceCapture/DualArm{task}-v0", "validation", options.goals)
    rows = []
    for task in ("Planar", "Spatial"):
        evaluation = evaluation_time(task)
        for name, (method, allowed) in METHODS.items():
            if task not in allowed:
                continue
            times, outcomes = measured(method, task, options.goals)
            rows.append(
                [
                    task.lower(),
                    f"`{name}`",
                    f"{np.median(times):.3f}",
                    f"{np.percentile(times, 90):.3f}",
                    f"{allowed[task]:g}",
                    verdict(float(np.median(times)), allowed[task]),
                    f"{np.median(times) / evaluation:,.0f}",
                    ", ".join(f"{count} {result}" for result, count in outcomes.most_common()),
                ]
            )
    head = ["robot", "method", "median, s", "90 %, s", "bound, s", "bound on the median"]
    head += ["median / one evaluation", "results"]
    print(markdown_table(head, rows))
    print(f"\n{options.goals} validation goals of difficulty medium, one process, {machine_class()}.")


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.planning", main))
