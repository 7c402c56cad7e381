"""Feedback against plan following under unmodelled errors of the satellite's mass and inertia."""

import sys
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tqdm import tqdm

from agents.commands.robots import add_robot, robot_keywords, robot_words
from agents.policies.registry import make_policy
from agents.policies.single_arm.reaching import DURATION
from benchmarks.arguments import check_goals, split, whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.evaluation.play.steps import steps
from space_envs.perturbations.amounts import Perturbation
from space_envs.policy import PolicyContext
from space_envs.system.command_line import Parser, exit_status

ENV = "SpaceCapture/SingleArm-v0"
POLICIES = ("nmpc", "nmpc_reactionless", "promp_optimal_kept")
REPLANNING = ("nmpc", "nmpc_reactionless")  # at every step: their first plan does not end the motion
SCALES = (0.9, 1.0, 1.1)
BATCH = 50  # episodes simulated together
ALLOWED = 0.3  # deg, final attitude error


def play(
    name: str, scale: float, goals: NDArray[np.int64], split: str, robot: Mapping[str, Any]
) -> dict[str, Array]:
    """Results (K,) of episodes on medium goals with the satellite's mass and inertia scaled, by name.

    Args:
        robot: keywords of the task that choose it.

    Returns:
        position, rotation, attitude: errors at the end of the planned motion, m, deg and deg.
        captured: whether the episode ended with a capture.
        final, peak: attitude error at its end, and the largest one after a control step, deg.
        planned: whether there was a plan.
    """
    n = len(goals)
    perturbation = Perturbation(satellite_mass=scale)
    env = CaptureVectorEnv(ENV, n, split=split, autoreset_mode="disabled", perturbation=perturbation, **robot)
    observation, _ = env.reset(seed=0, options={"index": goals})
    policy = make_policy(name, PolicyContext.from_env(env), 0)
    task, end = env.task, round(DURATION / env.task.control_period)
    step_results, attitudes = list(steps(policy, env, observation)), [np.zeros(n)]
    for step in step_results:
        attitude = np.rad2deg(task.attitude(step.observation))
        attitudes.append(np.where(step.running, attitude, attitudes[-1]))
    env.close()
    end, last = min(end, len(step_results)), step_results[-1]  # all episodes may end before their plans do
    errors = task.errors(step_results[end - 1].observation)
    return {
        "position": errors.position,
        "rotation": np.rad2deg(errors.orientation),
        "attitude": attitudes[end],
        "captured": last.info["outcome"] == "captured",
        "final": attitudes[-1],
        "peak": np.max(attitudes, axis=0),
        "planned": np.array([failure is None for failure in last.state.failures]),
    }


def cells(made: Mapping[str, NDArray[Any]], replanning: bool) -> list[str]:
    """Cells of a row of the table, after policy and scale, from what `play` returns.

    Args:
        replanning: whether errors at the end of the plan have no meaning.
    """
    planned = made["planned"]
    accurate = made["captured"] & (made["final"] <= ALLOWED)
    position, rotation, attitude, final, peak = (
        float(np.median(made[key][planned])) for key in ("position", "rotation", "attitude", "final", "peak")
    )
    at_end = [f"{1e3 * position:.2f}", f"{rotation:.3f}", f"{attitude:.3f}"]
    return [
        f"{planned.sum()}",
        *(["-"] * 3 if replanning else at_end),
        f"{made['captured'].sum()}",
        f"{accurate.sum()}",
        f"{final:.3f}",
        f"{made['final'][planned].max():.3f}",
        f"{peak:.3f}",
    ]


def main() -> None:
    """Print the table."""
    parser = Parser(prog="python -m benchmarks.mismatch", description=__doc__)
    parser.add_argument("--goals", type=whole, default=100, help="medium goals (default %(default)s)")
    parser.add_argument("--split", type=split, default="test", help="default %(default)s")
    add_robot(parser.add_argument)
    options = parser.parse_args()
    robot = robot_keywords(options)
    check_goals(ENV, options.split, options.goals, robot)
    rows = []
    with tqdm(total=len(POLICIES) * len(SCALES) * options.goals, unit="episode", leave=False) as bar:
        for name in POLICIES:
            for scale in SCALES:
                batches = []
                for first in range(0, options.goals, BATCH):
                    goals = np.arange(first, min(first + BATCH, options.goals))
                    batches.append(play(name, scale, goals, options.split, robot))
                    bar.update(len(goals))
                made = {key: np.concatenate([batch[key] for batch in batches]) for key in batches[0]}
                rows.append([f"`{name}`", f"{scale:g}", *cells(made, name in REPLANNING)])
    head = ["policy", "mass and inertia", "planned", "plan's end, mm", "deg", "attitude, deg"]
    head += ["captured", f"captured within {ALLOWED:g} deg", "final attitude error, median, deg"]
    print(markdown_table([*head, "worst, deg", "peak attitude, median, deg"], rows))
    print(f"\n{options.goals} medium {options.split} goals{robot_words(robot)}, {machine_class()}.")


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.mismatch", main))
