"""Energies of the reactionless methods (a) to (d) on the same validation goals of both dual-arm tasks.

Without obstacles, within the limits of the drives. In space (c) and (d) are compared twice: with approach
axes at the end as in the task, which (a) and (b) cannot align, and with any axes, where all four solve the
same problem.
"""

import sys
import time
from dataclasses import replace
from typing import Any

import numpy as np

from agents.planners.common.plans import Failure, Limits
from agents.planners.dual_arm.free_paths.planner import plan_free
from agents.planners.dual_arm.prescribed_paths.instantaneous import plan_local, plan_zeta_zero
from agents.planners.dual_arm.prescribed_paths.ocp import plan_ocp
from agents.planners.dual_arm.problem import Capture
from agents.policies.dual_arm.reactionless import PlannerInput, ReactionlessFree
from benchmarks.arguments import check_goals, whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.policy import PolicyContext
from space_envs.system.command_line import Parser, exit_status

METHODS = ("(a)", "(b)", "(c)", "(d)")
SAME = 1e-6  # relative difference of energies that counts as none


def planner_inputs(task: str, goals: int, robot: str | None) -> list[PlannerInput]:
    """Inputs of the planners at the start of the first validation goals."""
    keywords: dict[str, Any] = {} if robot is None else {"robot": robot}
    env = CaptureVectorEnv(f"SpaceCapture/DualArm{task}-v0", goals, **keywords)
    observation, _ = env.reset(options={"split": "validation", "index": np.arange(goals)})
    return ReactionlessFree(PolicyContext.from_env(env)).inputs(observation)


def energies(robot: FloatingRobot, capture: Capture, limits: Limits) -> tuple[list[float], list[float]]:
    """Energies, J s, of the four methods, and the time of each plan, s; not a number without a plan."""
    found, times = [], []
    for method in METHODS:
        before = time.thread_time()
        if method == "(a)":
            plan = plan_zeta_zero(robot, capture, limits)
        elif method == "(b)":
            plan = plan_local(robot, capture, limits)
        elif method == "(c)":
            plan = plan_ocp(robot, capture, limits, from_rest=True)
        else:
            plan = plan_free(robot, capture, limits)
        times.append(time.thread_time() - before)
        found.append(np.nan if isinstance(plan, Failure) else plan.energy)
    return found, times


def rows_of(name: str, alike: slice, measured: Array, times: Array) -> list[list[str]]:
    """Rows of the table, one a method, from energies and times (goals, 4).

    Args:
        alike: methods that solve the same problem as (d), which should not need more energy.
    """
    rows, given = [], measured[:, alike]
    least = np.where(np.isnan(given), np.inf, given).min(axis=1)
    for k, method in enumerate(METHODS):
        energy, both = measured[:, k], ~np.isnan(measured[:, k]) & ~np.isnan(measured[:, 2])
        ratio = np.median(energy[both] / measured[both, 2]) if both.any() else np.nan
        planned = np.isfinite(energy)
        above = np.isfinite(least) & ~(energy <= least * (1.0 + SAME))
        rows.append(
            [
                name,
                method,
                f"{planned.sum()} of {len(energy)}",
                f"{np.median(energy[planned]):.3f}" if planned.any() else "-",
                f"{ratio:.3f}",
                f"{above.sum()}" if method == "(d)" else "-",
                f"{np.median(times[:, k]):.2f}",
                f"{np.percentile(times[:, k], 90):.2f}",
            ]
        )
    return rows


def main() -> None:
    """Print the table."""
    parser = Parser(prog="python -m benchmarks.reactionless_energies", description=__doc__)
    parser.add_argument("--goals", type=whole, default=24, help="goals of each task (default %(default)s)")
    parser.add_argument("--robot", help="another robot with two arms in space (default: the task's)")
    options = parser.parse_args()
    tasks = ("Planar", "Spatial") if options.robot is None else ("Spatial",)
    rows = []
    for task in tasks:
        keywords = {} if options.robot is None else {"robot": options.robot}
        check_goals(f"SpaceCapture/DualArm{task}-v0", "validation", options.goals, keywords)
        inputs = planner_inputs(task, options.goals, options.robot)
        kinds = {"space, any axes": (False, slice(3)), "space, axes": (True, slice(2, 3))}
        kinds = {"plane": (True, slice(3))} if task == "Planar" else kinds
        for name, (aligned, alike) in kinds.items():
            captures = [each.capture if aligned else replace(each.capture, aligned=False) for each in inputs]
            found = [
                energies(each.mechanics, capture, each.limits)
                for each, capture in zip(inputs, captures, strict=True)
            ]
            rows += rows_of(name, alike, *(np.array(part) for part in zip(*found, strict=True)))
    head = ["goals", "method", "plans", "median C, J s", "median C / C of (c)", "above the others"]
    print(markdown_table([*head, "median, s", "90 %, s"], rows))
    print(f"\n{options.goals} validation goals of difficulty medium, processor time, {machine_class()}.")


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.reactionless_energies", main))
