"""Nonlinear program of `ocp.py`: Gauss collocation of motions along prescribed paths, solved by Ipopt.

The joint angles are polynomials of time through the start and N Legendre-Gauss points. There the rates have
to follow the end-effector paths and be reactionless; what is free is zeta, one number a point for the planar
robot. zeta itself need not appear.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from agents.planners.common.ipopt import NonlinearProgram
from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.prescribed_paths.derivatives import gradient, hessian, jacobian, point_functions
from agents.planners.dual_arm.prescribed_paths.grid import (
    ACCELERATION_POINTS,
    CollocatedMotion,
    gauss_grid,
)
from agents.planners.dual_arm.prescribed_paths.model import PathModel
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.problem import Capture
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

METHOD = "reactionless_ocp"
NODES = 40  # Gauss points without bounds
BOUNDED_NODES = 24  # with bounds: iterations take longer, and the accuracy of bounds is a per cent anyway
IPOPT = {
    "print_level": 0,
    "sb": "yes",
    "tol": 1e-10,
    "acceptable_tol": 1e-8,
    "max_iter": 60,
    "mu_init": 1e-4,
    "bound_relax_factor": 0.0,
    "mumps_permuting_scaling": 0,  # on these dense blocks it takes most of the time, without effect
}


@dataclass(frozen=True, eq=False)
class PrescribedPathProgram:
    """Nonlinear program of one robot; the problem is in its parameters.

    Attributes:
        points: N. joints: n.
        rows: constraints at a point; the last is zeta where that is bounded.
        equalities: number of constraints before those on accelerations, all equalities except for zeta.
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
        """Return the program of a robot, built at the first use and kept; flags select its constraints."""
        return _build(robot, points, from_rest, accelerated, controlled)

    def times(self, duration: float) -> Array:
        """Times (N,) of the Gauss points, s, in a motion with a duration, s."""
        return 0.5 * duration * (1.0 + gauss_grid(self.points).points[1:])

    def solve(
        self, path: PolynomialPath, capture: Capture, limits: Limits, guess: Array, fraction: float = 1.0
    ) -> CollocatedMotion | Failure:
        """Solve from joint angles (N, n) at the Gauss points, within a fraction of the limits."""
        n, half, count = self.joints, 0.5 * capture.duration, self.points
        grid = gauss_grid(count)
        times = half * (1.0 + grid.points)
        low, high = self._angle_bounds(limits, fraction)
        fastest = np.inf if limits.rate is None else fraction * limits.rate
        speed = np.broadcast_to(fastest, (count, n))
        guess = np.clip(guess, low, high)
        rates = grid.slope @ np.vstack([capture.start, guess]) / half
        bound = self._constraint_bounds(limits, fraction, half)
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
            return Failure(METHOD, Cause.SOLVER, f"Ipopt ended with {status}")
        angles, rates = np.array(found["x"]).reshape(2, count, n)
        return CollocatedMotion(times, np.vstack([capture.start, angles]), rates, float(found["f"]))

    def _angle_bounds(self, limits: Limits, fraction: float) -> tuple[Array, Array]:
        """Lowest and highest angles (N, n) at the Gauss points, rad."""
        low, high = limits.angles(self.joints).T
        if limits.position is not None:
            margin = 0.5 * (1.0 - fraction) * (high - low)
            low, high = low + margin, high - margin
        return np.tile(low, (self.points, 1)), np.tile(high, (self.points, 1))

    def _constraint_bounds(self, limits: Limits, fraction: float, half: float) -> Array:
        bound = np.zeros(self.solver.size_in("lbg")[0])
        if len(bound) > self.equalities and limits.acceleration is not None:
            largest = np.broadcast_to(fraction * limits.acceleration * half**2, self.joints)
            bound[self.equalities :] = np.tile(largest, ACCELERATION_POINTS)
        if limits.control is not None:
            bound[self.rows - 1 : self.rows * self.points : self.rows] = fraction * limits.control
        return bound


@built_once
def _build(
    robot: FloatingRobot, points: int, from_rest: bool, accelerated: bool, controlled: bool
) -> PrescribedPathProgram:
    model, grid, n = PathModel.of(robot), gauss_grid(points), robot.n_joints
    rows = model.dimensions * 2 + model.momenta + int(controlled)
    # Rates are variables of their own, related to the angles by linear equations: derivatives then couple
    # only variables of one point, and are assembled from compiled functions of one point.
    local = point_functions(model, n, rows, controlled)
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
    # Linear constraints: matrices on [start; x]. The first also has minus half the rates.
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
    slopes, energy_slopes = local["slope"].map(points)(x, rates, velocity)
    factor, multipliers = ca.MX.sym("factor"), ca.MX.sym("multipliers", constraints.numel())
    share = ca.reshape(multipliers[: rows * points], rows, points)
    bends = local["bend"].map(points)(x, rates, velocity, share, factor * half * weights)
    solver = NonlinearProgram(
        variables,
        parameters,
        cost,
        constraints,
        gradient(energy_slopes, half, n, weights),
        jacobian(slopes, linear, half, n, rows),
        (factor, multipliers),
        hessian(bends, n, points),
    ).solver({"ipopt": IPOPT, "print_time": False, "error_on_fail": False})
    return PrescribedPathProgram(solver, points, n, rows, (rows + n) * points + (n if from_rest else 0))
