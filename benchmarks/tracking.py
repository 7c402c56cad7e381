"""Peak base rate and momentum of plans tracked at torque level in MuJoCo, by time step and control period."""

import sys

import numpy as np

from agents.commands.choice import fitting_ids
from agents.commands.robots import add_robot, robot_keywords, robot_words
from agents.planners.common.plans import Failure
from agents.planners.dual_arm.tracking import FINE, Tracking, track
from agents.policies.dual_arm.reactionless import ReactionlessFree, ReactionlessOCP, ReactionlessPolicy
from benchmarks.arguments import check_goals, whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.envs import CaptureVectorEnv
from space_envs.policy import PolicyContext
from space_envs.system.command_line import Parser, exit_status

SETTINGS = (
    Tracking(control_period=0.1),
    Tracking(),
    Tracking(timestep=0.01, control_period=0.01),
    FINE,
)
CASES: tuple[tuple[str, type[ReactionlessPolicy]], ...] = (
    ("SpaceCapture/DualArmPlanar-v0", ReactionlessOCP),
    ("SpaceCapture/DualArmPlanar-v0", ReactionlessFree),
    ("SpaceCapture/DualArmSpatial-v0", ReactionlessFree),
)


def main() -> None:
    """Print the table."""
    parser = Parser(prog="python -m benchmarks.tracking", description=__doc__)
    parser.add_argument("--goals", type=whole, default=5, help="plans of each method (default %(default)s)")
    add_robot(parser.add_argument)
    options = parser.parse_args()
    robot = robot_keywords(options)
    env_ids = fitting_ids(list(dict(CASES)), robot)
    for env_id in env_ids:
        check_goals(env_id, "validation", options.goals, robot)
    rows = []
    for env_id, method in [case for case in CASES if case[0] in env_ids]:
        env = CaptureVectorEnv(env_id, options.goals, **robot)
        observation, _ = env.reset(options={"split": "validation", "index": np.arange(options.goals)})
        found = [method.plan(one) for one in method(PolicyContext.from_env(env)).inputs(observation)]
        plans = [plan for plan in found if not isinstance(plan, Failure)]
        for tracking in SETTINGS:
            done = [track(plan, env.task.robot, tracking) for plan in plans]
            rows.append(
                [
                    "planar" if env.task.planar else "spatial",
                    f"`{plans[0].method}`" if plans else method.__name__,
                    f"{1e3 * tracking.timestep:g}",
                    f"{1e3 * tracking.control_period:g}",
                    f"{tracking.attitude_gain:g}",
                    f"{max(one.peak_base_rate for one in done):.1e}",
                    f"{max(np.rad2deg(one.attitude.max()) for one in done):.1e}",
                    f"{max(one.momentum.max() for one in done):.1e}",
                    f"{max(one.joint_error.max() for one in done):.1e}",
                ]
            )
    head = [
        "robot",
        "plan",
        "step, ms",
        "control, ms",
        "attitude gain, 1/s",
        "peak base rate, rad/s",
        "peak attitude, deg",
        "momentum, N s or N m s",
        "joint error, rad",
    ]
    print(markdown_table(head, rows))
    what = f"{options.goals} validation goals of difficulty medium{robot_words(robot)}"
    print(f"\nWorst of up to {what}, {machine_class()}.")


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.tracking", main))
