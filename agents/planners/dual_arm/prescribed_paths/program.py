"""The nonlinear programme of `ocp.py`: Gauss collocation of motions along given paths, solved by Ipopt.

The joint angles are polynomials of time through the start and N Legendre-Gauss points. At those the rates
have to follow the end-effector paths and be reactionless; what is left is zeta, one number a point for the
planar robot. zeta itself need not appear.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BarycentricInterpolator
from scipy.special import roots_legendre

from agents.planners.common.ipopt import NonlinearProgram
from agents.planners.common.plans import Limits
from agents.planners.dual_arm.prescribed_paths.model import PathModel
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.problem import Capture
from space_envs.codegen.functions import compiled
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

NODES = 40  # Gauss points where there are no bounds
BOUNDED_NODES = (
    24  # where there are: each iteration costs much more, and bounds are kept to a per cent anyway
)
CHECKED = 33  # points at which accelerations are bounded, denser towards the ends
IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-10,
    "acceptable_tol": 1e-8,
    "max_iter": 60,
    "mu_init": 1e-4,
    "bound_relax_factor": 0.0,
    "mumps_permuting_scaling": 0,  # on these dense blocks it takes most of the time, and finds nothing
}


@dataclass(frozen=True, eq=False)
class Grid:
    """Lagrange polynomials through -1 and the N Gauss points of [-1, 1].

    Attributes:
        points: (N + 1,). weights: (N,) of the quadrature.
        slope: (N, N + 1) derivative at the Gauss points, per unit of [-1, 1].
        first_slope: (1, N + 1) derivative at -1. bend: (CHECKED, N + 1) second derivative at points from -1
            to 1, where accelerations are bounded.
    """

    points: Array
    weights: Array
    slope: Array
    first_slope: Array
    bend: Array


@lru_cache(maxsize=4)
def gauss_grid(n: int) -> Grid:
    """The grid of N points."""
    nodes, weights = roots_legendre(n)
    points = np.concatenate([[-1.0], nodes])
    curve = BarycentricInterpolator(points, np.eye(n + 1), rng=np.random.default_rng(0))
    checked = -np.cos(np.linspace(0.0, np.pi, CHECKED))
    first, bend = curve.derivative(np.array([-1.0])), curve.derivative(checked, 2)
    return Grid(points, weights, curve.derivative(nodes), first, bend)


@dataclass(frozen=True, eq=False)
class CollocatedMotion:
    """Angles (N + 1, n) rad at the start and the Gauss points, rates (N, n) rad/s at the latter, at times
    (N + 1,) s; energy is C by the quadrature, J s."""

    times: Array
    nodes: Array
    rates: Array
    energy: float

    @property
    def position(self) -> Array:
        """Angles (N, n) at the Gauss points."""
        return self.nodes[1:]

    def curve(self) -> Callable[[float], tuple[Array, Array]]:
        """Angles and rates (n,) as polynomials of time, which scipy's interpolators evaluate more slowly."""
        n = self.nodes.shape[1]
        rates = BarycentricInterpolator(self.times[1:], self.rates, rng=np.random.default_rng(0))
        both = np.hstack([self.nodes, np.vstack([rates(self.times[0]), self.rates])])
        weights = BarycentricInterpolator(self.times, rng=np.random.default_rng(0)).wi

        def at(time: float) -> tuple[Array, Array]:
            away = time - self.times
            nearest = int(np.abs(away).argmin())
            if away[nearest] == 0.0:
                return both[nearest, :n], both[nearest, n:]
            share = weights / away
            values = share @ both / share.sum()
            return values[:n], values[n:]

        return at


@dataclass(frozen=True, eq=False)
class PrescribedPathProgram:
    """The nonlinear programme of one robot, built once; what varies from case to case are its parameters.

    Attributes:
        points: N. joints: n.
        rows: constraints at a point; the last is zeta where that is bounded.
        equalities: number of constraints before those on accelerations, all equalities but for zeta.
    """

    solver: ca.Function
    points: int
    joints: int
    rows: int
    equalities: int

    @classmethod
    def of(
        cls,
        robot: FloatingRobot,
        points: int,
        from_rest: bool = False,
        accelerated: bool = False,
        controlled: bool = False,
    ) -> "PrescribedPathProgram":
        """The programme of a robot, kept after its first use; the flags say which constraints it has."""
        return _built(robot, points, from_rest, accelerated, controlled)

    def times(self, duration: float) -> Array:
        """Times (N,) of the Gauss points in a motion of some duration, s."""
        return 0.5 * duration * (1.0 + gauss_grid(self.points).points[1:])

    def solve(
        self, path: PolynomialPath, capture: Capture, limits: Limits, guess: Array, share: float = 1.0
    ) -> CollocatedMotion | str:
        """Solve from joint angles (N, n) at the Gauss points; a string says why there is no solution.

        Args:
            share: of the limits that may be used.
        """
        grid, n, half = gauss_grid(self.points), self.joints, 0.5 * capture.duration
        count = self.points
        times = half * (1.0 + grid.points)
        low, high = np.full((count, n), -np.inf), np.full((count, n), np.inf)
        if limits.position is not None:
            room = 0.5 * (1.0 - share) * (limits.position[:, 1] - limits.position[:, 0])
            low[:], high[:] = limits.position[:, 0] + room, limits.position[:, 1] - room
        speed = np.full((count, n), np.inf if limits.rate is None else share * limits.rate)
        guess = np.clip(guess, low, high)
        rates = grid.slope @ np.vstack([capture.start, guess]) / half
        bound = np.zeros(self.solver.size_in("lbg")[0])
        if len(bound) > self.equalities and limits.acceleration is not None:
            bound[self.equalities :] = share * limits.acceleration * half**2
        if limits.control is not None:
            bound[self.rows - 1 : self.rows * count : self.rows] = share * limits.control
        found = self.solver(
            x0=np.concatenate([guess.ravel(), np.clip(rates, -speed, speed).ravel()]),
            p=np.concatenate([capture.start, [half], path.velocity(times[1:]).ravel()]),
            lbx=np.concatenate([low.ravel(), -speed.ravel()]),
            ubx=np.concatenate([high.ravel(), speed.ravel()]),
            lbg=-bound,
            ubg=bound,
        )
        status = self.solver.stats()["return_status"]
        if status not in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
            return f"Ipopt ended with {status}"
        angles, rates = np.array(found["x"]).reshape(2, count, n)
        return CollocatedMotion(times, np.vstack([capture.start, angles]), rates, float(found["f"]))


@built_once
def _built(
    robot: FloatingRobot, points: int, from_rest: bool, accelerated: bool, controlled: bool
) -> PrescribedPathProgram:
    model, grid, n = PathModel.of(robot), gauss_grid(points), robot.n_joints
    rows = model.dimensions * 2 + model.turns + int(controlled)
    # Rates are variables of their own, tied to the angles by linear equations: derivatives then only join
    # what belongs to one point, and are put together here from compiled functions of one point.
    local = _point_functions(model, n, rows, controlled)
    x, rates, start, half, velocity = (
        ca.MX.sym(name, *size)
        for name, size in (
            ("x", (n, points)),
            ("rates", (n, points)),
            ("start", (n, 1)),
            ("half", (1, 1)),
            ("velocity", (4, points)),
        )
    )
    variables = ca.vertcat(ca.vec(x), ca.vec(rates))
    parameters = ca.vertcat(start, half, ca.vec(velocity))
    residuals, energies = local["value"].map(points)(x, rates, velocity)
    # Linear constraints: matrices of [start; x]. The first also takes away half the rates.
    linear = [grid.slope]
    if from_rest:
        linear.append(grid.first_slope)
    if accelerated:
        linear.append(grid.bend)
    states = ca.horzcat(start, x)
    parts = [ca.vec(residuals)]
    for row, matrix in enumerate(linear):
        value = states @ ca.DM(matrix.T)
        parts.append(ca.vec(value if row else value - half * rates))
    weights = ca.DM(grid.weights).T
    cost, constraints = half * ca.dot(energies, weights), ca.vertcat(*parts)
    jacobian, gradient = _first_derivatives(local, x, rates, velocity, half, linear, n, rows, weights)
    factor, multipliers = ca.MX.sym("factor"), ca.MX.sym("multipliers", constraints.numel())
    share = ca.reshape(multipliers[: rows * points], rows, points)
    bends = local["bend"].map(points)(x, rates, velocity, share, factor * half * weights)
    hessian = _second_derivatives(bends, n, points)
    solver = NonlinearProgram(
        variables, parameters, cost, constraints, gradient, jacobian, (factor, multipliers), hessian
    ).solver({"ipopt": IPOPT, "print_time": False, "error_on_fail": False})
    return PrescribedPathProgram(solver, points, n, rows, (rows + n) * points + (n if from_rest else 0))


def _point_functions(model: PathModel, n: int, rows: int, controlled: bool) -> dict[str, ca.Function]:
    """Residual and energy at one point, their first derivatives and the weighted second ones, compiled.

    With zeta among the residuals CasADi's virtual machine runs them: a compiler takes minutes for them.
    """
    q, qdot, v = (ca.SX.sym(name, size) for name, size in (("q", n), ("qdot", n), ("v", 4)))
    _, task, angular, mass = model.symbolic(q)
    residual, energy = task @ qdot - ca.vertcat(v, ca.SX(model.turns, 1)), qdot.T @ mass @ qdot
    if controlled:
        # zeta: the dependent angular velocities along the direction in which the null space can change them.
        columns = [[j for j in range(n) if j != left] for left in range(n)]
        null = ca.vertcat(*[(-1) ** left * ca.det(task[:, c]) for left, c in enumerate(columns)])
        way = angular @ null
        residual = ca.vertcat(residual, ca.dot(way, angular @ qdot) / ca.norm_2(way))
    y, share, weight = ca.vertcat(q, qdot), ca.SX.sym("share", rows), ca.SX.sym("weight")
    bend = ca.hessian(ca.dot(share, residual) + weight * energy, y)[0]
    outputs = {
        "value": ([q, qdot, v], [residual, energy]),
        "slope": ([q, qdot, v], [ca.jacobian(residual, y), ca.gradient(energy, y)]),
        "bend": ([q, qdot, v, share, weight], [bend]),
    }
    functions = {
        name: ca.Function(f"point_{name}", inputs, [ca.densify(value) for value in ca.cse(values)])
        for name, (inputs, values) in outputs.items()
    }
    return functions if controlled else compiled(functions)


def _first_derivatives(
    local: dict[str, ca.Function],
    x: ca.MX,
    rates: ca.MX,
    velocity: ca.MX,
    half: ca.MX,
    linear: list[Array],
    n: int,
    rows: int,
    weights: ca.DM,
) -> tuple[ca.MX, ca.MX]:
    """Jacobian of the constraints and gradient of the cost, of [x; rates]."""
    points = x.size2()
    slopes, cost = local["slope"].map(points)(x, rates, velocity)
    # Where the entries of the points' blocks, (rows, 2 n) each, lie.
    point, row, column = np.meshgrid(np.arange(points), np.arange(rows), np.arange(2 * n), indexing="ij")
    place = np.where(column < n, point * n + column, points * n + point * n + column - n)
    # vec() runs down the columns of each block.
    down = [(rows * point + row).transpose(0, 2, 1).ravel()]
    across = [place.transpose(0, 2, 1).ravel()]
    values: list[ca.MX] = [ca.vec(slopes)]
    offset = rows * points
    for number, matrix in enumerate(linear):
        blocks = [(matrix[:, 1:], 0)]
        if number == 0:
            blocks.append((-np.eye(points), points * n))
        for block, first in blocks:
            r, c = np.nonzero(block)
            for joint in range(n):
                down.append(offset + r * n + joint)
                across.append(first + c * n + joint)
                entries = ca.DM(block[r, c])
                values.append(half * entries if first else ca.MX(entries))
        offset += len(matrix) * n
    jacobian = _sparse(offset, 2 * n * points, np.concatenate(down), np.concatenate(across), values)
    scaled = half * (cost * ca.repmat(weights, 2 * n, 1))
    return jacobian, ca.vertcat(ca.vec(scaled[:n, :]), ca.vec(scaled[n:, :]))


def _second_derivatives(bends: ca.MX, n: int, points: int) -> ca.MX:
    """Upper triangle of the Lagrangian's second derivatives, from the points' (2 n, 2 n) blocks."""
    point, column, row = np.meshgrid(np.arange(points), np.arange(2 * n), np.arange(2 * n), indexing="ij")

    def place(entry: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.where(entry < n, point * n + entry, points * n + point * n + entry - n)

    down, across = place(row).ravel(), place(column).ravel()
    upper = np.flatnonzero(down <= across)
    size = 2 * n * points
    return _sparse(size, size, down[upper], across[upper], [ca.vec(bends)[upper.tolist()]])


def _sparse(
    height: int, width: int, down: NDArray[np.int64], across: NDArray[np.int64], values: list[ca.MX]
) -> ca.MX:
    """A sparse matrix from the rows and columns of its entries."""
    order = np.lexsort((down, across))  # by column, then by row
    pattern = ca.Sparsity.triplet(height, width, down[order].tolist(), across[order].tolist())
    return ca.MX(pattern, ca.vertcat(*values)[order.tolist()])
