"""Program of one arm's optimal control by multiple shooting, equal to the collocation's, as compiled code.

Splines, quadrature, objective and bounds are those of the collocation, stage by stage. The state at the start
of an interval is the coefficients of the splines of angles and of rates that come into play there, the
accelerations, and the base attitude; the control is the jerk on the interval. So bounds on coefficients are
bounds on states.
"""

import casadi as ca
import numpy as np

from agents.planners.common.smooth import smooth_parts
from agents.planners.single_arm.collocation.assembly import SCALE, SMOOTHING
from agents.planners.single_arm.collocation.interval import GAUSS, ORDER, interval_functions
from agents.planners.single_arm.collocation.mesh import INTERVALS
from agents.planners.single_arm.collocation.model import end_pose, sines
from space_envs.codegen.functions import compiled
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.symbolic import SymbolicRobot

STEP = 1.0 / INTERVALS  # of s
GOAL = 6  # equations of a pose
# Angles and rates at the start of an interval from coefficients of angles and rates and accelerations.
ANGLE_AT_START, RATE_AT_START = np.array([1.0, -STEP, STEP**2 / 6.0]), np.array([0.0, 1.0, -STEP / 2.0])


@built_once
def shooting_functions(robot: FloatingRobot) -> dict[str, ca.Function]:
    """The functions of `shooting_expressions`, compiled in one library.

    `nlp` finds what FATROP asks for by itself. Ipopt takes grad_f, nlp_jac_g and hess_lag as options.

    Warns:
        NoCompiledCodeWarning: if they are interpreted.
    """
    return compiled(shooting_expressions(robot))


def shooting_expressions(robot: FloatingRobot) -> dict[str, ca.Function]:
    """The program and its derivatives by name, with the inputs and outputs that the solvers ask for.

    Variables: x_0, u_0, x_1, ..., x_N; states [coefficients of angles (n) and rates (n), accelerations (n),
    attitude (3)] and jerks (n). Parameters: [start (n), rate at the start (n), com (3), position (3) of the
    goal m, its axes (9) column by column, c^2]. Constraints: x_(k+1) minus what follows from x_k, interval by
    interval, after the first the start (2 n + 3); then the pose (6), rates (n) and angles (n) at the end.
    """
    return _Stages(robot).functions()


def equalities(n: int) -> list[bool]:
    """Whether each constraint is an equality; the angles (n) at the end are bounded."""
    return [True] * (INTERVALS * (3 * n + 3) + 2 * n + 3 + GOAL + n) + [False] * n


class _Stages:
    """Expressions of the program."""

    def __init__(self, robot: FloatingRobot) -> None:
        self._n = n = robot.n_joints
        self._state, self._width = 3 * n + 3, 4 * n + 3
        self._x = ca.MX.sym("x", self._width * INTERVALS + self._state)
        self._p = ca.MX.sym("p", 2 * n + 16)
        symbolic = SymbolicRobot(robot)
        q, qdot = ca.SX.sym("q", n), ca.SX.sym("qdot", n)
        self._functions = interval_functions(symbolic.base_twist(q, qdot), q, qdot, explicit=True)
        self._functions |= _ending(symbolic, n)
        self._stages = ca.reshape(self._x[: self._width * INTERVALS], self._width, INTERVALS)
        self._last = self._x[self._width * INTERVALS :]
        self._curve, self._jerk = self._stages[2 * n : 3 * n, :], self._stages[self._state :, :]
        # Inputs of an interval are [coefficients (3 n), jerk (n), attitude (3), attitude at its end (3)].
        self._order = [*range(3 * n), *range(4 * n, 4 * n + 3), *range(3 * n, 4 * n)]

    def functions(self) -> dict[str, ca.Function]:
        """The functions by name, under the names and with the outputs that the solvers ask for."""
        inputs, names = [self._x, self._p], ["x", "p"]
        f, g, slope, jacobian = self._cost(), self._constraints(), self._gradient(), self._jacobian()
        factor, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
        hessian = self._hessian(factor, multipliers)
        pull = factor * slope + jacobian.T @ multipliers
        bent, given = [*inputs, factor, multipliers], [*names, "lam_f", "lam_g"]
        outputs = {
            "nlp": {"f": f, "g": g},
            "nlp_f": {"f": f},
            "nlp_g": {"g": g},
            "nlp_grad_f": {"grad_f_x": slope},
            "nlp_jac_g": {"g": g, "jac_g_x": jacobian},
            "grad_f": {"f": f, "grad_f_x": slope},
        }
        made = {
            name: ca.Function(name, inputs, list(out.values()), names, list(out))
            for name, out in outputs.items()
        }
        for name, out in (
            ("nlp_hess_l", {"grad_gamma_x": ca.densify(pull), "hess_gamma_x_x": hessian}),
            ("hess_lag", {"triu_hess_gamma_x_x": ca.triu(hessian)}),
        ):
            made[name] = ca.Function(name, bent, list(out.values()), given, list(out))
        asked = (["x", "p", "lam:f", "lam:g"], ["f", "g", "grad:gamma:x", "grad:gamma:p"])
        made["nlp_grad"] = made["nlp"].factory("nlp_grad", *asked, {"gamma": ["f", "g"]})
        return made

    @property
    def _inputs(self) -> list[ca.MX]:
        """Inputs of all intervals at once."""
        n, state = self._n, self._state
        values, slopes = _polynomials()
        coefficients = ca.vertcat(self._stages[: 3 * n, :], self._jerk)
        return [
            ca.reshape(coefficients, n, ORDER * INTERVALS),
            self._stages[3 * n : state, :],
            ca.MX.zeros(3, INTERVALS),
            ca.repmat(ca.MX(ca.DM(values)), 1, INTERVALS),
            ca.repmat(ca.MX(ca.DM(slopes)), 1, INTERVALS),
            ca.repmat(ca.MX(STEP), 1, INTERVALS),
            ca.repmat(self._p[-1], 1, INTERVALS),
        ]

    def _of_all(self, part: str, *more: ca.MX) -> ca.MX:
        return self._functions[f"interval_{part}"].map(INTERVALS)(*self._inputs, *more)

    def _cost(self) -> ca.MX:
        summed, a, j = self._of_all("value")[0, :], self._curve, self._jerk
        bent = ca.sumsqr(a) + ca.sumsqr(a + STEP * j) + ca.dot(a, a + STEP * j)
        return SCALE * (ca.sum2(summed) + SMOOTHING * STEP / 3.0 * bent)

    def _constraints(self) -> ca.MX:
        n, summed = self._n, self._of_all("value")
        ready = ca.horzcat(self._stages[: self._state, 1:], self._last)
        values = ready - ca.vertcat(ca.DM(_dynamics(n)) @ self._stages, summed[1:, :])
        start = ca.DM(_start(n)) @ self._stages[:, 0] - ca.vertcat(self._p[: 2 * n], ca.MX(3, 1))
        pose = self._functions["ending_value"](*self._end_inputs())
        pose -= ca.vertcat(self._p[2 * n + 3 : 2 * n + 6], ca.MX(3, 1))
        rest = ca.DM(_rest(n)) @ self._last
        return ca.vertcat(values[:, 0], start, ca.vec(values[:, 1:]), pose, rest)

    def _end_inputs(self) -> list[ca.MX]:
        n, p = self._n, self._p
        angles = (ca.DM(_end(n)) @ self._last)[:n]
        com, axes = p[2 * n : 2 * n + 3], ca.reshape(p[2 * n + 6 : 2 * n + 15], 3, 3)
        return [angles, self._last[3 * n :], com, axes]

    def _gradient(self) -> ca.MX:
        n, a, j = self._n, self._curve, self._jerk
        slope = ca.reshape(self._of_all("slope")[0, :], ORDER * n + 6, INTERVALS)[self._order, :]
        share = SMOOTHING * STEP / 3.0
        by_curve, by_jerk = share * (6.0 * a + 3.0 * STEP * j), share * (3.0 * STEP * a + 2.0 * STEP**2 * j)
        smoothing = ca.vertcat(ca.MX.zeros(2 * n, INTERVALS), by_curve, ca.MX.zeros(3, INTERVALS), by_jerk)
        return ca.densify(ca.vertcat(SCALE * ca.vec(slope + smoothing), ca.MX(self._state, 1)))

    def _jacobian(self) -> ca.MX:
        n, state, inner = self._n, self._state, ORDER * self._n + 6
        slopes = ca.horzsplit(self._of_all("slope"), inner)
        blocks = []
        for k, slope in enumerate(slopes):
            blocks.append(ca.vertcat(ca.MX(_sparse(-_dynamics(n))), -slope[1:, self._order]))
            if k == 0:
                blocks[0] = ca.vertcat(blocks[0], ca.MX(_sparse(_start(n))))
        end = self._functions["ending_slope"](*self._end_inputs()) @ ca.DM(_end(n))
        blocks.append(ca.vertcat(end, ca.MX(_sparse(_rest(n)))))
        following = ca.DM(ca.Sparsity(*(whole := ca.diagcat(*blocks)).shape))
        for k in range(INTERVALS):
            row = k * state + (2 * n + 3 if k else 0)
            column = (k + 1) * self._width
            following[row : row + state, column : column + state] = ca.DM.eye(state)
        return whole + ca.sparsify(following)

    def _hessian(self, factor: ca.MX, multipliers: ca.MX) -> ca.MX:
        n, state, inner = self._n, self._state, ORDER * self._n + 6
        first, start = multipliers[:state], state + 2 * n + 3
        others = ca.reshape(multipliers[start : start + state * (INTERVALS - 1)], state, INTERVALS - 1)
        pulls = ca.horzcat(first, others)[3 * n :, :]
        weight = ca.vertcat(ca.repmat(SCALE * factor, 1, INTERVALS), -pulls)
        smoothing = factor * ca.DM(_smoothing(n))
        bends = ca.horzsplit(self._of_all("bend", weight), inner)
        blocks = [bend[self._order, self._order] + smoothing for bend in bends]
        end = ca.DM(_end(n))
        pose = multipliers[start + state * (INTERVALS - 1) :][:GOAL]
        bend = self._functions["ending_bend"](*self._end_inputs(), pose)
        return ca.diagcat(*blocks, ca.densify(end.T @ bend @ end))


def _polynomials() -> tuple[Array, Array]:
    """Values and slopes (ORDER, GAUSS) at the Gauss points of the factors of coefficients and jerks."""
    points, _ = np.polynomial.legendre.leggauss(GAUSS)
    t = 0.5 * STEP * (1.0 + points)
    values = ANGLE_AT_START[:, None] + RATE_AT_START[:, None] * t
    values[2] += t**2 / 2.0
    slopes = RATE_AT_START[:, None] + np.stack([0.0 * t, 0.0 * t, t])
    return np.vstack([values, t**3 / 6.0]), np.vstack([slopes, t**2 / 2.0])


def _dynamics(n: int) -> Array:
    """(3 n, 4 n + 3) matrix from a stage to the next state without its attitude."""
    rows = np.array([[1.0, STEP, STEP**2, STEP**3], [0.0, 1.0, STEP, STEP**2], [0.0, 0.0, 1.0, STEP]])
    return np.insert(np.kron(rows, np.eye(n)), [3 * n] * 3, 0.0, axis=1)


def _angles_and_rates(n: int) -> Array:
    """(2 n, 3 n) matrix from coefficients and accelerations to angles and rates at the node."""
    return np.kron([ANGLE_AT_START, RATE_AT_START], np.eye(n))


def _start(n: int) -> Array:
    """(2 n + 3, 4 n + 3) matrix from a stage to angles, rates and attitude at its node."""
    matrix = np.zeros((2 * n + 3, 4 * n + 3))
    matrix[: 2 * n, : 3 * n] = _angles_and_rates(n)
    matrix[2 * n :, 3 * n : 3 * n + 3] = np.eye(3)
    return matrix


def _end(n: int) -> Array:
    """(n + 3, 3 n + 3) matrix from a state to angles and attitude."""
    return np.delete(_start(n), np.s_[n : 2 * n], axis=0)[:, : 3 * n + 3]


def _rest(n: int) -> Array:
    """(2 n, 3 n + 3) matrix from a state to rates and angles."""
    angles, rates = np.split(_start(n)[: 2 * n, : 3 * n + 3], 2)
    return np.concatenate([rates, angles])


def _smoothing(n: int) -> Array:
    """(4 n + 3, 4 n + 3) second derivatives of a stage's smoothing."""
    by_curve, by_both, by_jerk = 6.0, 3.0 * STEP, 2.0 * STEP**2
    matrix = np.zeros((4 * n + 3, 4 * n + 3))
    curve, jerk = np.s_[2 * n : 3 * n], np.s_[3 * n + 3 :]
    matrix[curve, curve], matrix[jerk, jerk] = by_curve * np.eye(n), by_jerk * np.eye(n)
    matrix[curve, jerk] = matrix[jerk, curve] = by_both * np.eye(n)
    return SCALE * SMOOTHING * STEP / 3.0 * matrix


def _sparse(matrix: Array) -> ca.DM:
    return ca.sparsify(ca.DM(matrix))


def _ending(symbolic: SymbolicRobot, n: int) -> dict[str, ca.Function]:
    """Functions of `SingleArm.ending`."""
    q, r, com, goal = ca.SX.sym("q", n), ca.SX.sym("r", 3), ca.SX.sym("com", 3), ca.SX.sym("goal", 3, 3)
    position, deviation = end_pose(symbolic, q, r, com, goal)
    return smooth_parts("ending", ca.vertcat(position, sines(deviation)), [q, r], [com, goal])
