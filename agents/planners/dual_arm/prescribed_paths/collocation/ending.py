"""Constraints of the program on the approach axes at the end of a motion in space."""

import casadi as ca
import numpy as np

from agents.planners.common.ipopt import NonlinearProgram
from agents.planners.dual_arm.goals import EndGoals
from agents.planners.dual_arm.held_attitude import HeldAttitude
from agents.planners.dual_arm.problem import Capture
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

LEAST_COSINE = 0.1  # of the angle between an approach axis and its goal, whose opposite is aligned too
ALIGNMENTS = 4 + 2  # constraints: tilts, which have to vanish, and cosines of the angles to the goals


def with_aligned_end(
    robot: FloatingRobot, program: NonlinearProgram, reached: ca.MX, weights: ca.MX
) -> NonlinearProgram:
    """Extend a program by the angles at the end and its constraints on them.

    Args:
        program: its multipliers are those of the extended one; its last variables are the rates (n, N).
        reached: (n,) the end, by the quadrature of the rates with `weights` (1, N), s.
    """
    n, before = robot.n_joints, program.g.numel()
    end, aim = ca.MX.sym("end", n), ca.MX.sym("aim", 24)
    factor, multipliers = program.multipliers
    value, slope, bend = _alignment(robot, end, aim, multipliers[before + n :])
    by_rates = ca.kron(weights, ca.MX.eye(n))
    angles = ca.MX(n, program.x.numel() - by_rates.size2())
    slopes = ca.vertcat(
        ca.horzcat(program.jacobian, ca.MX(before, n)),
        ca.horzcat(angles, by_rates, -ca.MX.eye(n)),
        ca.horzcat(ca.MX(ALIGNMENTS, program.x.numel()), slope),
    )
    return NonlinearProgram(
        ca.vertcat(program.x, end),
        ca.vertcat(program.p, aim),
        program.f,
        ca.vertcat(program.g, reached - end, value),
        ca.vertcat(program.gradient, ca.DM.zeros(n)),
        slopes,
        (factor, multipliers),
        ca.diagcat(program.hessian, ca.triu(bend)),
    )


def _alignment(
    robot: FloatingRobot, end: ca.MX, aim: ca.MX, multipliers: ca.MX
) -> tuple[ca.MX, ca.MX, ca.MX]:
    """Constraints (6,) on the angles at the end, their derivatives (6, n), and the weighted second ones."""
    model, n = HeldAttitude.of(robot), robot.n_joints
    first = model.ending.value.numel_out(0) - model.tilts
    rest, across, along = ca.DM(n, 1), ca.reshape(aim[:12], 3, 4), ca.reshape(aim[12:], 3, 4)
    tilts, cosines = list(range(first, first + 4)), [first, first + 2]
    values, slopes, bends = model.ending.value, model.ending.slope, model.ending.bend
    value = ca.vertcat(values(end, rest, across)[tilts], values(end, rest, along)[cosines])
    slope = ca.vertcat(slopes(end, rest, across)[tilts, :n], slopes(end, rest, along)[cosines, :n])
    other = ca.vertcat(ca.DM(first, 1), multipliers[4], 0.0, multipliers[5], 0.0)
    bend = bends(end, rest, across, ca.vertcat(ca.DM(first, 1), multipliers[:4]))
    return value, slope, (bend + bends(end, rest, along, other))[:n, :n]


def end_bounds() -> tuple[Array, Array]:
    """Lowest and highest values (6,) of the constraints."""
    return np.array([0.0] * 4 + [LEAST_COSINE] * 2), np.array([0.0] * 4 + [np.inf] * 2)


def end_parameters(robot: FloatingRobot, capture: Capture) -> Array:
    """Parameters (24,) of a capture with approach axes: directions across each goal axis, and the axes."""
    across = EndGoals.of(robot, HeldAttitude.of(robot), capture).across
    along = np.zeros((3, 4))
    along[:, ::2] = np.asarray(capture.axis).T
    return np.concatenate([across.T.ravel(), along.T.ravel()])
