"""Plans in ProMP weights against the best known motions: cost, errors, planning time and initial guesses."""

import sys
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from joblib import Parallel, delayed
from tqdm import tqdm

from agents.demonstrations.optimal.library import robot_limits
from agents.planners.common.plans import Failure, Limits
from agents.planners.single_arm.check import check
from agents.planners.single_arm.collocation.ocp import plan_ocp
from agents.planners.single_arm.library import library_of
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.ranking import predicted_costs
from agents.planners.single_arm.weights.shapes import INTERVALS
from agents.planners.single_arm.weights.sqp import GOAL_TOLERANCE, minimise
from benchmarks.arguments import check_goals, split, whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array
from space_envs.system.command_line import Parser, exit_status
from space_envs.tasks.single_arm import SingleArmTask

NEAR = 16  # stored motions as initial guesses of the reference, those of least predicted cost among 48
DRAWN = 8  # random initial guesses of the reference
FINE = 1e-4  # relative decrease of an iteration below which the reference stops


@dataclass(frozen=True)
class ReachSetting:
    """Difficulty, terminal constraint and limits of a set of planning problems."""

    difficulty: str
    keep_attitude: bool
    limited: bool

    @property
    def limits(self) -> Limits:
        """Limits of the model, or none."""
        return robot_limits(SingleArmTask().robot) if self.limited else Limits()

    @property
    def cells(self) -> list[str]:
        """First cells of a table's row."""
        attitude = "constrained" if self.keep_attitude else "unconstrained"
        return [self.difficulty, "model's" if self.limited else "none", attitude]

    def reaches(self, split: str, count: int) -> list[Reach]:
        """Planner inputs for the first goals of a split."""
        task = SingleArmTask(difficulty=self.difficulty)
        goals = task.goals(split, np.arange(count))
        return [
            Reach(
                task.mechanics.home, Grapple.at_rest(position, quaternion), keep_attitude=self.keep_attitude
            ).checked(task.mechanics)
            for position, quaternion in zip(goals.position, goals.quaternion, strict=True)
        ]


def best_known(setting: ReachSetting, reach: Reach, number: int, collocation: bool) -> tuple[float, float]:
    """Lowest costs, m^2/s, in the weights from many initial guesses and by collocation; inf if none."""
    task = SingleArmTask()
    library = library_of(task.robot, setting.keep_attitude, setting.limited)
    planner = OptimalPlanner(task.mechanics, setting.limits, library)
    space, bounds, rows = planner.setting(reach)
    near = library.nearest(reach, 3 * NEAR)
    near = near[np.argsort(predicted_costs(space, near, reach.keep_attitude), kind="stable")[:NEAR]]
    rng = np.random.default_rng(number)
    unconstrained = minimise(space, bounds, np.zeros_like(near[0]), False, rows).y
    drawn = unconstrained + 0.15 * rng.standard_normal((DRAWN, *unconstrained.shape))
    found = [
        minimise(space, bounds, guess, reach.keep_attitude, rows, tolerance=FINE) for guess in [*near, *drawn]
    ]
    costs = [solution.cost for solution in found if solution.goal_error < GOAL_TOLERANCE]
    best = min(costs, default=np.inf)
    if not collocation:
        return best, np.inf
    plan = plan_ocp(task.model, task.mechanics, reach, setting.limits, library=library)
    return best, plan.cost if isinstance(plan, ReachPlan) else np.inf


def timed(
    plan: Callable[[Reach], ReachPlan | Failure], reaches: list[Reach]
) -> tuple[list[ReachPlan | Failure], Array]:
    """Plans and their planning times, ms, after one plan that is not timed."""
    plan(reaches[0])
    plans, times = [], []
    for reach in reaches:
        before = time.perf_counter()
        plans.append(plan(reach))
        times.append(1e3 * (time.perf_counter() - before))
    return plans, np.array(times)


def compared(
    setting: ReachSetting, reaches: list[Reach], plans: list[ReachPlan | Failure], times: Array, best: Array
) -> tuple[list[str], Counter[str]]:
    """Cells of a row and counts of failure causes; `best` (K, 2) from `best_known`."""
    task = SingleArmTask()
    model, robot = task.model, task.mechanics
    causes = Counter(str(plan.cause) for plan in plans if isinstance(plan, Failure))
    checked = [
        check(model, robot, reach, setting.limits, plan) if isinstance(plan, ReachPlan) else None
        for reach, plan in zip(reaches, plans, strict=True)
    ]
    solvable = np.isfinite(np.asarray(best.min(axis=1)))
    pairs = [(one, least) for one, least in zip(checked, best, strict=True) if one is not None]
    ratio = np.array([one.cost / min(least[0], one.cost) for one, least in pairs])
    to_collocation = [one.cost / least[1] for one, least in pairs if np.isfinite(least[1])]
    position, rotation, attitude = (
        np.array([one.violation[name] for one, _ in pairs])
        for name in ("position_error", "rotation_error", "end_attitude")
    )
    solved = sum(one is not None for one, ok in zip(checked, solvable, strict=True) if ok)
    cells = [
        f"{solved} of {solvable.sum()}",
        f"{np.median(ratio):.3f}",
        f"{np.percentile(ratio, 90):.3f}",
        f"{ratio.max():.2f}",
        f"{np.median(to_collocation):.3f}" if to_collocation else "-",
        f"{1e3 * position.max():.2f}",
        f"{np.rad2deg(rotation.max()):.3f}",
        f"{np.rad2deg(attitude.max() if setting.keep_attitude else np.median(attitude)):.3f}",
        f"{np.median(times):.1f}",
        f"{np.percentile(times, 95):.1f}",
    ]
    return cells, causes


def evaluation_time(repeats: int = 500) -> float:
    """Time, ms, of the compiled twists with derivatives along a motion, which every iteration evaluates."""
    functions = ArmFunctions.of(SingleArmTask().mechanics, INTERVALS)
    q = np.random.default_rng(0).standard_normal((2 * INTERVALS, 7))
    functions.slopes(q, q)
    before = time.perf_counter()
    for _ in range(repeats):
        functions.slopes(q, q)
    return 1e3 * (time.perf_counter() - before) / repeats


def table_of_goals(goals: dict[str, int], split: str, jobs: int, collocation: bool) -> None:
    """Print the planner's results against the best known motions."""
    rows, failures = [], []
    for difficulty, count in goals.items():
        for limited in (False, True):
            for keep_attitude in (False, True):
                setting = ReachSetting(difficulty, keep_attitude, limited)
                reaches = setting.reaches(split, count)
                task = SingleArmTask()
                library, wide = (library_of(task.robot, keep_attitude, x) for x in (limited, False))
                planner = OptimalPlanner(task.mechanics, setting.limits, library, reserve=wide)
                plans, times = timed(planner.plan, reaches)
                work = (
                    delayed(best_known)(setting, reach, number, collocation)
                    for number, reach in enumerate(reaches)
                )
                bar = tqdm(total=count, unit="goal", desc=" ".join(setting.cells), leave=False)
                best = []
                for costs in Parallel(n_jobs=jobs, return_as="generator")(work):
                    best.append(costs)
                    bar.update()
                bar.close()
                cells, causes = compared(setting, reaches, plans, times, np.array(best))
                rows.append([*setting.cells, *cells])
                failures += [f"{', '.join(setting.cells)}: {n} {cause}" for cause, n in causes.items()]
    head = ["goals", "limits", "attitude", "solved", "cost ratio, median", "90 %", "worst", "to ocp, median"]
    head += ["goal error, mm"]
    head += ["deg", "final attitude error, deg", "planning, ms", "95 %"]
    print(markdown_table(head, rows))
    print(f"\nFailures: {'; '.join(failures) or 'none'}.")


def table_of_initial_guesses(count: int) -> None:
    """Print the effect of stored initial guesses on validation goals, within the model's limits."""
    rows = []
    for keep_attitude in (False, True):
        setting = ReachSetting("medium", keep_attitude, True)
        reaches = setting.reaches("validation", count)
        library, robot = library_of(SingleArmTask().robot, keep_attitude), SingleArmTask().mechanics
        planners = {
            "none stored": OptimalPlanner(robot, setting.limits),
            "nearest": OptimalPlanner(robot, setting.limits, library, candidates=1, improved=1),
            "best of 8 nearest": OptimalPlanner(robot, setting.limits, library, candidates=8, improved=1),
            "best 2 of 8 nearest": OptimalPlanner(robot, setting.limits, library, candidates=8, improved=2),
            "best 4 of 16 nearest": OptimalPlanner(robot, setting.limits, library, candidates=16, improved=4),
        }
        results = {name: timed(planner.plan, reaches) for name, planner in planners.items()}
        costs = {
            name: np.array([plan.cost if isinstance(plan, ReachPlan) else np.inf for plan in plans])
            for name, (plans, _) in results.items()
        }
        best = np.min(list(costs.values()), axis=0)
        for name, cost in costs.items():
            ratio, times = cost / best, results[name][1]
            rows.append(
                [
                    setting.cells[2],
                    name,
                    f"{np.isfinite(cost).sum()} of {count}",
                    f"{np.median(ratio):.3f}",
                    f"{np.percentile(ratio, 90):.3f}",
                    f"{np.median(times):.1f}",
                ]
            )
    head = ["attitude", "initial guesses", "solved", "cost ratio, median", "90 %", "planning, ms"]
    print(markdown_table(head, rows))


def main() -> None:
    """Print both tables."""
    parser = Parser(prog="python -m benchmarks.optimal", description=__doc__)
    parser.add_argument(
        "--goals", type=whole, default=100, help="medium goals; half as many easy and hard ones (default 100)"
    )
    parser.add_argument(
        "--jobs", type=whole, default=2, help="processes for the reference (default %(default)s)"
    )
    parser.add_argument("--split", type=split, default="test", help="default %(default)s")
    parser.add_argument("--no-ocp", action="store_true", help="do not use collocation in the reference")
    options = parser.parse_args()
    check_goals("SpaceCapture/SingleArm-v0", options.split, options.goals)
    half = max(1, options.goals // 2)
    goals = {"medium": options.goals, "hard": half, "easy": half}
    table_of_goals(goals, options.split, options.jobs, not options.no_ocp)
    print(f"\nOne evaluation of the base's twists with derivatives: {evaluation_time():.3f} ms.\n")
    table_of_initial_guesses(half)
    print(f"\n{machine_class()}, one thread a plan.")


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.optimal", main))
