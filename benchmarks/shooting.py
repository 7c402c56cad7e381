"""FATROP on a multiple-shooting transcription of one arm's optimal control, against the collocation."""

import sys
import time
from typing import Any

import casadi as ca
import numpy as np

from agents.demonstrations.optimal.library import robot_limits
from agents.planners.common.plans import Failure, Limits
from agents.planners.single_arm.collocation.assembly import SCALE, SMOOTHING, OptionalConstraints
from agents.planners.single_arm.collocation.interval import GAUSS
from agents.planners.single_arm.collocation.mesh import INTERVALS
from agents.planners.single_arm.collocation.model import rotated
from agents.planners.single_arm.collocation.program import ReachProgram
from agents.planners.single_arm.collocation.solver import ReachSolver
from agents.planners.single_arm.library import library_of
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from benchmarks.arguments import check_goals, split, whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.dynamics import FloatingRobot, roll_out_base
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array, to_matrix
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.system.command_line import Parser, exit_status
from space_envs.tasks.single_arm import SingleArmTask

STEP = 1.0 / INTERVALS  # of s, as in the collocation
ITERATIONS = 300
PROGRAM = OptionalConstraints(rates=True, torques=(), spheres=0)  # of the collocation that is compared
SOLVERS: dict[str, dict[str, Any]] = {
    "fatrop": {
        "print_time": False,
        "structure_detection": "auto",
        "fatrop": {"print_level": 0, "tol": 1e-6, "max_iter": ITERATIONS, "mu_init": 1e-2},
    },
    "ipopt": {
        "print_time": False,
        "ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-6, "max_iter": ITERATIONS, "mu_init": 1e-2},
    },
}


LABELS = {
    "collocation": "collocation, Ipopt, compiled functions (`ocp`)",
    "fatrop": "multiple shooting, FATROP, interpreted functions",
    "ipopt": "multiple shooting, Ipopt, interpreted functions",
}


def stage(robot: FloatingRobot) -> ca.Function:
    """One interval: state [q, q', q''; r], jerk and c^2 -> next state and the summand of the objective.

    Motions are the same cubic splines as in the collocation, by constant jerk; the quadrature too.
    """
    n, symbolic = robot.n_joints, SymbolicRobot(robot)
    x, jerk, c2 = ca.SX.sym("x", 3 * n + 3), ca.SX.sym("jerk", n), ca.SX.sym("c2")
    q, slope, curve, r = x[:n], x[n : 2 * n], x[2 * n : 3 * n], x[3 * n :]
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS)
    cost, rotation, spins = ca.SX(0.0), ca.SX(3, 1), []
    for node, weight in zip(nodes, weights, strict=True):
        t = 0.5 * STEP * (1.0 + node)
        at = q + t * slope + t**2 / 2.0 * curve + t**3 / 6.0 * jerk
        twist = symbolic.base_twist(at, slope + t * curve + t**2 / 2.0 * jerk)
        share = 0.5 * STEP * weight
        cost += share * (ca.dot(twist[:3], twist[:3]) + c2 * ca.dot(twist[3:], twist[3:]))
        rotation += share * twist[3:]
        spins.append(twist[3:])
    rotation += STEP**2 / (6.0 * (nodes[-1] - nodes[0])) * ca.cross(spins[0], spins[-1])
    square = ca.dot(rotation, rotation)
    gibbs = 0.5 * rotation * (1.0 + square / 12.0 + square * square / 120.0)
    turned = (r + gibbs + ca.cross(r, gibbs)) / (1.0 - ca.dot(r, gibbs))
    last = curve + STEP * jerk
    bent = ca.dot(curve, curve) + ca.dot(curve, last) + ca.dot(last, last)
    after = [q + STEP * slope + STEP**2 / 2.0 * curve + STEP**3 / 6.0 * jerk]
    after += [slope + STEP * curve + STEP**2 / 2.0 * jerk, last, turned]
    summand = SCALE * (cost + 0.5 * SMOOTHING * STEP / 3.0 * bent)
    return ca.Function("stage", [x, jerk, c2], [ca.vertcat(*after), summand])


def ending(robot: FloatingRobot) -> ca.Function:
    """State at the end, the system's centre of mass and the goal (12) -> errors (6) of the end-effector."""
    n, symbolic = robot.n_joints, SymbolicRobot(robot)
    x, com, goal = ca.SX.sym("x", 3 * n + 3), ca.SX.sym("com", 3), ca.SX.sym("goal", 12)
    _, _, _, _, middle = symbolic.kinematics(x[:n])
    place, axes = symbolic.end_effector_pose()(x[:n])
    r = x[3 * n :]
    attitude = ca.horzcat(*[rotated(r, axes[:, i]) for i in range(3)])
    deviation = ca.reshape(goal[3:], 3, 3).T @ attitude
    error = com + rotated(r, place - middle) - goal[:3]
    sines = ca.inv_skew(0.5 * (deviation - deviation.T))
    return ca.Function("ending", [x, com, goal], [ca.vertcat(error, sines)])


class Shooting:
    """Program over states and jerks, stage by stage, with one of the solvers."""

    def __init__(self, robot: FloatingRobot, limits: Limits, name: str) -> None:
        self._robot, self._limits, n = robot, limits, robot.n_joints
        forward, end = stage(robot), ending(robot)
        p = ca.MX.sym("p", 2 * n + 16)
        start, com, goal, c2 = p[: 2 * n], p[2 * n : 2 * n + 3], p[2 * n + 3 : 2 * n + 15], p[2 * n + 15]
        states = [ca.MX.sym(f"x{k}", 3 * n + 3) for k in range(INTERVALS + 1)]
        jerks = [ca.MX.sym(f"u{k}", n) for k in range(INTERVALS)]
        rows, f = [], ca.MX(0.0)
        for k in range(INTERVALS):
            after, summand = forward(states[k], jerks[k], c2)
            rows.append(states[k + 1] - after)
            f += summand
            if k == 0:
                rows.append(ca.vertcat(states[0][: 2 * n] - start, states[0][3 * n :]))
        rows.append(ca.vertcat(end(states[-1], com, goal), states[-1][n : 2 * n]))
        pairs = [each for pair in zip(states, jerks, strict=False) for each in pair]
        program = {"x": ca.vertcat(*pairs, states[-1]), "p": p, "f": f, "g": ca.vertcat(*rows)}
        options = SOLVERS[name]
        if name == "fatrop":
            options = {**options, "equality": [True] * program["g"].numel()}
        self.solver = ca.nlpsol("solver", name, program, options)

    def solve(self, reach: Reach, plan: ReachPlan, com: Array) -> tuple[float, bool, int, float, float]:
        """Cost, m^2/s, success, iterations, time in all, ms, and time in the program's functions, ms."""
        t, n = reach.duration, self._robot.n_joints
        axes, rate = to_matrix(reach.end.quaternion), np.zeros(n) if reach.rate is None else reach.rate
        p = np.concatenate([reach.start, rate * t, com, reach.end.position, axes.T.ravel(), [reach.c**2]])
        before = time.perf_counter()
        found = self.solver(x0=self._guess(reach, plan), p=p, lbg=0.0, ubg=0.0, **self._bounds(t))
        taken = time.perf_counter() - before
        iterations, inside = figures(self.solver)
        cost = float(found["f"]) / SCALE / t
        return cost, bool(self.solver.stats()["success"]), iterations, 1e3 * taken, inside

    def _guess(self, reach: Reach, plan: ReachPlan) -> Array:
        """States and jerks of a plan."""
        t = reach.duration
        fine = np.linspace(0.0, t, 10 * INTERVALS + 1)
        q, rate, acceleration = plan.sample(fine)
        turned = roll_out_base(self._robot, q, rate, float(fine[1]))[1]
        r = turned[:, 1:] / turned[:, :1]
        x = np.concatenate([q, rate * t, acceleration * t**2, r], axis=1)[::10]
        n = self._robot.n_joints
        jerk = np.diff(x[:, 2 * n : 3 * n], axis=0) / STEP
        return np.concatenate([np.concatenate([x[:-1], jerk], axis=1).ravel(), x[-1]])

    def _bounds(self, t: float) -> dict[str, Array]:
        """Bounds on the variables for a duration, s."""
        n, limits = self._robot.n_joints, self._limits
        low, high = limits.angles(n).T
        rate, acceleration = (
            np.full(n, np.inf) if most is None else np.broadcast_to(most, n) * t**order
            for order, most in ((1, limits.rate), (2, limits.acceleration))
        )
        free = np.full(n + 3, np.inf)  # attitude and jerk
        upper = np.tile(np.concatenate([high, rate, acceleration, free]), INTERVALS + 1)[:-n]
        lower = np.tile(np.concatenate([low, -rate, -acceleration, -free]), INTERVALS + 1)[:-n]
        return {"lbx": lower, "ubx": upper}


def figures(solver: ca.Function) -> tuple[int, float]:
    """Iterations of the last call of a solver, and the time in the program's functions, ms."""
    stats = solver.stats()
    inside = sum(value for key, value in stats.items() if key.startswith("t_wall_nlp_"))
    return int(stats["iter_count"]), 1e3 * inside


Row = tuple[float, bool, int, float, float]
"""Cost, m^2/s, success, iterations, time in all and time in the program's functions, ms."""


def compared(split: str, count: int) -> dict[str, list[Row]]:
    """Results on medium goals by solver, from the motions in the weights of a ProMP, within the limits."""
    task = SingleArmTask()
    drives = robot_limits(task.robot)
    limits = Limits(position=drives.position, rate=drives.rate, acceleration=drives.acceleration)
    planner = OptimalPlanner(task.mechanics, limits, library_of(task.robot, False))
    goals = task.goals(split, np.arange(count))
    shootings = {name: Shooting(task.mechanics, limits, name) for name in SOLVERS}
    results: dict[str, list[Row]] = {"collocation": []}
    results |= {name: [] for name in shootings}
    for position, quaternion in zip(goals.position, goals.quaternion, strict=True):
        reach = Reach(task.mechanics.home, Grapple.at_rest(position, quaternion), c=task.c).checked(
            task.mechanics
        )
        plan = planner.plan(reach)
        if isinstance(plan, Failure):
            continue
        collocation = ReachSolver(task.mechanics, reach, limits)
        com = collocation.model.com(reach.start).full()[:, 0]
        guess = collocation.fitted(plan)
        before = time.perf_counter()
        found = collocation.solve(guess)
        taken = 1e3 * (time.perf_counter() - before)
        cost = np.inf if isinstance(found, Failure) else found.cost
        iterations, inside = figures(ReachProgram.of(task.mechanics, PROGRAM).solver)
        results["collocation"].append((cost, np.isfinite(cost), iterations, taken, inside))
        for name, shooting in shootings.items():
            results[name].append(shooting.solve(reach, plan, com))
    return results


def table(results: dict[str, list[Row]]) -> str:
    """Markdown table of the results."""
    rows, reference = [], np.array([each[0] for each in results["collocation"]])
    for name, label in LABELS.items():
        cost, solved, iterations, taken, inside = np.array(results[name], dtype=np.float64).T
        ratio = (cost / reference)[(solved > 0.0) & np.isfinite(reference)]
        rows.append(
            [
                label,
                f"{int(solved.sum())} of {len(cost)}",
                f"{np.median(ratio):.4f}" if len(ratio) else "-",
                f"{ratio.max():.3f}" if len(ratio) else "-",
                f"{np.median(iterations):.0f}",
                f"{np.median(taken):.1f}",
                f"{np.median(taken - inside):.1f}",
            ]
        )
    head = ["program and solver", "solved", "cost ratio, median", "worst", "iterations", "time, ms"]
    return markdown_table([*head, "without functions, ms"], rows)


def main() -> None:
    """Print the table."""
    parser = Parser(prog="python -m benchmarks.shooting", description=__doc__)
    parser.add_argument("--goals", type=whole, default=20, help="medium goals (default %(default)s)")
    parser.add_argument("--split", type=split, default="test", help="default %(default)s")
    options = parser.parse_args()
    check_goals("SpaceCapture/SingleArm-v0", options.split, options.goals)
    results = compared(options.split, options.goals)
    print(table(results))
    print(f"\n{options.goals} medium {options.split} goals, {machine_class()}, one thread.")


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.shooting", main))
