"""Functions of one point of the collocation, and the sparse derivatives of the program."""

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from agents.planners.common.smooth import Smooth, smooth_parts
from agents.planners.dual_arm.held_attitude import HeldAttitude
from agents.planners.dual_arm.prescribed_paths.model import PathModel
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array


def point_functions(robot: FloatingRobot, controlled: bool) -> dict[str, ca.Function]:
    """Residual and energy at one point, their first derivatives and weighted second derivatives.

    Args:
        controlled: whether the component of zeta is the last residual, of a robot with one at each instant;
            its functions are interpreted, as a compiler takes minutes for them.
    """
    model, n, d = HeldAttitude.of(robot), robot.n_joints, HeldAttitude.of(robot).dimensions
    scale = PathModel.of(robot).scale
    q, qdot, v = (ca.MX.sym(name, size) for name, size in (("q", n), ("qdot", n), ("v", 2 * d)))
    any_axis, rows = ca.DM(3, 4), slice(2 * d, 4 * d + model.momenta)
    weights = ca.vertcat(ca.DM.ones(2 * d), ca.DM.ones(model.momenta) / scale)
    value = weights * model.ending.value(q, qdot, any_axis)[rows] - ca.vertcat(v, ca.DM(model.momenta, 1))
    slope = ca.repmat(weights, 1, 2 * n) * model.ending.slope(q, qdot, any_axis)[rows, :]
    share, weight = ca.MX.sym("share", weights.numel() + int(controlled)), ca.MX.sym("weight")
    of_rows = ca.vertcat(ca.DM(2 * d, 1), weights * share[: weights.numel()], ca.DM(model.tilts, 1))
    bend = model.ending.bend(q, qdot, any_axis, of_rows) + model.energy.bend(q, qdot, weight)
    if controlled:
        zeta = _zeta_component(robot)
        value, slope = ca.vertcat(value, zeta.value(q, qdot)), ca.vertcat(slope, zeta.slope(q, qdot))
        bend = bend + zeta.bend(q, qdot, share[-1])
    energy, pull = model.energy.value(q, qdot), model.energy.slope(q, qdot).T
    outputs = {
        "value": ([q, qdot, v], [value, energy]),
        "slope": ([q, qdot], [slope, pull]),
        "bend": ([q, qdot, share, weight], [bend]),
    }
    return {name: ca.Function(f"point_{name}", *given) for name, given in outputs.items()}


def _zeta_component(robot: FloatingRobot) -> Smooth:
    """zeta: dependent angular velocities along the direction in which the null space changes them."""
    n = robot.n_joints
    q, qdot = ca.SX.sym("q", n), ca.SX.sym("qdot", n)
    _, task, angular, _ = PathModel.of(robot).symbolic(q)
    columns = [[j for j in range(n) if j != omitted] for omitted in range(n)]
    null = ca.vertcat(*[(-1) ** omitted * ca.det(task[:, c]) for omitted, c in enumerate(columns)])
    direction = angular @ null
    component = ca.dot(direction, angular @ qdot) / ca.norm_2(direction)
    return Smooth.named(smooth_parts("zeta", component, [q, qdot], []), "zeta")


def jacobian(slopes: ca.MX, linear: list[Array], half: ca.MX, n: int, rows: int) -> ca.MX:
    """Jacobian of the constraints by [x; rates].

    Args:
        slopes: (rows, 2 n points) derivatives of the residuals by the angles and rates of their point.
        linear: matrices on [start; x] of a joint; the first constraint also has minus half the rates.
    """
    points = slopes.size2() // (2 * n)
    # Rows and columns of the entries of the points' blocks, (rows, 2 n) each.
    point, row, column = np.meshgrid(np.arange(points), np.arange(rows), np.arange(2 * n), indexing="ij")
    variable = np.where(column < n, point * n + column, points * n + point * n + column - n)
    # vec() is column by column in each block.
    down = [(rows * point + row).transpose(0, 2, 1).ravel()]
    across = [variable.transpose(0, 2, 1).ravel()]
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
    return _sparse(offset, 2 * n * points, np.concatenate(down), np.concatenate(across), values)


def gradient(slopes: ca.MX, half: ca.MX, n: int, weights: ca.DM) -> ca.MX:
    """Gradient of the cost by [x; rates], from the derivatives (2 n, points) of the energies."""
    scaled = half * (slopes * ca.repmat(weights, 2 * n, 1))
    return ca.vertcat(ca.vec(scaled[:n, :]), ca.vec(scaled[n:, :]))


def hessian(bends: ca.MX, n: int, points: int) -> ca.MX:
    """Upper triangle of the Lagrangian's Hessian, from the points' (2 n, 2 n) blocks."""
    point, column, row = np.meshgrid(np.arange(points), np.arange(2 * n), np.arange(2 * n), indexing="ij")

    def variable(entry: NDArray[np.int64]) -> NDArray[np.int64]:
        return np.where(entry < n, point * n + entry, points * n + point * n + entry - n)

    down, across = variable(row).ravel(), variable(column).ravel()
    upper = np.flatnonzero(down <= across)
    size = 2 * n * points
    return _sparse(size, size, down[upper], across[upper], [ca.vec(bends)[upper.tolist()]])


def _sparse(
    height: int, width: int, down: NDArray[np.int64], across: NDArray[np.int64], values: list[ca.MX]
) -> ca.MX:
    """Sparse matrix from the rows and columns of its entries."""
    order = np.lexsort((down, across))  # by column, then by row
    pattern = ca.Sparsity.triplet(height, width, down[order].tolist(), across[order].tolist())
    return ca.MX(pattern, ca.vertcat(*values)[order.tolist()])
