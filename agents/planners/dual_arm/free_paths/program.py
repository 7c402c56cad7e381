"""The free-path problem as a sparse nonlinear program in the coefficients of cubic splines.

Time is scaled to s = t / T, so that one program serves all durations: rates are multiplied by T,
accelerations by T squared. The reactionless constraint is collocated at the middle of every interval and at
the end; the remaining drift in between (1e-5 rad) is removed by the roll-out.
"""

from dataclasses import dataclass
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import csc_matrix

from agents.planners.common.ipopt import NonlinearProgram
from agents.planners.common.smooth import Smooth
from agents.planners.common.splines import Mesh, Terms
from agents.planners.dual_arm.held_attitude import HeldAttitude
from space_envs.dynamics.rotations import Array

FIXED = 3  # leading coefficients, which put the start at rest without acceleration


@dataclass(frozen=True, eq=False)
class FreePathProgram:
    """Nonlinear program of one robot and mesh.

    Its variables are the free coefficients (size - 3) x n, a coefficient's joints side by side; its
    parameters [start (n), positions (2 d) m and velocities times T (2 d) of the end-effectors, across (12, by
    columns), those of the cost, node by node]; its constraints, in this order: `angular_momentum` at the
    middles, `ending`, then linear ones on rates and accelerations.
    """

    mesh: Mesh
    solver: ca.Function
    slope: ca.Function  # (variables, parameters) -> constraints, their Jacobian
    joints: int
    goals: int  # number of parameters between start and across: 4 d
    collocated: int  # number of constraints on `angular_momentum`
    ending: int  # number of those on `ending`


def build(
    model: HeldAttitude, cost: Smooth, n: int, mesh: Mesh, options: dict[str, Any], each: int = 0
) -> FreePathProgram:
    """Build the program of a robot with n joints.

    Args:
        cost: function of q, qdot and `each` parameters, whose integral is minimised.
        options: of CasADi's `nlpsol` for Ipopt.
    """
    free = mesh.size - FIXED
    x = ca.MX.sym("x", n * free)
    goals = 4 * model.dimensions
    bare = n + goals + 12
    p = ca.MX.sym("p", bare + each * len(mesh.nodes))
    start, goal, across = p[:n], p[n : n + goals], ca.reshape(p[n + goals : bare], 3, 4)
    coefficients = ca.horzcat(ca.repmat(start, 1, FIXED), ca.reshape(x, n, free))

    def along(at: Array, derivative: int) -> ca.MX:
        return ca.mtimes(coefficients, ca.DM(csc_matrix(mesh.basis(at, derivative).T)))

    ends = np.array([1.0])
    nodes = along(mesh.nodes, 0), along(mesh.nodes, 1)
    middles = along(mesh.middles, 0), along(mesh.middles, 1)
    last = along(ends, 0), along(ends, 1)
    count, between = len(mesh.nodes), len(mesh.middles)
    weights = ca.DM(mesh.weights)

    extra = [ca.reshape(p[bare:], each, count)] if each else []
    f = ca.dot(cost.value.map(count)(*nodes, *extra).T, weights)
    momentum = ca.vec(model.angular_momentum.value.map(between)(*middles))
    aim = ca.vertcat(goal, ca.MX(model.momenta + model.tilts, 1))
    ending = model.ending.value(*last, across) - aim
    # Linear rows on free coefficients and on the start: rates and, at the knots, accelerations.
    linear = np.concatenate([mesh.rate_rows()[FIXED - 1 :], mesh.basis(mesh.breaks[1:], 2)])
    rows = ca.DM(csc_matrix(np.kron(linear[:, FIXED:], np.eye(n))))
    offset = ca.mtimes(ca.DM(csc_matrix(np.kron(linear[:, :FIXED].sum(axis=1)[:, None], np.eye(n)))), start)
    g = ca.vertcat(momentum, ending, ca.mtimes(rows, x) + offset)

    slope = cost.slope.map(count)(*nodes, *extra)
    gradient = _gradient(mesh, n, ca.reshape(slope, 2 * n, count) * ca.repmat(weights.T, 2 * n, 1))
    slope = _slope(model, mesh, n, middles, last, across, linear)
    bend_weight = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    bends = ca.vec(cost.bend.map(count)(*nodes, *extra, bend_weight[0] * weights.T))
    bend = _bend(model, mesh, n, bends, (middles, last), across, bend_weight[1])
    slopes = ca.Function("nlp_jac_g", [x, p], [g, slope], ["x", "p"], ["g", "jac_g_x"])
    solver = NonlinearProgram(x, p, f, g, gradient, slope, bend_weight, bend).solver(options)
    return FreePathProgram(mesh, solver, slopes, n, goals, momentum.numel(), ending.numel())


def _gradient(mesh: Mesh, n: int, slope: ca.MX) -> ca.MX:
    """Gradient by the coefficients, from derivatives by [q; qdot] (2 n, nodes) of the summands."""
    values, rates = (ca.DM(csc_matrix(mesh.basis(mesh.nodes, k)[:, FIXED:])) for k in (0, 1))
    return ca.vec(ca.mtimes(slope[:n, :], values) + ca.mtimes(slope[n:, :], rates))


def _slope(
    model: HeldAttitude,
    mesh: Mesh,
    n: int,
    middles: tuple[ca.MX, ca.MX],
    last: tuple[ca.MX, ca.MX],
    across: ca.MX,
    linear: Array,
) -> ca.MX:
    """Jacobian of the constraints by the coefficients."""
    terms, free, r = Terms(), mesh.size - FIXED, model.momenta
    momentum = ca.vec(model.angular_momentum.slope.map(len(mesh.middles))(*middles))  # column by column
    ending = ca.vec(model.ending.slope(*last, across))
    row, joint = np.arange(r)[:, None], np.arange(n)[None, :]
    for k, coefficient, basis in _active(mesh, mesh.middles):
        for part in (0, 1):
            source = k * 2 * n * r + (part * n + joint) * r + row
            terms.add(k * r + row, coefficient * n + joint, source, basis[part])
    first_row, outputs = len(mesh.middles) * r, ending.numel() // (2 * n)
    row = np.arange(outputs)[:, None]
    for _, coefficient, basis in _active(mesh, np.array([1.0])):
        for part in (0, 1):
            source = momentum.numel() + (part * n + joint) * outputs + row
            terms.add(first_row + row, coefficient * n + joint, source, basis[part])
    constant = np.kron(linear[:, FIXED:], np.eye(n))
    at = np.nonzero(constant)
    sources = ca.vertcat(momentum, ending, ca.MX(1.0))
    terms.add(first_row + outputs + at[0], at[1], sources.numel() - 1, constant[at])
    return terms.matrix(sources, (first_row + outputs + len(constant), n * free))


def _bend(
    model: HeldAttitude,
    mesh: Mesh,
    n: int,
    cost: ca.MX,
    points: tuple[tuple[ca.MX, ca.MX], tuple[ca.MX, ca.MX]],
    across: ca.MX,
    weight: ca.MX,
) -> ca.MX:
    """Upper triangle of the Lagrangian's Hessian."""
    middles, last = points
    between, r = len(mesh.middles), model.momenta
    multiplier = ca.reshape(weight[: between * r], r, between)
    outputs = model.ending.value.numel_out(0)
    sources = ca.vertcat(
        cost,
        ca.vec(model.angular_momentum.bend.map(between)(*middles, multiplier)),
        ca.vec(model.ending.bend(*last, across, weight[between * r : between * r + outputs])),
    )
    terms, first_row = Terms(), 0
    first, second = np.arange(n)[:, None], np.arange(n)[None, :]
    for at in (mesh.nodes, mesh.middles, np.array([1.0])):
        for (k, one, one_basis), (other_k, other, other_basis) in product(_active(mesh, at), repeat=2):
            if other_k == k and one <= other:
                row, column = one * n + first, other * n + second
                upper = row <= column
                for i in (0, 1):
                    for j in (0, 1):
                        source = first_row + k * 4 * n * n + (j * n + second) * 2 * n + (i * n + first)
                        terms.add(row, column, source, one_basis[i] * other_basis[j] * upper)
        first_row += len(at) * 4 * n * n
    size = n * (mesh.size - FIXED)
    return terms.matrix(sources, (size, size))


def _active(mesh: Mesh, at: Array) -> list[tuple[int, int, tuple[float, float]]]:
    """(Number in `at`, free coefficient, its spline's value and derivative) where not both are zero."""
    value, rate = mesh.basis(at)[:, FIXED:], mesh.basis(at, 1)[:, FIXED:]
    return [
        (int(k), int(c), (float(value[k, c]), float(rate[k, c])))
        for k, c in zip(*np.nonzero((value != 0.0) | (rate != 0.0)), strict=True)
    ]
