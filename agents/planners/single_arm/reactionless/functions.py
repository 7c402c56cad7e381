"""Compiled roll-outs of paths in the reaction null space of one robot, with exact sensitivities.

A path q(s) over the phase s from 0 to 1 follows dq/ds = P(q) v(s). P is the projector onto the null space of
A(q), the angular momentum about the centre of mass per joint rate while the base does not rotate: at zero
momentum the base keeps its attitude if and only if A(q) dq/ds = 0, at any timing. Derivatives are those of
one stage of the classical Runge-Kutta method, contracted with the vectors at hand; their products make up
those of a step.
"""

from dataclasses import dataclass

import casadi as ca

from space_envs.codegen.functions import Batched, batched
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.symbolic import SymbolicRobot

FINER = 4  # steps of a plan for one of the search


@dataclass(frozen=True, eq=False)
class FlowFunctions:
    """Functions of one robot, K functions of the phase and N steps; every input has leading batch axes.

    Attributes:
        path: start (n), velocity (3 n N) v at the start, the middle and the end of every step -> angle (N, n)
            after each step, slope (N, n) = dq/ds before it.
        sensitive: start (n), velocity (3 n N), shape (3 K N) values of the functions of the phase at the same
            points -> as `path`, then the derivatives of both by the weights, (N n, K n) each: rows by step
            and joint, columns by function and joint.
        fine: as `path`, with FINER N steps.
        centre: q (n) -> centre of mass (3) m in the base frame, its derivative (3, n).
    """

    path: Batched
    sensitive: Batched
    fine: Batched
    centre: Batched

    @classmethod
    def of(cls, robot: FloatingRobot, functions: int, steps: int) -> "FlowFunctions":
        """Return the functions of a robot, built at the first use and kept.

        Warns:
            NoCompiledCodeWarning: if they are interpreted, up to twenty times slower.
        """
        return _build(robot, functions, steps)


@built_once
def _build(robot: FloatingRobot, functions: int, steps: int) -> FlowFunctions:
    symbolic = SymbolicRobot(robot)
    q = ca.SX.sym("q", robot.n_joints)
    centre = symbolic.kinematics(q)[-1]
    slope = ca.densify(ca.jacobian(centre, q)).T
    stage, sensitive_stage = _stages(symbolic)
    made = {
        "path": _path(_step(stage, 1.0 / steps), steps),
        "fine": _path(_step(stage, 1.0 / (FINER * steps)), FINER * steps),
        "sensitive": _path(_sensitive_step(sensitive_stage, 1.0 / steps, functions), steps),
        "centre": ca.Function("centre", [q], ca.cse([centre, slope])),
    }
    return FlowFunctions(**batched(made, optimise=True))


def _stages(symbolic: SymbolicRobot) -> tuple[ca.Function, ca.Function]:
    """q, v -> P v; and the same with its derivative by q and with P, its derivative by v."""
    n = symbolic.robot.n_joints
    q, v, frozen = (ca.SX.sym(name, n) for name in ("q", "v", "frozen"))
    multiplier = ca.SX.sym("multiplier", 3)
    momentum = symbolic.momentum(q, v, ca.SX(6, 1))
    spin = momentum[3:] - ca.cross(symbolic.kinematics(q)[-1], momentum[:3])
    rows = ca.densify(ca.jacobian(spin, v))  # A(q)
    inverse = rows.T @ _inverse(rows @ rows.T)
    solved = inverse.T @ v
    slope = v - rows.T @ solved
    projector = ca.SX.eye(n) - inverse @ rows
    # With A x = 0 for x = P v: dx = -P dA' l - A^+ dA x, where l solves A A' l = A v.
    contracted = ca.Function(
        "contracted",
        [q, multiplier, frozen],
        [ca.jacobian(rows.T @ multiplier, q), ca.jacobian(rows @ frozen, q)],
    )
    turned, moved = contracted.call([q, solved, slope], True, False)
    by_angle = -(projector @ turned + inverse @ moved)
    plain = ca.Function("stage", [q, v], ca.cse([slope]))
    outputs = [slope, ca.densify(by_angle), ca.densify(projector)]
    return plain, ca.Function("sensitive_stage", [q, v], ca.cse(outputs))


def _inverse(a: ca.SX) -> ca.SX:
    """Inverse of a symmetric matrix (3, 3) by its cofactors."""
    columns = [a[:, 0], a[:, 1], a[:, 2]]
    crossed = [ca.cross(columns[k - 2], columns[k - 1]) for k in range(3)]
    return ca.horzcat(*crossed) / ca.dot(columns[0], crossed[0])


def _step(stage: ca.Function, h: float) -> ca.Function:
    """A step: q, v at its start, middle and end (3 n) -> q after it, again, and dq/ds before it."""
    n = stage.numel_in(0)
    q, given = ca.MX.sym("q", n), ca.MX.sym("v", 3 * n)
    start, middle, end = ca.vertsplit(given, n)
    first = stage(q, start)
    second = stage(q + h / 2.0 * first, middle)
    third = stage(q + h / 2.0 * second, middle)
    fourth = stage(q + h * third, end)
    after = q + h / 6.0 * (first + 2.0 * second + 2.0 * third + fourth)
    return ca.Function("plain_step", [q, given], [after, after, first])


def _sensitive_step(stage: ca.Function, h: float, functions: int) -> ca.Function:
    """The same with derivatives by the weights: inputs and outputs are followed by theirs.

    State: [q; derivatives (n, K n) by columns]. Inputs: v (3 n), functions (3 K) at start, middle and end.
    """
    n = stage.numel_in(0)
    state, given = ca.MX.sym("state", n + n * n * functions), ca.MX.sym("v", 3 * n)
    shape = ca.MX.sym("shape", functions, 3)
    q, moved = state[:n], ca.reshape(state[n:], n, n * functions)
    start, middle, end = ca.vertsplit(given, n)
    # Each stage's derivative by q before the step, and by v at its start and in its middle.
    k1, by_q1, by_v1 = stage(q, start)
    k2, slope2, by_v2 = stage(q + h / 2.0 * k1, middle)
    k3, slope3, by_v3 = stage(q + h / 2.0 * k2, middle)
    k4, slope4, by_v4 = stage(q + h * k3, end)
    by_q2, start2 = slope2 + h / 2.0 * (slope2 @ by_q1), h / 2.0 * (slope2 @ by_v1)
    by_q3, start3 = slope3 + h / 2.0 * (slope3 @ by_q2), h / 2.0 * (slope3 @ start2)
    middle3 = by_v3 + h / 2.0 * (slope3 @ by_v2)
    by_q4, start4, middle4 = slope4 + h * (slope4 @ by_q3), h * (slope4 @ start3), h * (slope4 @ middle3)
    by_q = ca.MX.eye(n) + h / 6.0 * (by_q1 + 2.0 * by_q2 + 2.0 * by_q3 + by_q4)
    by_v = [
        h / 6.0 * (by_v1 + 2.0 * start2 + 2.0 * start3 + start4),
        h / 6.0 * (2.0 * by_v2 + 2.0 * middle3 + middle4),
        h / 6.0 * by_v4,
    ]
    added = ca.horzcat(*map(ca.vec, by_v)) @ shape.T  # (n n, K)
    after = by_q @ moved + ca.reshape(added, n, n * functions)
    slope = by_q1 @ moved + ca.reshape(ca.vec(by_v1) @ shape[:, 0].T, n, n * functions)
    angle = q + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    following = ca.vertcat(angle, ca.vec(after))
    return ca.Function(
        "sensitive_step", [state, given, ca.vec(shape)], [following, angle, k1, after.T, slope.T]
    )


def _path(step: ca.Function, steps: int) -> ca.Function:
    """All steps from a start: the outputs of `step` but the state, next to each other."""
    size, n = step.numel_in(0), step.numel_out(1)
    start = ca.MX.sym("start", n)
    given = [ca.MX.sym(f"given{k}", step.numel_in(k) * steps) for k in range(1, step.n_in())]
    columns = [ca.reshape(x, -1, steps) for x in given]
    state = ca.vertcat(start, ca.MX.zeros(size - n))
    outputs = step.mapaccum(steps)(state, *columns)[1:]
    name = f"{step.name().replace('step', 'path')}_{steps}"
    return ca.Function(name, [start, *given], list(outputs))
