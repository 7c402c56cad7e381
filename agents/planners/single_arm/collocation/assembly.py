"""Objective and constraints of the collocation program, assembled block by block with their derivatives."""

from dataclasses import dataclass
from functools import cached_property

import casadi as ca
import numpy as np
from scipy.sparse import csc_matrix

from agents.planners.common.ipopt import NonlinearProgram
from agents.planners.single_arm.collocation.derivatives import Block, gradient, hessian, jacobian
from agents.planners.single_arm.collocation.interval import ORDER
from agents.planners.single_arm.collocation.layout import Inputs, Layout
from agents.planners.single_arm.collocation.mesh import (
    INTERVALS,
    MESH,
    at_gauss_points,
    curvature,
    sample_times,
)
from agents.planners.single_arm.collocation.model import SingleArm, Torque
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.tasks.goals.kinds import GOAL_ROWS, GoalKind

SCALE = 100.0  # of the objective, so that it is of order one
# On the mean square of the second derivatives by s, in units of the objective before SCALE: one direction of
# joint rates moves no base, and without smoothing the splines would be undetermined there.
SMOOTHING = 1e-7


@dataclass(frozen=True)
class OptionalConstraints:
    """Constraints that not all programs have.

    Attributes:
        rates: whether joint rates and accelerations are bounded.
        torques: for each bound on torques whether it is on the whole torque, or on what the rates alone
            require. spheres: number of keep-out spheres. goal: kind of the goal.
    """

    rates: bool
    torques: tuple[bool, ...]
    spheres: int
    goal: GoalKind = "pose"


class Assembly:
    """Expressions of one program, block by block.

    Attributes:
        linear: numbers of rows for rates and for accelerations. clearances: number of constraints.
    """

    def __init__(self, robot: FloatingRobot, constraints: OptionalConstraints) -> None:
        self._robot, self._model, self._constraints = robot, SingleArm.of(robot), constraints
        self._ending, self._end_rows = self._model.ending_of(constraints.goal), GOAL_ROWS[constraints.goal]
        self._n = n = robot.n_joints
        self._layout = layout = Layout(MESH, n)
        spheres = constraints.spheres
        self._x = ca.MX.sym("x", layout.size)
        self._p = p = ca.MX.sym("p", 3 * n + 16 + 4 * spheres)
        fixed, last = ca.reshape(p[: 2 * n], n, 2), p[2 * n : 3 * n]
        self._com, self._place = p[3 * n : 3 * n + 3], p[3 * n + 3 : 3 * n + 6]
        self._goal, self._c2 = ca.reshape(p[3 * n + 6 : 3 * n + 15], 3, 3), p[3 * n + 15]
        self._spheres = ca.reshape(p[3 * n + 16 :], 4, spheres)
        free = ca.reshape(self._x[: layout.attitudes], n, layout.free)
        self._coefficients = ca.horzcat(fixed, free, free[:, -1] + last)
        attitudes = ca.reshape(self._x[layout.attitudes :], 3, INTERVALS)
        self._r = ca.horzcat(ca.MX(3, 1), attitudes)
        self._constraint_values: list[ca.MX] = []
        self._blocks: list[Block] = []
        self._rows = 0  # constraints so far
        self.linear, self.clearances = (0, 0), 0

    def program(self) -> NonlinearProgram:
        """Assemble the program from all its blocks."""
        summed = self._add_defects()
        self._add_end()
        linear = self._add_linear()
        for whole in self._constraints.torques:
            self._add_torques(whole)
        first_clearance = self._rows
        for number in range(self._constraints.spheres):
            self._add_clearances(number)
        self.clearances = self._rows - first_clearance
        slope = self._blocks[0].slope
        pull = self._coefficients @ ca.DM(self._square)
        f = SCALE * (ca.sum2(summed[0, :]) + 0.5 * ca.dot(pull, self._coefficients))
        g, layout = ca.vertcat(*self._constraint_values), self._layout
        factor, multipliers = ca.MX.sym("lam_f"), ca.MX.sym("lam_g", g.numel())
        return NonlinearProgram(
            self._x,
            self._p,
            f,
            g,
            SCALE * gradient(layout, self._intervals, slope, pull),
            jacobian(layout, self._blocks, linear, 3 * INTERVALS + self._end_rows, g.numel()),
            (factor, multipliers),
            self._hessian(factor, multipliers, first_clearance),
        )

    def _add(self, values: ca.MX, block: Block | None = None) -> None:
        self._constraint_values.append(values)
        self._rows += values.numel()
        if block is not None:
            self._blocks.append(block)

    @cached_property
    def _interval_inputs(self) -> list[ca.MX | ca.DM]:
        lengths = np.diff(MESH.breaks)
        value, slope = at_gauss_points()
        columns = (np.arange(INTERVALS)[:, None] + np.arange(ORDER)).ravel().tolist()
        return [
            self._coefficients[:, columns],
            self._r[:, :-1],
            self._r[:, 1:],
            ca.DM(value),
            ca.DM(slope),
            ca.DM(lengths).T,
            ca.repmat(self._c2, 1, INTERVALS),
        ]

    @cached_property
    def _intervals(self) -> list[Inputs]:
        layout = self._layout
        variables = [
            [*(layout.coefficient(k + a) for a in range(ORDER)), layout.attitude(k), layout.attitude(k + 1)]
            for k in range(INTERVALS)
        ]
        return [Inputs.of(np.concatenate(parts)) for parts in variables]

    @cached_property
    def _square(self) -> Array:
        return SMOOTHING * curvature()

    def _add_defects(self) -> ca.MX:
        """Add the defects of the attitude; return them below the integrals of eq. 20, (4, N)."""
        summed = self._model.interval.value.map(INTERVALS)(*self._interval_inputs)
        slope = self._model.interval.slope.map(INTERVALS)(*self._interval_inputs)
        self._add(ca.vec(summed[1:, :]), Block(0, 3, self._intervals, slope))
        return summed

    def _end_inputs(self) -> list[ca.MX]:
        return [self._coefficients[:, -1], self._r[:, -1], self._com, self._goal]

    @cached_property
    def _end(self) -> list[Inputs]:
        layout = self._layout
        variables = [layout.coefficient(MESH.size - 1), layout.attitude(INTERVALS)]
        return [Inputs.of(np.concatenate(variables))]

    def _add_end(self) -> None:
        inputs, ending, rows = self._end_inputs(), self._ending, self._end_rows
        values = ending.value(*inputs) - ca.vertcat(self._place, ca.MX(rows - 3, 1))
        self._add(values, Block(self._rows, rows, self._end, ending.slope(*inputs)))

    def _add_linear(self) -> Array:
        """Add rates and accelerations; return their rows on a joint's coefficients."""
        rates, accelerations = MESH.rate_rows()[1:-1], MESH.basis(MESH.breaks, 2)
        if not self._constraints.rates:
            rates, accelerations = rates[:0], accelerations[:0]
        linear = np.concatenate([rates, accelerations])
        self._add(ca.vec(self._coefficients @ ca.DM(csc_matrix(linear.T))))
        self.linear = len(rates), len(accelerations)
        return linear

    @cached_property
    def _states(self) -> list[ca.MX]:
        """Angles and their first and second derivatives (n, T) at the sample times."""
        times = sample_times()
        return [self._coefficients @ ca.DM(csc_matrix(MESH.basis(times, k).T)) for k in range(3)]

    def _add_torques(self, whole: bool) -> None:
        torque, times, n = Torque.of(self._robot), sample_times(), self._n
        state = self._states if whole else [*self._states[:2], ca.MX(n, len(times))]
        points = [Inputs.of_splines(self._layout, t, (0, 1, 2) if whole else (0, 1)) for t in times]
        slope = torque.slope.map(len(times))(*state)
        if not whole:
            slope = slope[:, [k * 3 * n + i for k in range(len(times)) for i in range(2 * n)]]
        values = ca.vec(torque.value.map(len(times))(*state))
        self._add(values, Block(self._rows, n, points, slope))

    @cached_property
    def _sphere_inputs(self) -> list[list[ca.MX]]:
        angles = self._coefficients @ ca.DM(csc_matrix(MESH.basis(MESH.breaks[1:], 0).T))
        shared = [angles, self._r[:, 1:], ca.repmat(self._com, 1, INTERVALS)]
        count = self._constraints.spheres
        return [[*shared, ca.repmat(self._spheres[:3, k], 1, INTERVALS)] for k in range(count)]

    @cached_property
    def _breaks(self) -> list[Inputs]:
        layout = self._layout
        return [
            Inputs.of_splines(layout, time, (0,)).joined(layout.attitude(k))
            for k, time in enumerate(MESH.breaks[1:], 1)
        ]

    def _add_clearances(self, number: int) -> None:
        inputs, spheres = self._sphere_inputs[number], self._model.spheres
        values = ca.vec(spheres.value.map(INTERVALS)(*inputs))
        slope = spheres.slope.map(INTERVALS)(*inputs)
        self._add(values, Block(self._rows, len(self._model.links), self._breaks, slope))

    def _hessian(self, factor: ca.MX, multipliers: ca.MX, first_clearance: int) -> ca.MX:
        """Upper triangle of the Lagrangian's Hessian, without the curvature of torques."""
        defects = ca.reshape(multipliers[: 3 * INTERVALS], 3, INTERVALS)
        weight = ca.vertcat(ca.repmat(SCALE * factor, 1, INTERVALS), defects)
        interval = self._model.interval.bend.map(INTERVALS)(*self._interval_inputs, weight)
        ends = multipliers[3 * INTERVALS : 3 * INTERVALS + self._end_rows]
        bends = [
            (self._intervals, interval),
            (self._end, self._ending.bend(*self._end_inputs(), ends)),
        ]
        size = len(self._model.links) * INTERVALS
        for number in range(self._constraints.spheres):
            first = first_clearance + number * size
            share = ca.reshape(multipliers[first : first + size], len(self._model.links), INTERVALS)
            bend = self._model.spheres.bend.map(INTERVALS)(*self._sphere_inputs[number], share)
            bends.append((self._breaks, bend))
        return hessian(self._layout, bends, SCALE * self._square, factor)
