"""Momentum drift, joint rates and joint limits against the control period, at the largest time step.

Full-scale actions in every control mode: after one control period, 0.2, 0.5, 2 or 3 s, half of the episodes
reverse the action and half draw another one. Each figure is the worst of the four modes.
"""

import sys
from collections.abc import Iterator
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
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.registration import make_task
from space_envs.system.command_line import Parser, exit_status

PERIODS = (0.1, 0.2, 0.3, 0.5, 1.0)  # s
HOLDS = (
    0.0,
    0.2,
    0.5,
    2.0,
    3.0,
)  # s, how long actions are held; episodes cycle through them; at least one control period
SECONDS = 20.0


class WorstFigures(NamedTuple):
    """Worst figures of some episodes.

    Attributes:
        drift: of total momentum, relative to the largest momentum of a body.
        rate: largest joint rate, relative to its limit.
        distance: smallest distance of a joint from the end of its range, rad; negative beyond it.
    """

    drift: float
    rate: float
    distance: float


def full_strokes(env: CaptureVectorEnv, seed: int) -> Iterator[Array]:
    """Actions (E, m) of successive control steps."""
    rng, period = np.random.default_rng(seed), env.task.control_period
    hold = np.maximum(1, np.rint(np.resize(HOLDS, env.num_envs) / period)).astype(int)
    reverses = (np.arange(env.num_envs) % 2 == 0)[:, None]

    def following(step: int, before: Array) -> Array:
        drawn = np.sign(rng.uniform(-1.0, 1.0, before.shape))
        return np.where(reverses & (step > 0), -before, drawn)

    steps = min(round(SECONDS / period), env.task.horizon)
    return held_actions(env.action_space.shape, steps, hold, following)


def run(
    robot: SimulatedRobot, mode: str, period: float, timestep: float, episodes: int, seed: int
) -> WorstFigures:
    """Worst figures of episodes with full-scale actions."""
    env = environment(robot, mode, episodes, seed, control_period=period, timestep=timestep)
    motion = simulate(env, full_strokes(env, seed))
    if motion.diverged:
        return WorstFigures(np.inf, np.inf, -np.inf)
    qpos, qvel = motion.qpos, motion.qvel
    ends, angles = env.task.mechanics.range, qpos[..., 7:]
    return WorstFigures(
        float(momentum_drift(body_motion(env.task.mechanics, qpos, qvel))[1].max()),
        float((np.abs(qvel[..., 6:]) / env.task.robot.rate_limit).max()),
        float(np.minimum(angles - ends[:, 0], ends[:, 1] - angles).min()),
    )


def main(arguments: list[str] | None = None) -> None:
    """Print the table of docs/momentum.md."""
    parser = Parser(prog="python -m benchmarks.limits", description=__doc__)
    parser.add_argument("--episodes", type=whole, default=10, help="episodes for each figure (default 10)")
    parser.add_argument("--seed", type=seed, default=0, help="of actions and goals (default 0)")
    parser.add_argument("--robot", nargs="+", default=[], metavar="NAME|FILE", help=ROBOT_HELP)
    options = parser.parse_args(arguments)
    robots = simulated_robots(options.robot)
    rows = []
    for robot, period in tqdm([(r, p) for r in robots for p in PERIODS], unit="cell"):
        steps = make_task(robot.env_id, robot.keywords).robot.steps
        step = steps.largest_timestep
        tried = unlimited(robot)
        found = [run(tried, m, period, step, options.episodes, options.seed) for m in CONTROL_MODES]
        rows.append(
            [robot.name, f"{period:g}" + ("" if period <= steps.largest_control_period else " (refused)")]
            + [f"{1e3 * step:g}", f"{max(w.drift for w in found):.1e}"]
            + [f"{max(w.rate for w in found):.2f}", f"{min(w.distance for w in found):.3f}"]
        )
    print(f"\n{options.episodes} episodes of {SECONDS:g} s, seed {options.seed}; {machine_class()}\n")
    header = [
        "robot",
        "control period, s",
        "step, ms",
        "drift",
        "peak rate / rate limit",
        "distance to joint limit, rad",
    ]
    print(markdown_table(header, rows))


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.limits", main))
