"""FATROP on a multiple-shooting program of one arm's optimal control, against Ipopt and the collocation."""

import contextlib
import io
import re
import sys
import time
from dataclasses import astuple, dataclass
from typing import Any

import casadi as ca
import numpy as np
from tqdm import tqdm

from agents.demonstrations.optimal.library import robot_limits
from agents.planners.common.plans import Failure, Limits
from agents.planners.single_arm.collocation.assembly import SCALE, Assembly, OptionalConstraints
from agents.planners.single_arm.collocation.mesh import INTERVALS
from agents.planners.single_arm.collocation.program import IPOPT
from agents.planners.single_arm.collocation.solver import MARGIN, TOLERANCE, ReachSolution, ReachSolver
from agents.planners.single_arm.library import library_of
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from benchmarks.arguments import check_goals, split, whole
from benchmarks.machine import machine_class, markdown_table
from benchmarks.shooting_program import STEP, equalities, shooting_functions
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array
from space_envs.system.command_line import Parser, exit_status
from space_envs.system.threads import ipopt_on_one_thread
from space_envs.tasks.single_arm import SingleArmTask

PROGRAM = OptionalConstraints(rates=True, torques=(), spheres=0)  # of the collocation that is compared
COLLOCATION = "collocation, Ipopt (`ocp`)"
SOLVERS = {"fatrop": "multiple shooting, FATROP", "ipopt": "multiple shooting, Ipopt"}
COMMON = {key: IPOPT[key] for key in ("tol", "max_iter", "mu_init")}
DIFFICULTIES = ("medium", "hard")
REPEATS = 3  # of a solve
TIMED = {**IPOPT, "print_level": 3, "print_timing_statistics": "yes"}  # the statistics are only printed


@dataclass(frozen=True)
class Solve:
    """Figures of one solve.

    Attributes:
        cost: m^2/s, infinite where the constraints are violated or the solver reports no success.
        iterations: of the solver. time: of the processor in all, ms. functions: in the program's functions,
            ms. directions: in search directions, that is, in linear systems, ms.
    """

    cost: float
    iterations: int
    time: float
    functions: float
    directions: float


def solve(solver: ca.Function, inputs: dict[str, Array], duration: float) -> Solve:
    """Figures of the fastest of a few solves from the inputs of the solver."""
    return min((_solve(solver, inputs, duration) for _ in range(REPEATS)), key=lambda each: each.time)


def _solve(solver: ca.Function, inputs: dict[str, Array], duration: float) -> Solve:
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        before = time.thread_time()
        found = solver(**inputs)
        taken = time.thread_time() - before
    stats, g = solver.stats(), found["g"].full()[:, 0]
    violation = np.maximum(inputs["lbg"] - g, g - inputs["ubg"]).max()
    cost = float(found["f"]) / SCALE / duration if stats["success"] and violation < TOLERANCE else np.inf
    functions = sum(value for key, value in stats.items() if key.startswith("t_proc_nlp_"))
    if "fatrop" in stats:  # its clock is the wall's: only shares are of use where the processor is busy
        directions = taken * stats["fatrop"]["compute_sd_time"] / stats["fatrop"]["time_total"]
    else:
        line = re.search(r"ComputeSearchDirection\.*: +([\d.]+)", printed.getvalue())
        directions = float(line[1]) if line else np.nan
    return Solve(cost, int(stats["iter_count"]), 1e3 * taken, 1e3 * functions, 1e3 * directions)


def shooting(robot: FloatingRobot, name: str) -> ca.Function:
    """A solver of the shooting program by name: fatrop or ipopt."""
    functions = shooting_functions(robot)
    options: dict[str, Any] = {"print_time": False, "calc_lam_p": False}
    if name == "fatrop":
        options |= {"structure_detection": "auto", "equality": equalities(robot.n_joints)}
        options["fatrop"] = {"print_level": 0, **COMMON}
    else:
        ipopt_on_one_thread()
        options |= {"grad_f": functions["grad_f"], "jac_g": functions["nlp_jac_g"]}
        options |= {"hess_lag": functions["hess_lag"], "ipopt": TIMED}
    return ca.nlpsol("solver", name, functions["nlp"], options)


def shooting_inputs(collocation: ReachSolver, guess: Array, limits: Limits) -> dict[str, Array]:
    """Inputs of the shooting program's solvers for the collocation's problem and variables."""
    reach, n = collocation.reach, len(collocation.reach.start)
    given, t = collocation.inputs(guess, np.zeros(n)), reach.duration  # p: fixed coefficients, then the same
    motion = collocation.motion(ReachSolution(0.0, guess, np.zeros(n)))
    q, slope, curve = motion.position, motion.rate * t, motion.acceleration * t**2
    r = np.concatenate([np.zeros((1, 3)), guess[-3 * INTERVALS :].reshape(-1, 3)])
    first = [q + STEP * slope + STEP**2 / 3.0 * curve, slope + STEP / 2.0 * curve]
    x = np.concatenate([*first, curve, r], axis=1)
    jerk = np.diff(curve, axis=0) / STEP
    low, high = limits.angles(n).T
    constraints = np.zeros(len(equalities(n)))
    return {
        "x0": np.concatenate([np.concatenate([x[:-1], jerk], axis=1).ravel(), x[-1]]),
        "p": np.concatenate([reach.start, slope[0], given["p"][3 * n :]]),
        "lbx": -_bounds(-low, limits, t),
        "ubx": _bounds(high, limits, t),
        "lbg": np.concatenate([constraints[:-n], low]),
        "ubg": np.concatenate([constraints[:-n], high]),
    }


def _bounds(angles: Array, limits: Limits, t: float) -> Array:
    """Upper bounds on the shooting program's variables for a duration, s.

    The last coefficients of angles and rates that come into play belong to no interval any more.
    """
    n = len(angles)
    rates, accelerations = (
        np.full(n, np.inf if most is None else most) * t**order * (1.0 - MARGIN)
        for order, most in ((1, limits.rate), (2, limits.acceleration))
    )
    parts = [np.tile(part, (INTERVALS + 1, 1)) for part in (angles, rates, accelerations)]
    parts[0][-2:], parts[1][-1:] = np.inf, np.inf
    free = np.full((INTERVALS + 1, 3 + n), np.inf)  # attitude and jerk
    return np.concatenate([*parts, free], axis=1).ravel()[:-n]


def compared(split: str, count: int, difficulty: str = "medium") -> dict[str, list[Solve]]:
    """Figures on goals by label, from the motions in the weights of a ProMP, within the limits."""
    task = SingleArmTask(difficulty=difficulty)
    robot, drives = task.mechanics, robot_limits(task.robot)
    limits = Limits(position=drives.position, rate=drives.rate, acceleration=drives.acceleration)
    planner = OptimalPlanner(robot, limits, library_of(task.robot, False))
    reference = Assembly(robot, PROGRAM).program().solver({"print_time": False, "ipopt": TIMED})
    solvers = {label: shooting(robot, name) for name, label in SOLVERS.items()}
    results: dict[str, list[Solve]] = {label: [] for label in (COLLOCATION, *solvers)}
    goals = task.goals(split, np.arange(count))
    for pose in tqdm(zip(goals.position, goals.quaternion, strict=True), total=count, leave=False):
        reach = Reach(robot.home, Grapple.at_rest(*pose), c=task.c).checked(robot)
        plan = planner.plan(reach)
        if isinstance(plan, Failure):
            continue
        collocation = ReachSolver(robot, reach, limits)
        guess = collocation.fitted(plan)
        inputs = collocation.inputs(guess, np.zeros(robot.n_joints))
        results[COLLOCATION].append(solve(reference, inputs, reach.duration))
        inputs = shooting_inputs(collocation, guess, limits)
        for label, solver in solvers.items():
            results[label].append(solve(solver, inputs, reach.duration))
    return results


def rows_of(difficulty: str, results: dict[str, list[Solve]]) -> list[list[str]]:
    """Rows of the table, one a solver."""
    rows, reference = [], np.array([each.cost for each in results[COLLOCATION]])
    for label, found in results.items():
        cost, *others = np.array([astuple(each) for each in found], dtype=np.float64).T
        iterations, taken, functions, directions = others
        ratio = (cost / reference)[np.isfinite(cost) & np.isfinite(reference)]
        rows.append(
            [
                difficulty,
                label,
                f"{np.isfinite(cost).sum()} of {len(cost)}",
                f"{ratio.min():.4f} to {ratio.max():.4f}" if len(ratio) else "-",
                f"{np.median(iterations):.0f}",
                f"{np.percentile(iterations, 95):.0f}",
                f"{np.median(functions):.1f}",
                f"{np.median(directions):.1f}",
                f"{np.median(taken):.1f}",
                f"{np.percentile(taken, 95):.1f}",
                f"{taken.mean():.1f}",
            ]
        )
    return rows


def main() -> None:
    """Print the table."""
    parser = Parser(prog="python -m benchmarks.shooting", description=__doc__)
    parser.add_argument("--goals", type=whole, default=40, help="of each difficulty (default %(default)s)")
    parser.add_argument("--split", type=split, default="validation", help="default %(default)s")
    options = parser.parse_args()
    check_goals("SpaceCapture/SingleArm-v0", options.split, options.goals)
    rows = []
    for difficulty in DIFFICULTIES:
        rows += rows_of(difficulty, compared(options.split, options.goals, difficulty))
    head = ["goals", "program and solver", "solved", "cost ratio", "iterations, median", "95 %"]
    head += ["functions, ms", "search directions, ms", "in all, ms", "95 %", "mean"]
    print(markdown_table(head, rows))
    print(f"\n{options.goals} {options.split} goals each, processor time, {machine_class()}, one thread.")


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.shooting", main))
