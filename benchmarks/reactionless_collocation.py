"""Reactionless plans against the optimum of a collocation with a model and a transcription of its own.

Joint angles, rates and accelerations at the ends and in the middle of even intervals are the variables of a
nonlinear program (rules of Hermite and Simpson), which Ipopt solves: the least eq. 20 subject to no angular
velocity of the base, to the goal pose, and to the limits of angles, rates and accelerations. Angular
momentum, centre of mass and end-effector come from the bodies of the compiled model; only the model, the
limits and the problem are shared with the planner.
"""

import sys
from dataclasses import dataclass, replace
from typing import NamedTuple

import casadi as ca
import mujoco
import numpy as np
from scipy.interpolate import CubicHermiteSpline
from tqdm import tqdm

from agents.planners.common.plans import Failure, Limits
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.policies.single_arm.optimal import reaches
from agents.policies.single_arm.reactionless.policy import PrompReactionless
from agents.policies.single_arm.reactionless.problem import latest_arrival, path_limits
from benchmarks.arguments import check_goals, split, whole
from benchmarks.machine import machine_class, markdown_table
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.policy import PolicyContext
from space_envs.system.command_line import Parser, exit_status

ENV = "SpaceCapture/SingleArm-v0"
SATELLITE, END_EFFECTOR = "satellite", "end_effector"
INTERVALS = 30
DENSE = 601  # samples at which motions are measured
ITERATIONS = 300
UNIT = 1e-4  # m^2/s, of eq. 20 times dt in the objective


class Motion(NamedTuple):
    """Joint angles, rates and accelerations (2 N + 1, n) at the ends and in the middle of N intervals."""

    q: Array
    rate: Array
    acceleration: Array


class Measured(NamedTuple):
    """Measurements of a motion between its samples, by MuJoCo's mass matrix and kinematics.

    Attributes:
        cost: eq. 20 times dt, m^2/s. peak: largest angular velocity of the base, rad/s. error: of the
            end-effector at the end, the larger one of m and rad.
    """

    cost: float
    peak: float
    error: float


class CollocationResult(NamedTuple):
    """Status of Ipopt and what it found."""

    status: str
    motion: Motion
    measured: Measured


@dataclass(frozen=True, eq=False)
class Collocation:
    """Reactionless motions of the arm of a compiled model, a satellite with n hinges, within limits."""

    model: mujoco.MjModel
    limits: Limits

    def sampled(self, plan: ReachPlan) -> Motion:
        """A plan at the times of the program."""
        return Motion(*plan.sample(np.linspace(0.0, plan.time[-1], 2 * INTERVALS + 1)))

    def joint_motion(self, start: Array, end: Array, duration: float) -> Motion:
        """The straight minimum-jerk motion between joint angles (n,), which rotates the base."""
        s = np.linspace(0.0, 1.0, 2 * INTERVALS + 1)[:, None]
        way = end - start
        shapes = s**3 * (10 - 15 * s + 6 * s**2), 30 * s**2 * (1 - s) ** 2, 60 * s * (1 - s) * (1 - 2 * s)
        return Motion(start + shapes[0] * way, shapes[1] * way / duration, shapes[2] * way / duration**2)

    def solve(self, reach: Reach, near: Motion) -> CollocationResult:
        """The optimum near a motion."""
        unknown = [ca.MX.sym(name, self.model.nu, 2 * INTERVALS + 1) for name in Motion._fields]
        cost, equations = self._program(reach, *unknown)
        program = {"x": ca.veccat(*unknown), "f": cost / UNIT, "g": equations}
        settings = {"max_iter": ITERATIONS, "print_level": 0, "sb": "yes", "tol": 1e-6}
        solver = ca.nlpsol("solver", "ipopt", program, {"ipopt": settings, "print_time": False})
        lower, upper = self.bounds(reach)
        found = solver(x0=np.stack(near).ravel(), lbx=lower.ravel(), ubx=upper.ravel(), lbg=0.0, ubg=0.0)
        motion = Motion(*np.asarray(found["x"]).reshape(3, -1, self.model.nu))
        return CollocationResult(solver.stats()["return_status"], motion, self.measured(reach, motion))

    def _program(self, reach: Reach, q: ca.MX, rate: ca.MX, acceleration: ca.MX) -> tuple[ca.MX, ca.MX]:
        """Eq. 20 times dt, and equations: rules of the intervals, no base rate, and the goal."""
        along, end = momentum_functions(self.model)
        h = reach.duration / INTERVALS
        spin, square = along.map(2 * INTERVALS + 1)(q, rate)
        rules = []
        for value, slope in ((q, rate), (rate, acceleration)):
            first, middle, last = value[:, :-1:2], value[:, 1::2], value[:, 2::2]
            before, between, after = slope[:, :-1:2], slope[:, 1::2], slope[:, 2::2]
            rules += [
                middle - (first + last) / 2 - h / 8 * (before - after),
                last - first - h / 6 * (before + 4 * between + after),
            ]
        miss = _miss(end.call([reach.start]), end.call([q[:, -1]]), reach)
        cost = h / 6 * ca.sum2(square[:, :-1:2] + 4 * square[:, 1::2] + square[:, 2::2])
        return cost, ca.veccat(*rules, spin[:, 1:-1], miss)  # at rest the momentum vanishes at both ends

    def bounds(self, reach: Reach) -> tuple[Array, Array]:
        """Bounds (3, 2 N + 1, n) of the unknowns: the limits, and rest at both ends."""
        upper = np.full((3, 2 * INTERVALS + 1, self.model.nu), np.inf)
        lower = -upper
        lower[0], upper[0] = self.limits.angles(self.model.nu).T
        for row, limit in ((1, self.limits.rate), (2, self.limits.acceleration)):
            if limit is not None:
                lower[row], upper[row] = -limit, limit
        for bound in (lower, upper):
            bound[0, 0], bound[1, 0], bound[1, -1] = reach.start, 0.0, 0.0
        return lower, upper

    def measured(self, reach: Reach, motion: Motion) -> Measured:
        """Measurements of a motion, interpolated by its angles and rates."""
        nodes, dense = (np.linspace(0.0, reach.duration, count) for count in (len(motion.q), DENSE))
        spline = CubicHermiteSpline(nodes, motion.q, motion.rate)
        q, rate = spline(dense), spline(dense, 1)
        data, n, twist = mujoco.MjData(self.model), self.model.nu, np.empty((DENSE, 6))
        mass = np.empty((self.model.nv, self.model.nv))
        for k in range(DENSE):
            self._place(data, q[k])
            mujoco.mj_makeM(self.model, data)
            mujoco.mj_fullM(self.model, data, mass)
            twist[k] = -np.linalg.solve(mass[:6, :6], mass[:6, 6 : 6 + n] @ rate[k])
        square = (twist[:, :3] ** 2).sum(axis=1) + reach.c**2 * (twist[:, 3:] ** 2).sum(axis=1)
        peak = float(np.linalg.norm(twist[:, 3:], axis=1).max())
        return Measured(float(np.trapezoid(square, dense)), peak, self._error(data, reach, q[-1]))

    def _place(self, data: mujoco.MjData, q: Array) -> None:
        """Joint angles (n,) with the satellite at the origin."""
        data.qpos[:7], data.qpos[7 : 7 + len(q)] = [0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], q
        mujoco.mj_kinematics(self.model, data)
        mujoco.mj_comPos(self.model, data)

    def _error(self, data: mujoco.MjData, reach: Reach, q: Array) -> float:
        """Goal error of the end-effector after a motion that has not rotated the base, m or rad."""
        satellite, site = self.model.body(SATELLITE).id, self.model.site(END_EFFECTOR).id
        self._place(data, reach.start)
        centre = data.subtree_com[satellite].copy()
        self._place(data, q)
        place = data.site_xpos[site] + centre - data.subtree_com[satellite]
        goal, turned, angle = reach.end, np.empty(4), np.empty(3)
        mujoco.mju_mat2Quat(turned, data.site_xmat[site])
        mujoco.mju_subQuat(angle, turned, goal.quaternion)
        return max(float(np.linalg.norm(place - goal.position)), float(np.linalg.norm(angle)))


def momentum_functions(model: mujoco.MjModel) -> tuple[ca.Function, ca.Function]:
    """q, rate -> angular momentum, squared speed of the base; q -> centre, place and rotation of the end."""
    q, rate = ca.SX.sym("q", model.nu), ca.SX.sym("rate", model.nu)
    frames = _frames(model, q)
    site = model.site(END_EFFECTOR)
    total, moment, momentum, spin = 0.0, ca.SX.zeros(3), ca.SX.zeros(3), ca.SX.zeros(3)
    for body, (place, turn, joints) in frames.items():
        mass, at = float(model.body_mass[body]), place + turn @ ca.DM(model.body_ipos[body])
        rates = [(axis * rate[j], origin) for axis, origin, j in joints]
        omega = sum((each for each, _ in rates), ca.SX.zeros(3))
        velocity = sum((ca.cross(each, at - origin) for each, origin in rates), ca.SX.zeros(3))
        principal = turn @ ca.DM(_matrix(model.body_iquat[body]))
        inertia = principal @ ca.diag(ca.DM(model.body_inertia[body])) @ principal.T
        total, moment, momentum = total + mass, moment + mass * at, momentum + mass * velocity
        spin += inertia @ omega + mass * ca.cross(at, velocity)
    centre, drift = moment / total, -momentum / total
    place, turn, _ = frames[int(site.bodyid[0])]
    at, axes = place + turn @ ca.DM(site.pos), turn @ ca.DM(_matrix(site.quat))
    along = ca.Function("along", [q, rate], [spin - ca.cross(centre, momentum), ca.dot(drift, drift)])
    return along, ca.Function("end", [q], [centre, at, axes])


class _Frame(NamedTuple):
    """Position (3) and rotation (3, 3) of a body, and axis and place of each joint that carries it."""

    place: ca.SX
    turn: ca.SX
    joints: list[tuple[ca.SX, ca.SX, int]]


def _frames(model: mujoco.MjModel, q: ca.SX) -> dict[int, _Frame]:
    """Frames of the satellite and of the bodies that it carries, in its own frame."""
    satellite = int(model.body(SATELLITE).id)
    frames = {satellite: _Frame(ca.SX.zeros(3), ca.SX.eye(3), [])}
    hinges = [k for k in range(model.njnt) if model.jnt_type[k] == mujoco.mjtJoint.mjJNT_HINGE]
    for body in range(satellite + 1, model.nbody):
        if (parent := int(model.body_parentid[body])) not in frames:
            continue
        below = frames[parent]
        place = below.place + below.turn @ ca.DM(model.body_pos[body])
        turn, joints = below.turn @ ca.DM(_matrix(model.body_quat[body])), list(below.joints)
        for number, hinge in enumerate(hinges):
            if model.jnt_bodyid[hinge] == body:
                joints.append((turn @ ca.DM(model.jnt_axis[hinge]), place, number))
                turn = turn @ _rotation(model.jnt_axis[hinge], q[number])
        frames[body] = _Frame(place, turn, joints)
    return frames


def _rotation(axis: Array, angle: ca.SX) -> ca.SX:
    """Rotation (3, 3) about a unit axis (Rodrigues)."""
    cross = ca.skew(ca.DM(axis))
    return ca.SX.eye(3) + ca.sin(angle) * cross + (1.0 - ca.cos(angle)) * cross @ cross


def _matrix(quaternion: Array) -> Array:
    matrix = np.empty(9)
    mujoco.mju_quat2Mat(matrix, quaternion)
    return matrix.reshape(3, 3)


def _miss(start: list[ca.DM], end: list[ca.MX], reach: Reach) -> ca.MX:
    """Goal error (6): of the position, and half the sines of the angle about each axis of the goal."""
    goal = reach.end
    displaced = end[1] + start[0] - end[0]
    relative = ca.DM(_matrix(goal.quaternion)).T @ end[2]
    turned = ca.vertcat(relative[2, 1] - relative[1, 2], relative[0, 2] - relative[2, 0])
    return ca.vertcat(displaced - goal.position, turned, relative[1, 0] - relative[0, 1])


def compare(context: PolicyContext, reach: Reach, plan: ReachPlan, limits: Limits) -> list[CollocationResult]:
    """A plan, the optimum near it, and the one near the straight joint motion to where it ends."""
    program = Collocation(context.model, limits)
    own = program.sampled(plan)
    straight = program.joint_motion(reach.start, own.q[-1], reach.duration)
    return [
        CollocationResult("plan", own, program.measured(reach, own)),
        program.solve(reach, own),
        program.solve(reach, straight),
    ]


def problems(name: str, goals: int) -> tuple[PolicyContext, PrompReactionless, list[Reach]]:
    """Context, policy and problems of the first goals of a split, to the end of the episode."""
    env = CaptureVectorEnv(ENV, goals, split=name, autoreset_mode="disabled")
    observation, _ = env.reset(seed=0, options={"index": np.arange(goals)})
    context = PolicyContext.from_env(env)
    latest = latest_arrival(context)
    asked = [replace(one, duration=latest) for one in reaches(context, observation, keep_attitude=True)]
    return context, PrompReactionless(context), [one.checked(context.arm) for one in asked]


def cells(number: int, found: list[CollocationResult]) -> list[str]:
    """A row of the table."""
    plan, near, straight = found
    best = plan.measured.cost
    row = [str(number), f"{1e4 * best:.2f}", f"{plan.measured.peak:.1e}"]
    for one in (near, straight):
        cost, peak, error = one.measured
        row += [one.status, f"{1e4 * cost:.2f}", f"{best / cost:.3f}", f"{peak:.1e}", f"{error:.1e}"]
    return row


def main() -> None:
    """Print the table."""
    parser = Parser(prog="python -m benchmarks.reactionless_collocation", description=__doc__)
    parser.add_argument("--goals", type=whole, default=10, help="of the split (default %(default)s)")
    parser.add_argument("--split", type=split, default="test", help="default %(default)s")
    options = parser.parse_args()
    check_goals(ENV, options.split, options.goals)
    context, policy, asked = problems(options.split, options.goals)
    table, ratios = [], []
    for number, reach in enumerate(tqdm(asked, unit="goal", leave=False)):
        (plan,) = policy.plan([reach])
        if isinstance(plan, Failure):
            table.append([str(number), f"no plan ({plan.cause})", *[""] * 11])
            continue
        found = compare(context, reach, plan, path_limits(context).limits)
        table.append(cells(number, found))
        ratios.append(found[0].measured.cost / found[1].measured.cost)
    head = ["goal", "plan, cm^2/s", "peak base rate, rad/s"]
    for start in ("plan", "straight"):
        head += [f"from the {start}", "cm^2/s", "plan / it", "peak base rate, rad/s", "goal error, m or rad"]
    print(markdown_table(head, table))
    if ratios:
        print(f"\nPlan over the optimum near it: median {np.median(ratios):.3f}, largest {max(ratios):.3f}.")
    print(f"{INTERVALS} intervals, motions measured at {DENSE} times, {machine_class()}.")


if __name__ == "__main__":
    sys.exit(exit_status("python -m benchmarks.reactionless_collocation", main))
