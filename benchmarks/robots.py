"""One leaderboard over robots: planners on every robot of the zoo, with the reasons of what they miss."""

import json
import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from agents.commands.evaluate import main as evaluate
from benchmarks.arguments import whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.errors import ConfigurationError
from space_envs.robots.robot import Robot
from space_envs.robots.zoo import find_robot, robot_names
from space_envs.system.command_line import Parser, exit_status

SINGLE_ARM, DUAL_ARM = "SpaceCapture/SingleArm-v0", "SpaceCapture/DualArmSpatial-v0"
POLICIES = {
    SINGLE_ARM: ("gjm", "minimum_jerk", "promp_optimal", "promp_optimal_kept", "nmpc"),
    DUAL_ARM: ("reactionless_rate", "reactionless_free"),
}
GOALS, QUICK_GOALS = 50, 3  # medium test goals of each policy
ATTITUDE_METRIC = "capture@0.1deg"
HEAD = (
    *("robot", "policy", "captured", "within 0.1 deg", "kept-attitude score", "final attitude, deg"),
    *("time to capture, s", "not captured"),
)


def env_of(robot: Robot) -> str | None:
    """Id of the leaderboard that a robot belongs to; None for a planar robot."""
    if robot.planar:
        return None
    return SINGLE_ARM if len(robot.arms) == 1 else DUAL_ARM


def rows_of(name: str, env_id: str, goals: int, folder: Path) -> list[dict[str, Any]]:
    """Leaderboard rows of a robot's policies; an evaluation that the folder holds is continued."""
    output = folder / name
    words = ["--env", env_id, "--robot", name, "--policy", *POLICIES[env_id], "--episodes", str(goals)]
    again = ["--resume"] if output.exists() else []
    with redirect_stdout(sys.stderr):  # the tables are the output of this command
        status = evaluate([*words, "--output", str(output), "--no-pictures", *again])
    if status != 0:
        raise SystemExit(status)
    return json.loads((output / "summary.json").read_text(encoding="utf-8"))["rows"]


def cells(name: str, row: dict[str, Any]) -> list[str]:
    """Cells of a policy on a robot."""
    figures = row["figures"]
    failures = ", ".join(f"{count} {cause}" for cause, count in row["failures"].items() if count)
    return [
        name,
        row["policy"],
        f"{100 * figures['success']['value']:.0f} %",
        f"{100 * figures[ATTITUDE_METRIC]['value']:.0f} %",
        f"{figures['kept_attitude_score']['value']:.3f}",
        f"{figures['final_attitude']['value']:.2g}" if row["captures"] else "-",
        f"{figures['time_to_capture']['value']:.1f}" if row["captures"] else "-",
        failures or "-",
    ]


def leaderboard(names: Sequence[str], goals: int, folder: Path) -> str:
    """Tables of all robots, by id; robots in the given order, policies by the kept-attitude score.

    Raises:
        ConfigurationError: for an unknown robot.
    """
    tables: dict[str, list[list[str]]] = {}
    for name in names:
        env_id = env_of(find_robot(name))
        if env_id is None:
            print(f"{name} moves in the plane, where there is one robot: no leaderboard", file=sys.stderr)
            continue
        rows = rows_of(name, env_id, goals, folder)
        rows.sort(key=lambda row: -row["figures"]["kept_attitude_score"]["value"])
        tables.setdefault(env_id, []).extend(cells(name, row) for row in rows)
    return "\n\n".join(f"{env_id}:\n\n{markdown_table(list(HEAD), rows)}" for env_id, rows in tables.items())


def main() -> None:
    """Evaluate the policies on the robots and print the tables."""
    parser = Parser(prog="python -m benchmarks.robots", description=__doc__)
    add = parser.add_argument
    add("--robots", nargs="+", default=list(robot_names()), metavar="NAME", help="default: the whole zoo")
    add("--goals", type=whole, default=None, help=f"medium test goals of each policy (default {GOALS})")
    add("--quick", action="store_true", help=f"{QUICK_GOALS} goals, in about three minutes")
    add("--output", type=Path, default=None, metavar="FOLDER", help="default results/robots, or robots_quick")
    options = parser.parse_args()
    if options.quick and options.goals is not None:
        raise ConfigurationError("--quick sets the number of goals; leave out --goals")
    goals = QUICK_GOALS if options.quick else options.goals or GOALS
    folder = options.output or Path("results") / ("robots_quick" if options.quick else "robots")
    print(leaderboard(options.robots, goals, folder))
    print(f"\n{goals} medium test goals, {machine_class()}.")


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.robots", main))
