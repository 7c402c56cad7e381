"""First and second derivatives of the collocation program as sparse matrices."""

from dataclasses import dataclass
from itertools import product

import casadi as ca
import numpy as np

from agents.planners.common.splines import Terms
from agents.planners.single_arm.collocation.layout import Inputs, Layout
from space_envs.dynamics.rotations import Array


@dataclass(frozen=True, eq=False)
class Block:
    """Constraints from one function at several points.

    Attributes:
        first: row of the first constraint. height: constraints per point, the last outputs of the function.
        points: inputs of the function. slope: its derivatives by the inputs, point by point.
    """

    first: int
    height: int
    points: list[Inputs]
    slope: ca.MX


def jacobian(layout: Layout, blocks: list[Block], linear: Array, first: int, rows: int) -> ca.MX:
    """Jacobian (rows, variables) of the constraints.

    Args:
        linear: rows on the coefficients of each joint, from the row `first` on.
    """
    terms, offset, sources = Terms(), 0, []
    for block in blocks:
        outputs = block.slope.shape[0]
        row = np.arange(block.height)[:, None]
        for k, point in enumerate(block.points):
            inputs = len(point.variables)
            for used, variable, factor in point.entries():
                source = offset + (k * inputs + used) * outputs + row + outputs - block.height
                terms.add(block.first + k * block.height + row, variable, source, factor)
        sources.append(ca.vec(block.slope))
        offset += block.slope.numel()
    n = layout.n
    for number, basis in enumerate(linear.T):
        variable = layout.coefficient(number)
        if variable[0] >= 0:
            row = first + np.arange(len(linear))[:, None] * n + np.arange(n)
            terms.add(row, variable, offset, basis[:, None])
    return terms.matrix(ca.vertcat(*sources, ca.MX(1.0)), (rows, layout.size))


def gradient(layout: Layout, intervals: list[Inputs], slope: ca.MX, curvature: ca.MX) -> ca.MX:
    """Gradient of a sum over intervals plus a quadratic form of the coefficients.

    Args:
        slope: derivatives of the summand, the first output, by the inputs. curvature: (n, size) gradient of
            the quadratic form.
    """
    terms, inputs = Terms(), len(intervals[0].variables)
    outputs = slope.shape[0]
    for k, point in enumerate(intervals):
        for used, variable, factor in point.entries():
            terms.add(variable, 0, (k * inputs + used) * outputs, factor)
    first = slope.numel()
    for number in range(layout.mesh.size):
        variable = layout.coefficient(number)
        if variable[0] >= 0:
            terms.add(variable, 0, first + number * layout.n + np.arange(layout.n), 1.0)
    sources = ca.vertcat(ca.vec(slope), ca.vec(curvature))
    return ca.densify(terms.matrix(sources, (layout.size, 1)))


def hessian(layout: Layout, bends: list[tuple[list[Inputs], ca.MX]], square: Array, factor: ca.MX) -> ca.MX:
    """Upper triangle of the Lagrangian's Hessian.

    Args:
        bends: inputs of functions and their weighted second derivatives, point by point. square: (size, size)
            quadratic form of the coefficients in the objective. factor: of the objective.
    """
    terms, offset = Terms(), 0
    for points, bend in bends:
        for k, point in enumerate(points):
            size = len(point.variables)
            for (one, row, left), (two, column, right) in product(list(point.entries()), repeat=2):
                upper = row[:, None] <= column
                source = offset + (k * size + two) * size + one[:, None]
                terms.add(row[:, None], column, source, left[:, None] * right * upper)
        offset += bend.numel()
    for one, two in zip(*np.nonzero(square), strict=True):
        row, column = layout.coefficient(int(one)), layout.coefficient(int(two))
        if row[0] >= 0 and column[0] >= 0 and row[0] <= column[0]:
            terms.add(row, column, offset, square[one, two])
    sources = ca.vertcat(*[ca.vec(bend) for _, bend in bends], factor)
    return terms.matrix(sources, (layout.size, layout.size))
