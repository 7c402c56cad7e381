"""Nonlinear program of `plan_ocp`: Gauss collocation of motions along prescribed paths, solved by Ipopt.

The joint angles are polynomials of time through the start and N Legendre-Gauss points. There the rates have
to follow the end-effector paths and be reactionless; what is free is the motion in the null space, eq. 9's
zeta: one number a point for two planar arms of three joints, five for two spatial arms of seven. zeta itself
need not appear.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from agents.planners.common.ipopt import NonlinearProgram
from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.held_attitude import HeldAttitude
from agents.planners.dual_arm.prescribed_paths.collocation.derivatives import (
    gradient,
    hessian,
    jacobian,
    point_functions,
)
from agents.planners.dual_arm.prescribed_paths.collocation.ending import (
    ALIGNMENTS,
    end_bounds,
    end_parameters,
    with_aligned_end,
)
from agents.planners.dual_arm.prescribed_paths.collocation.grid import (
    ACCELERATION_POINTS,
    CollocatedMotion,
    gauss_grid,
)
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
        aligned: whether the approach axes are constrained at the end, by the last constraints.
    """

    robot: FloatingRobot
    solver: ca.Function
    points: int
    joints: int
    rows: int
    equalities: int
    aligned: bool

    @classmethod
    def of(
        cls,
        robot: FloatingRobot,
        points: int,
        from_rest: bool = False,
        accelerated: bool = False,
        controlled: bool = False,
        aligned: bool = False,
    ) -> "PrescribedPathProgram":
        """Return the program of a robot, built at the first use and kept; flags select its constraints."""
        return _build(robot, points, from_rest, accelerated, controlled, aligned)

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
        angles, fastest = self._angle_bounds(limits, fraction), self._rate_bound(limits, fraction)
        guess = np.clip(guess, *angles)
        states = np.vstack([capture.start, guess])
        rates = np.clip(grid.slope @ states / half, -fastest, fastest)
        x0, p = [guess, rates], [capture.start, [half], path.velocity(times[1:]).ravel()]
        low, high = [angles[0], -fastest], [angles[1], fastest]
        if self.aligned:
            x0.append(capture.start + half * grid.weights[None] @ rates)
            low.append(angles[0][:1])
            high.append(angles[1][:1])
            p.append(end_parameters(self.robot, capture))
        least, most = self._constraint_bounds(limits, fraction, half)
        found = self.solver(
            x0=np.concatenate(x0).ravel(),
            p=np.concatenate(p),
            lbx=np.concatenate(low).ravel(),
            ubx=np.concatenate(high).ravel(),
            lbg=least,
            ubg=most,
        )
        status = self.solver.stats()["return_status"]
        if status not in ("Solve_Succeeded", "Solved_To_Acceptable_Level"):
            return Failure(METHOD, Cause.SOLVER, f"Ipopt ended with {status}")
        angles, rates = np.array(found["x"])[: 2 * count * n].reshape(2, count, n)
        return CollocatedMotion(times, np.vstack([capture.start, angles]), rates, float(found["f"]))

    def _angle_bounds(self, limits: Limits, fraction: float) -> tuple[Array, Array]:
        """Lowest and highest angles (N, n) at the Gauss points, rad."""
        low, high = limits.angles(self.joints).T
        if limits.position is not None:
            margin = 0.5 * (1.0 - fraction) * (high - low)
            low, high = low + margin, high - margin
        return np.tile(low, (self.points, 1)), np.tile(high, (self.points, 1))

    def _rate_bound(self, limits: Limits, fraction: float) -> Array:
        """Largest rates (N, n) at the Gauss points, rad/s."""
        fastest = np.inf if limits.rate is None else fraction * limits.rate
        return np.broadcast_to(fastest, (self.points, self.joints))

    def _constraint_bounds(self, limits: Limits, fraction: float, half: float) -> tuple[Array, Array]:
        """Lowest and highest values of the constraints."""
        most = np.zeros(self.solver.size_in("lbg")[0])
        accelerations = ACCELERATION_POINTS * self.joints
        if len(most) >= self.equalities + accelerations and limits.acceleration is not None:
            largest = np.broadcast_to(fraction * limits.acceleration * half**2, self.joints)
            most[self.equalities :][:accelerations] = np.tile(largest, ACCELERATION_POINTS)
        if limits.control is not None:
            most[self.rows - 1 : self.rows * self.points : self.rows] = fraction * limits.control
        least = -most
        if self.aligned:
            least[-ALIGNMENTS:], most[-ALIGNMENTS:] = end_bounds()
        return least, most


@built_once
def _build(
    robot: FloatingRobot, points: int, from_rest: bool, accelerated: bool, controlled: bool, aligned: bool
) -> PrescribedPathProgram:
    model, grid, n = HeldAttitude.of(robot), gauss_grid(points), robot.n_joints
    rows = model.dimensions * 2 + model.momenta + int(controlled)
    # Rates are variables of their own, related to the angles by linear equations: derivatives then couple
    # only variables of one point, and are assembled from functions of one point. So are the angles at the
    # end where they are constrained.
    local = point_functions(robot, controlled)
    x, rates, start, half, velocity = (
        ca.MX.sym(name, *size)
        for name, size in (
            ("x", (n, points)),
            ("rates", (n, points)),
            ("start", (n, 1)),
            ("half", (1, 1)),
            ("velocity", (2 * model.dimensions, points)),
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
    slopes, energy_slopes = local["slope"].map(points)(x, rates)
    factor = ca.MX.sym("factor")
    multipliers = ca.MX.sym("multipliers", constraints.numel() + (n + ALIGNMENTS if aligned else 0))
    share = ca.reshape(multipliers[: rows * points], rows, points)
    bends = local["bend"].map(points)(x, rates, share, factor * half * weights)
    program = NonlinearProgram(
        variables,
        parameters,
        cost,
        constraints,
        gradient(ca.reshape(energy_slopes, 2 * n, points), half, n, weights),
        jacobian(slopes, linear, half, n, rows),
        (factor, multipliers),
        hessian(bends, n, points),
    )
    if aligned:
        spans = half * weights
        program = with_aligned_end(robot, program, start + rates @ spans.T, spans)
    solver = program.solver({"ipopt": IPOPT, "print_time": False, "error_on_fail": False})
    equalities = (rows + n) * points + (n if from_rest else 0)
    return PrescribedPathProgram(robot, solver, points, n, rows, equalities, aligned)
