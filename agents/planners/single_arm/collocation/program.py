"""A single arm's motion to an inertial pose as a sparse nonlinear program, by direct collocation.

Joint angles are cubic splines on a mesh; the base attitude has a value at every break of it, and between two
breaks turns by what the twists at the Gauss points say (a defect that is a constraint). Time is scaled to
s = t / T: rates are multiplied by T, accelerations and torques by T squared.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline
from scipy.sparse import csc_matrix

from agents.planners.common.ipopt import NonlinearProgram
from agents.planners.common.splines import DEGREE, Mesh, Terms
from agents.planners.single_arm.collocation.model import GAUSS, ORDER, SingleArm, Torque
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError

GIVEN = 2  # leading coefficients that put the start at its angles and rates
SCALE = 100.0  # of the objective, so that it is of order one
# On the mean square of the second derivatives by s, in units of the objective before SCALE: one direction of
# joint rates moves no base, and without it splines would be free to wander there.
SMOOTH = 1e-7


@dataclass(frozen=True, eq=False)
class ReachProgram:
    """The nonlinear program of one robot and mesh.

    Its variables are the free coefficients (F, n), a coefficient's joints side by side, then the attitudes
    (N, 3) at the breaks but the first; its parameters [the first two coefficients (2 n), com (3), place (3)
    of the goal m, its axes (9) column by column, c^2, spheres (4 K)]; its constraints, in this order: defects
    (3 N), end pose (6), rates and accelerations (rows of `linear`, n each), torques and clearances.

    Attributes:
        linear: numbers of rows for rates and for accelerations. torques: number of constraints for each limit
            on them. clearances: number of constraints.
    """

    mesh: Mesh
    solver: ca.Function
    values: ca.Function  # (variables, parameters) -> objective, constraints
    slopes: ca.Function  # -> gradient, Jacobian
    joints: int
    linear: tuple[int, int]
    torques: int
    clearances: int

    @property
    def free(self) -> int:
        """Number of free coefficients."""
        return self.mesh.size - GIVEN - 1


class _Layout:
    """Where the coefficients and the attitudes are among the variables."""

    def __init__(self, mesh: Mesh, n: int) -> None:
        self.mesh, self.n, self.intervals = mesh, n, len(mesh.breaks) - 1
        self.free = mesh.size - GIVEN - 1
        self.attitudes = self.free * n
        self.size = self.attitudes + 3 * self.intervals

    def coefficient(self, number: int) -> NDArray[np.int64]:
        """Variables (n,) of a coefficient, -1 where it is given; the last two are one, which ends at rest."""
        place = min(number, self.mesh.size - 2) - GIVEN
        joints = np.arange(self.n)
        return place * self.n + joints if place >= 0 else np.full(self.n, -1)

    def attitude(self, at: int) -> NDArray[np.int64]:
        """Variables (3,) of the attitude at a break."""
        axes = np.arange(3)
        return self.attitudes + 3 * (at - 1) + axes if at > 0 else np.full(3, -1)


@dataclass(frozen=True, eq=False)
class _Point:
    """Inputs of a function at one place: for each, (variable, factor) pairs side by side.

    Attributes:
        variables: (inputs, width) places among the variables, -1 for none. factors: (inputs, width).
    """

    variables: NDArray[np.int64]
    factors: Array


def build(
    model: SingleArm,
    torque: Torque | None,
    loads: tuple[bool, ...],
    n: int,
    mesh: Mesh,
    moving: bool,
    spheres: int,
    options: dict[str, Any],
) -> ReachProgram:
    """The program of a robot with n joints.

    Args:
        loads: for each limit on torques whether it is on all that a joint needs, or else on what rates alone
            need; none leaves torques free, and `torque` is not used.
        moving: whether there are rows for rates and accelerations.
        spheres: number of balls.
        options: of CasADi's `nlpsol` for Ipopt.
    """
    layout = _Layout(mesh, n)
    count = layout.intervals
    x = ca.MX.sym("x", layout.size)
    p = ca.MX.sym("p", 2 * n + 16 + 4 * spheres)
    given, com, place, goal, c2 = (
        ca.reshape(p[: 2 * n], n, 2),
        p[2 * n : 2 * n + 3],
        p[2 * n + 3 : 2 * n + 6],
        ca.reshape(p[2 * n + 6 : 2 * n + 15], 3, 3),
        p[2 * n + 15],
    )
    balls = ca.reshape(p[2 * n + 16 :], 4, spheres)
    free = ca.reshape(x[: layout.attitudes], n, layout.free)
    coefficients = ca.horzcat(given, free, free[:, -1])
    r = ca.horzcat(ca.MX(3, 1), ca.reshape(x[layout.attitudes :], 3, count))

    # Eq. 20 and the attitude.
    lengths = np.diff(mesh.breaks)
    value, slope = _at_gauss_points(mesh)
    local = coefficients[:, (np.arange(count)[:, None] + np.arange(ORDER)).ravel().tolist()]
    inputs = [
        local,
        r[:, :-1],
        r[:, 1:],
        ca.DM(value),
        ca.DM(slope),
        ca.DM(lengths).T,
        ca.repmat(c2, 1, count),
    ]
    summed = model.interval.value.map(count)(*inputs)
    summed_slope = model.interval.slope.map(count)(*inputs)
    stretch = [
        np.concatenate(
            [
                *(layout.coefficient(k + a) for a in range(ORDER)),
                layout.attitude(k),
                layout.attitude(k + 1),
            ]
        )
        for k in range(count)
    ]
    intervals = [_Point(v[:, None], np.ones((len(v), 1))) for v in stretch]
    # What smooths is a quadratic form of the coefficients.
    square = SMOOTH * _bending(mesh)
    bent = coefficients @ ca.DM(square)
    f = SCALE * (ca.sum2(summed[0, :]) + 0.5 * ca.dot(bent, coefficients))

    # The end.
    last = [coefficients[:, -1], r[:, -1]]
    end_given = [com, goal]
    ending = model.ending.value(*last, *end_given) - ca.vertcat(place, ca.MX(3, 1))
    end = [
        _Point(
            np.concatenate([layout.coefficient(mesh.size - 1), layout.attitude(count)])[:, None],
            np.ones((n + 3, 1)),
        )
    ]

    # Linear rows.
    rates, accelerations = mesh.rate_rows()[1:-1], mesh.basis(mesh.breaks, 2)
    if not moving:
        rates, accelerations = rates[:0], accelerations[:0]
    linear = np.concatenate([rates, accelerations])
    rows = ca.vec(coefficients @ ca.DM(csc_matrix(linear.T)))

    g = [ca.vec(summed[1:, :]), ending, rows]
    blocks: list[tuple[int, int, list[_Point], ca.MX]] = [
        (0, 3, intervals, summed_slope),
        (3 * count, 6, end, model.ending.slope(*last, *end_given)),
    ]
    begin = 3 * count + 6 + rows.numel()
    clearances = 0
    times = np.sort(np.concatenate([mesh.breaks, mesh.middles]))
    state = [coefficients @ ca.DM(csc_matrix(mesh.basis(times, k).T)) for k in range(3)]
    for accelerating in loads:
        if torque is None:
            raise ConfigurationError("limits on torques need the torques")
        given_state = state if accelerating else [*state[:2], ca.MX(n, len(times))]
        g.append(ca.vec(torque.value.map(len(times))(*given_state)))
        points = [_spline_point(layout, mesh, t, (0, 1, 2) if accelerating else (0, 1)) for t in times]
        slope = torque.slope.map(len(times))(*given_state)
        if not accelerating:
            slope = slope[:, [k * 3 * n + i for k in range(len(times)) for i in range(2 * n)]]
        blocks.append((begin, n, points, slope))
        begin += n * len(times)
    at_breaks = coefficients @ ca.DM(csc_matrix(mesh.basis(mesh.breaks[1:], 0).T))
    break_points = [
        _joined(_spline_point(layout, mesh, t, (0,)), layout.attitude(k + 1))
        for k, t in enumerate(mesh.breaks[1:])
    ]
    ball_inputs = []
    for number in range(spheres):
        ball = [at_breaks, r[:, 1:], ca.repmat(com, 1, count), ca.repmat(balls[:3, number], 1, count)]
        ball_inputs.append(ball)
        g.append(ca.vec(model.spheres.value.map(count)(*ball)))
        blocks.append((begin, model.links, break_points, model.spheres.slope.map(count)(*ball)))
        begin += model.links * count
        clearances += model.links * count
    g = ca.vertcat(*g)

    slopes = _slopes(layout, blocks, linear, 3 * count + 6, g.numel())
    gradient = _gradient(layout, intervals, summed_slope, bent)

    # Second derivatives.
    lam_f, lam_g = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
    weight = ca.vertcat(ca.repmat(SCALE * lam_f, 1, count), ca.reshape(lam_g[: 3 * count], 3, count))
    bends = [
        (intervals, model.interval.bend.map(count)(*inputs, weight)),
        (end, model.ending.bend(*last, *end_given, lam_g[3 * count : 3 * count + 6])),
    ]
    at = g.numel() - clearances
    for ball in ball_inputs:
        size = model.links * count
        multiplier = ca.reshape(lam_g[at : at + size], model.links, count)
        bends.append((break_points, model.spheres.bend.map(count)(*ball, multiplier)))
        at += size
    bend = _bend(layout, bends, SCALE * square, lam_f)

    values = ca.Function("values", [x, p], [f, g], ["x", "p"], ["f", "g"])
    solver = NonlinearProgram(x, p, f, g, gradient, slopes, (lam_f, lam_g), bend).solver(options)
    both = ca.Function("slopes", [x, p], [gradient, slopes])
    return ReachProgram(
        mesh, solver, values, both, n, (len(rates), len(accelerations)), n * len(times), clearances
    )


def _at_gauss_points(mesh: Mesh) -> tuple[Array, Array]:
    """Values and slopes (ORDER, N GAUSS) of the splines that live on each interval, side by side."""
    points, _ = np.polynomial.legendre.leggauss(GAUSS)
    nodes = mesh.middles[:, None] + 0.5 * np.diff(mesh.breaks)[:, None] * points
    found = []
    for derivative in (0, 1):
        basis = mesh.basis(nodes.ravel(), derivative).reshape(*nodes.shape, mesh.size)
        found.append(np.concatenate([basis[k, :, k : k + ORDER].T for k in range(len(nodes))], axis=1))
    return found[0], found[1]


def _bending(mesh: Mesh) -> Array:
    """(size, size) form whose half is the integral over s of the squared second derivative."""
    lengths = np.diff(mesh.breaks)
    spline = BSpline(mesh.knots, np.eye(mesh.size), DEGREE).derivative(2)
    points, weights = np.polynomial.legendre.leggauss(2)  # exact: the square is of second degree
    total = np.zeros((mesh.size, mesh.size))
    for point, share in zip(points, weights, strict=True):
        basis = np.asarray(spline(mesh.middles + 0.5 * lengths * point))
        total += basis.T @ ((share * lengths)[:, None] * basis)
    return total


def _spline_point(layout: _Layout, mesh: Mesh, time: float, derivatives: tuple[int, ...]) -> _Point:
    """The joint angles' derivatives at a time, from the coefficients that have a part in them."""
    bases = [mesh.basis(np.array([time]), k)[0] for k in derivatives]
    active = np.flatnonzero(np.any([basis != 0.0 for basis in bases], axis=0))
    variables = np.stack([layout.coefficient(int(c)) for c in active], axis=1)
    factors = np.concatenate([np.tile(basis[active], (layout.n, 1)) for basis in bases])
    return _Point(np.tile(variables, (len(bases), 1)), factors)


def _joined(point: _Point, more: NDArray[np.int64]) -> _Point:
    """The point with inputs that are variables themselves."""
    width = point.variables.shape[1]
    variables, factors = np.full((len(more), width), -1), np.zeros((len(more), width))
    variables[:, 0], factors[:, 0] = more, 1.0
    return _Point(np.concatenate([point.variables, variables]), np.concatenate([point.factors, factors]))


def _entries(point: _Point) -> Iterator[tuple[Any, Any, Any]]:
    """(inputs, their variables, factors) where there are variables, one column after the other."""
    for variable, factor in zip(point.variables.T, point.factors.T, strict=True):
        kept = np.flatnonzero((variable >= 0) & (factor != 0.0))
        yield kept, variable[kept], factor[kept]


def _slopes(
    layout: _Layout, blocks: list[tuple[int, int, list[_Point], ca.MX]], linear: Array, at: int, rows: int
) -> ca.MX:
    """The Jacobian of the constraints; the rows of a block are the last of its function's outputs."""
    terms, offset, sources = Terms(), 0, []
    for begin, height, points, slope in blocks:
        outputs = slope.shape[0]
        row = np.arange(height)[:, None]
        for k, point in enumerate(points):
            inputs = len(point.variables)
            for kept, variable, factor in _entries(point):
                source = offset + (k * inputs + kept) * outputs + row + outputs - height
                terms.add(begin + k * height + row, variable, source, factor)
        sources.append(ca.vec(slope))
        offset += slope.numel()
    n = layout.n
    for number, basis in enumerate(linear.T):
        variable = layout.coefficient(number)
        if variable[0] >= 0:
            row = at + np.arange(len(linear))[:, None] * n + np.arange(n)
            terms.add(row, variable, offset, basis[:, None])
    return terms.matrix(ca.vertcat(*sources, ca.MX(1.0)), (rows, layout.size))


def _gradient(layout: _Layout, intervals: list[_Point], slope: ca.MX, bent: ca.MX) -> ca.MX:
    """Derivative of the objective."""
    terms, inputs = Terms(), len(intervals[0].variables)
    outputs = slope.shape[0]
    for k, point in enumerate(intervals):
        for kept, variable, factor in _entries(point):
            terms.add(variable, 0, (k * inputs + kept) * outputs, factor)
    begin = slope.numel()
    for number in range(layout.mesh.size):
        variable = layout.coefficient(number)
        if variable[0] >= 0:
            terms.add(variable, 0, begin + number * layout.n + np.arange(layout.n), 1.0)
    sources = ca.vertcat(ca.vec(slope), ca.vec(bent))
    return SCALE * ca.densify(terms.matrix(sources, (layout.size, 1)))


def _bend(layout: _Layout, blocks: list[tuple[list[_Point], ca.MX]], square: Array, weight: ca.MX) -> ca.MX:
    """Upper triangle of the Lagrangian's second derivative."""
    terms, offset = Terms(), 0
    for points, bend in blocks:
        for k, point in enumerate(points):
            size = len(point.variables)
            for (one, row, left), (two, column, right) in product(list(_entries(point)), repeat=2):
                upper = row[:, None] <= column
                source = offset + (k * size + two) * size + one[:, None]
                terms.add(row[:, None], column, source, left[:, None] * right * upper)
        offset += bend.numel()
    for one, two in zip(*np.nonzero(square), strict=True):
        row, column = layout.coefficient(int(one)), layout.coefficient(int(two))
        if row[0] >= 0 and column[0] >= 0 and row[0] <= column[0]:
            terms.add(row, column, offset, square[one, two])
    sources = ca.vertcat(*[ca.vec(bend) for _, bend in blocks], weight)
    return terms.matrix(sources, (layout.size, layout.size))
