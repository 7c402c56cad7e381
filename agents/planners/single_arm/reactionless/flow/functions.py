"""Compiled roll-outs of paths in the reaction null space of one robot, with exact sensitivities.

A path q(s) over the phase s from 0 to 1 follows dq/ds = P(q) v(s). P is the projector onto the null space of
A(q), the angular momentum about the centre of mass per joint rate while the base does not rotate: at zero
momentum the base keeps its attitude if and only if A(q) dq/ds = 0, at any timing. A path is rolled out first,
step by step; the derivatives of all its steps of the classical Runge-Kutta method are then computed side by
side, and chained.
"""

from dataclasses import dataclass

import casadi as ca

from agents.planners.single_arm.reactionless.flow.chain import StepChain
from agents.planners.single_arm.reactionless.flow.stage import FlowStage
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
            after each step, slope (N, n) = dq/ds before it, points (N, 4 n) at which each step takes a slope.
        fine: as `path`, with FINER N steps.
        slopes: q (n), v (n) -> derivatives (n, n) of P v by q and by v.
        transfer: these at the four points of a step (4 n n each) -> derivatives (n, n) of the angle after it
            by that before it, and by v at its start, middle and end; then those of its slope by angle and v.
        centre: q (n) -> centre of mass (3) m in the base frame, its derivative (3, n).
        twist: q (n), rate (n) in the reaction null space -> twist (6) [v; w] of the end-effector, its
            derivatives (6, n) by q and by the rate.
        chain: of the derivatives of all steps.
    """

    path: Batched
    fine: Batched
    slopes: Batched
    transfer: Batched
    centre: Batched
    twist: Batched
    chain: StepChain

    @classmethod
    def of(cls, robot: FloatingRobot, functions: int, steps: int) -> "FlowFunctions":
        """Return the functions of a robot, built at the first use and kept.

        Warns:
            NoCompiledCodeWarning: if they are interpreted, up to twenty times slower.
        """
        return _build(robot, functions, steps)


@built_once
def _build(robot: FloatingRobot, functions: int, steps: int) -> FlowFunctions:
    stage = FlowStage(robot)
    plain = ca.Function("stage", [stage.q, stage.v], ca.cse([stage.slope]))
    slopes = [ca.densify(x.T) for x in (stage.by_angle(), stage.projector)]
    paths = {
        "twist": _twist(robot, stage),
        "path": _path(_step(plain, 1.0 / steps), steps),
        "fine": _path(_step(plain, 1.0 / (FINER * steps)), FINER * steps),
    }
    alone = {
        "slopes": ca.Function("slopes", [stage.q, stage.v], ca.cse(slopes)),
        "transfer": _transfer(robot.n_joints, 1.0 / steps),
        "centre": ca.Function("centre", [stage.q], ca.cse([stage.centre, stage.centre_by_angle.T])),
    }
    found = batched(paths, optimise=True) | batched(alone, vectorise=True)
    return FlowFunctions(**found, chain=StepChain(robot.n_joints, functions, steps))


def _twist(robot: FloatingRobot, stage: FlowStage) -> ca.Function:
    """Twist of the end-effector while the base moves without rotation, see `FlowFunctions.twist`."""
    place, rotation = SymbolicRobot(robot).end_effector_pose(0)(stage.q)
    spins = [
        ca.inv_skew(ca.reshape(ca.jacobian(ca.vec(rotation), stage.q[j]), 3, 3) @ rotation.T)
        for j in range(robot.n_joints)
    ]
    jacobian = ca.vertcat(ca.jacobian(place, stage.q) - stage.centre_by_angle, ca.horzcat(*spins))
    twist = jacobian @ stage.v
    outputs = [twist, ca.densify(ca.jacobian(twist, stage.q)).T, ca.densify(jacobian).T]
    return ca.Function("twist", [stage.q, stage.v], ca.cse(outputs))


def _step(stage: ca.Function, h: float) -> ca.Function:
    """A step: q, v at its start, middle and end (3 n) -> q after it, again, dq/ds before it, its points."""
    n = stage.numel_in(0)
    q, given = ca.MX.sym("q", n), ca.MX.sym("v", 3 * n)
    start, middle, end = ca.vertsplit(given, n)
    first = stage(q, start)
    q2 = q + h / 2.0 * first
    second = stage(q2, middle)
    q3 = q + h / 2.0 * second
    third = stage(q3, middle)
    q4 = q + h * third
    after = q + h / 6.0 * (first + 2.0 * second + 2.0 * third + stage(q4, end))
    return ca.Function("step", [q, given], [after, after, first, ca.vertcat(q, q2, q3, q4)])


def _path(step: ca.Function, steps: int) -> ca.Function:
    """All steps from a start: the outputs of `step` but the state, next to each other."""
    n = step.numel_in(0)
    start, given = ca.MX.sym("start", n), ca.MX.sym("given", 3 * n * steps)
    outputs = step.mapaccum(steps)(start, ca.reshape(given, -1, steps))[1:]
    return ca.Function(f"path_{steps}", [start, given], list(outputs))


def _transfer(n: int, h: float) -> ca.Function:
    """Derivatives of a step, from those of the slopes at its four points (4 n n each, by rows).

    See `FlowFunctions.transfer`.
    """
    by_angle, by_velocity = ca.SX.sym("by_angle", 4 * n * n), ca.SX.sym("by_velocity", 4 * n * n)
    slope1, slope2, slope3, slope4 = [ca.reshape(x, n, n).T for x in ca.vertsplit(by_angle, n * n)]
    by_v1, by_v2, by_v3, by_v4 = [ca.reshape(x, n, n).T for x in ca.vertsplit(by_velocity, n * n)]
    # Each slope's derivative by q before the step, and by v at its start and in its middle.
    by_q2, start2 = slope2 + h / 2.0 * (slope2 @ slope1), h / 2.0 * (slope2 @ by_v1)
    by_q3, start3 = slope3 + h / 2.0 * (slope3 @ by_q2), h / 2.0 * (slope3 @ start2)
    middle3 = by_v3 + h / 2.0 * (slope3 @ by_v2)
    by_q4, start4, middle4 = slope4 + h * (slope4 @ by_q3), h * (slope4 @ start3), h * (slope4 @ middle3)
    outputs = [
        ca.SX.eye(n) + h / 6.0 * (slope1 + 2.0 * by_q2 + 2.0 * by_q3 + by_q4),
        h / 6.0 * (by_v1 + 2.0 * start2 + 2.0 * start3 + start4),
        h / 6.0 * (2.0 * by_v2 + 2.0 * middle3 + middle4),
        h / 6.0 * by_v4,
        slope1,
        by_v1,
    ]
    return ca.Function("transfer", [by_angle, by_velocity], ca.cse([ca.densify(x).T for x in outputs]))
