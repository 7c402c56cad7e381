"""Prescribed paths that zeta = 0 does not follow, and how many of them other methods save.

Random planar cases of shah2013, as `python -m reproduce shah2013` draws them, within joint limits alone.
"""

import sys
from collections import Counter
from typing import Any

from joblib import Parallel, delayed

from agents.planners.common.plans import Failure, Limits
from agents.planners.dual_arm.free_paths.planner import plan_free
from agents.planners.dual_arm.prescribed_paths.instantaneous import plan_local, plan_zeta_zero
from agents.planners.dual_arm.prescribed_paths.ocp import plan_ocp
from reproduce.shah2013.cases import ROBOT, Sampler, planar_robot
from space_envs.errors import positive_integer
from space_envs.system.command_line import Parser, exit_status

MOST = 100_000  # cases or processes
PASSED = "passage"  # in the notes of a plan of (c) that starts from a search over zeta
SAVING = ("(b)", "(c), from (a), (b) and perturbed ones", "(c), with zeta searched", "(d)")


def outcomes(number: int, index: int) -> tuple[str, dict[str, bool]]:
    """Cause of (a)'s failure or "plan", and whether each other method finds a plan.

    Args:
        number: seed of the draws. index: of the case.
    """
    robot, limits = planar_robot(), Limits(position=ROBOT.joint_range)
    capture = Sampler().draw(number, index).capture
    first = plan_zeta_zero(robot, capture, limits)
    if not isinstance(first, Failure):
        return "plan", {}
    optimal = plan_ocp(robot, capture, limits)
    saved = {
        "(b)": not isinstance(plan_local(robot, capture, limits), Failure),
        SAVING[1]: not isinstance(optimal, Failure) and PASSED not in optimal.notes,
        SAVING[2]: not isinstance(optimal, Failure),
        "(d)": not isinstance(plan_free(robot, capture, limits), Failure),
    }
    return str(first.cause), saved


def main() -> None:
    """Print the table."""
    parser = Parser(prog="python -m reproduce.singular_paths", description=__doc__)
    parser.add_argument("--cases", type=int, default=200, help="cases of each seed (default %(default)s)")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0], help="of the draws (default 0)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (default %(default)s)")
    options = parser.parse_args()
    for name in ("cases", "jobs"):
        positive_integer(f"--{name}", getattr(options, name), MOST)
    rows = []
    for number in options.seeds:
        tasks = (delayed(outcomes)(number, index) for index in range(options.cases))
        found: Any = Parallel(n_jobs=options.jobs)(tasks)
        causes = Counter(cause for cause, _ in found)
        for cause in ("singular", "joint_limit"):
            each = [saved for failure, saved in found if failure == cause]
            counts = [str(sum(saved[name] for saved in each)) for name in SAVING]
            rows.append(
                [str(number), cause.replace("_", " "), f"{causes[cause]} of {options.cases}", *counts]
            )
    head = ["seed", "(a) fails by", "cases", *(f"saved by {name}" for name in SAVING)]
    for row in (head, ["---"] * len(head), *rows):
        print(f"| {' | '.join(row)} |")
    print("\nRandom planar cases of shah2013.")


if __name__ == "__main__":
    sys.exit(exit_status("python -m reproduce.singular_paths", main))
