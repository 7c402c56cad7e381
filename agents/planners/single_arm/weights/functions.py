"""Compiled functions of one robot with their derivatives, for motions in weight space.

Twists are [v; w] of the base in its own axes at zero momentum. Time runs over K intervals of equal length h
with two Gauss points each; over an interval the base moves by the exponential of
Omega = h / 2 (xi1 + xi2) + sqrt(3) / 12 h^2 [xi1, xi2], which is of fourth order (Magnus; Iserles and
Norsett 1999).
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from space_envs.codegen.functions import Batched, batched
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.tasks.goals.kinds import GoalKind


@dataclass(frozen=True, eq=False)
class ArmFunctions:
    """Functions of one robot and one number K of intervals; every input has leading batch axes.

    Attributes:
        twist: q (n), qdot (n) -> xi (6).
        slopes: q (n), qdot (n) -> xi (6), d xi / d[q; qdot] (6, 2 n).
        chain: xi (12 K) twists at the Gauss points, h (1) s -> pose (K + 1, 12) of the base at the ends of
            the intervals, [position; rotation by columns], inertial; propagation (2 K, 36): matrices
            (6, 6), by rows, from a change of a twist to the displacement [v; w] at all later times, in
            inertial axes at the inertial origin.
        ending: q (n), pose (12), goal (21) [position; rotation of the end-effector, of the base, by columns]
            -> goal error (9): position m and rotation vector rad of the end-effector from its goal, rotation
            vector of the base from its goal; slope (9, 6 + n) with respect to the displacement of the base
            and q.
        axis_ending, position_ending: the same for goals of these kinds: goal errors (8) and (6) without the
            rotation vector; the former has the approach axis's tilt from that of the goal instead, (2) rad,
            along the goal's x and y axes.
        curvature: q, qdot (n each), weight (6) -> second derivatives (n, 2 n) of weight' xi by q and by
            [q; qdot]; there are none by qdot alone, as twists are linear in the rates.
        ending_curvature: q, pose, goal, weight (9) -> second derivatives (6 + n, 6 + n) of weight' error by
            the displacement of the base and q. axis_ending_curvature, position_ending_curvature: the same
            with weights (8) and (6).
        torque: q, qdot, qddot (n each) -> torque (n) N m.
        torque_slope: q, qdot, qddot, weight (n) -> derivative (3 n) of weight' torque.
    """

    twist: Batched
    slopes: Batched
    chain: Batched
    ending: Batched
    axis_ending: Batched
    position_ending: Batched
    curvature: Batched
    ending_curvature: Batched
    axis_ending_curvature: Batched
    position_ending_curvature: Batched
    torque: Batched
    torque_slope: Batched

    @classmethod
    def of(cls, robot: FloatingRobot, intervals: int) -> "ArmFunctions":
        """Return the functions of a robot, built at the first use and kept.

        Warns:
            NoCompiledCodeWarning: if they are interpreted, up to twenty times slower.
        """
        return _build(robot, intervals)

    def ending_of(self, kind: GoalKind) -> Batched:
        """Goal error at the end for goals of a kind, as `ending`."""
        return {"pose": self.ending, "axis": self.axis_ending, "position": self.position_ending}[kind]

    def ending_curvature_of(self, kind: GoalKind) -> Batched:
        """Second derivatives of weighted goal errors for goals of a kind, as `ending_curvature`."""
        found = self.ending_curvature, self.axis_ending_curvature, self.position_ending_curvature
        return dict(zip(("pose", "axis", "position"), found, strict=True))[kind]


@built_once
def _build(robot: FloatingRobot, intervals: int) -> ArmFunctions:
    symbolic, n = SymbolicRobot(robot), robot.n_joints
    q, qdot, qddot, weight = (ca.SX.sym(name, n) for name in ("q", "qdot", "qddot", "weight"))
    wrench = ca.SX.sym("wrench", 6)
    twist = symbolic.base_twist(q, qdot)
    slope = ca.densify(ca.jacobian(twist, ca.vertcat(q, qdot)))
    bend = ca.densify(ca.jacobian(ca.gradient(ca.dot(wrench, twist), q), ca.vertcat(q, qdot)))
    torque = symbolic.inverse_dynamics(q, qdot, qddot)
    torque_gradient = ca.gradient(ca.dot(weight, torque), ca.vertcat(q, qdot, qddot))
    many = {
        "twist": ca.Function("twist", [q, qdot], [twist]),
        "slopes": ca.Function("slopes", [q, qdot], ca.cse([twist, slope.T])),
        "curvature": ca.Function("curvature", [q, qdot, wrench], ca.cse([bend.T])),
        "torque": ca.Function("torque", [q, qdot, qddot], [torque]),
        "torque_slope": ca.Function(
            "torque_slope", [q, qdot, qddot, weight], ca.cse([ca.densify(torque_gradient)])
        ),
    }
    kinds: tuple[tuple[GoalKind, str], ...] = (("pose", ""), ("axis", "axis_"), ("position", "position_"))
    few = {"chain": _chain(intervals)}
    for kind, prefix in kinds:
        few[f"{prefix}ending"] = _ending(symbolic, kind)
        few[f"{prefix}ending_curvature"] = _ending_curvature(symbolic, kind)
    return ArmFunctions(**batched(many, vectorise=True), **batched(few))


def _chain(intervals: int) -> ca.Function:
    """Base poses from the twists at the Gauss points, and the propagation of changes."""
    xi, h = ca.SX.sym("xi", 12 * intervals), ca.SX.sym("h")
    factor = np.sqrt(3.0) / 12.0 * h * h
    position, rotation = ca.SX(3, 1), ca.SX.eye(3)
    poses, propagations = [ca.vertcat(position, ca.vec(rotation))], []
    for k in range(intervals):
        first, second = xi[12 * k : 12 * k + 6], xi[12 * k + 6 : 12 * k + 12]
        omega = 0.5 * h * (first + second) + factor * (_bracket(first) @ second)
        bracket = _bracket(omega)
        displacement, rotated = _exponential(omega)
        # Left-trivialised derivative of the exponential; Omega is small: the next term is below 1e-8.
        derivative = (
            ca.SX.eye(6) + bracket / 2.0 + bracket @ bracket / 6.0 + bracket @ bracket @ bracket / 24.0
        )
        carried = ca.blockcat([[rotation, ca.skew(position) @ rotation], [ca.SX(3, 3), rotation]])
        moved = carried @ derivative
        for side in (
            0.5 * h * ca.SX.eye(6) - factor * _bracket(second),
            0.5 * h * ca.SX.eye(6) + factor * _bracket(first),
        ):
            propagations.append(ca.vec((moved @ side).T))
        position, rotation = position + rotation @ displacement, rotation @ rotated
        poses.append(ca.vertcat(position, ca.vec(rotation)))
    outputs = [ca.SX(ca.densify(ca.horzcat(*columns))) for columns in (poses, propagations)]
    return ca.Function("chain", [xi, h], ca.cse(outputs))


def _ending(symbolic: SymbolicRobot, kind: GoalKind) -> ca.Function:
    """Goal error at the end for goals of a kind, and its derivative."""
    n = symbolic.robot.n_joints
    q, pose, goal = ca.SX.sym("q", n), ca.SX.sym("pose", 12), ca.SX.sym("goal", 21)
    change = ca.SX.sym("change", 6)  # of the base: displacement in inertial axes at the inertial origin
    base_position, base = pose[:3], ca.reshape(pose[3:], 3, 3)
    local, rotation = symbolic.end_effector_pose(0)(q)
    end_effector = base_position + base @ local
    end_effector = end_effector + change[:3] + ca.cross(change[3:], end_effector)
    goal_axes = ca.reshape(goal[3:12], 3, 3)
    attitude_error = _logarithm(base @ ca.reshape(goal[12:], 3, 3).T)
    position = end_effector - goal[:3]
    # Angular rates in inertial axes: of the base, and of the end-effector by its joints.
    spins = [
        ca.inv_skew(ca.reshape(ca.jacobian(ca.vec(rotation), q[j]), 3, 3) @ rotation.T) for j in range(n)
    ]
    angular = ca.horzcat(ca.SX(3, 3), ca.SX.eye(3), base @ ca.horzcat(*spins))  # of the end-effector
    if kind == "pose":
        rotation_error = _logarithm(base @ rotation @ goal_axes.T)
        rotation_slope = _inverse_derivative(rotation_error) @ angular
    elif kind == "axis":
        axis = base @ rotation[:, 2]
        rotation_error, by_axis = _tilt(axis, goal_axes)
        rotation_slope = by_axis @ -ca.skew(axis) @ angular
    else:
        rotation_error, rotation_slope = ca.SX(0, 1), ca.SX(0, 6 + n)
    slope = ca.vertcat(
        ca.jacobian(position, ca.vertcat(change, q)),
        rotation_slope,
        _inverse_derivative(attitude_error) @ ca.horzcat(ca.SX(3, 3), ca.SX.eye(3), ca.SX(3, n)),
    )
    outputs = [ca.vertcat(position, rotation_error, attitude_error), ca.densify(slope).T]
    outputs = [ca.substitute(output, change, ca.DM.zeros(6)) for output in outputs]
    name = "ending" if kind == "pose" else f"{kind}_ending"
    return ca.Function(name, [q, pose, goal], ca.cse(outputs))


def _tilt(axis: ca.SX, goal_axes: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Angle (2,), rad, of an axis from a goal's z axis, along its x and y axes; derivative (2, 3) by axis."""
    unit = ca.SX.sym("unit", 3)
    sines, cosine = goal_axes[:, :2].T @ unit, ca.dot(goal_axes[:, 2], unit)
    square = ca.dot(sines, sines)
    sine = ca.sqrt(square + 1e-24)
    small = ca.logic_and(square < 1e-8, cosine > 0.0)
    tilt = sines * ca.if_else(small, 1.0 + square / 6.0, ca.atan2(sine, cosine) / sine)
    found = [tilt, ca.jacobian(tilt, unit)]
    value, slope = (ca.substitute(each, unit, axis) for each in found)
    return value, slope


def _ending_curvature(symbolic: SymbolicRobot, kind: GoalKind) -> ca.Function:
    """Second derivatives of a weighted goal error at the end for goals of a kind."""
    n = symbolic.robot.n_joints
    q, pose, goal = ca.SX.sym("q", n), ca.SX.sym("pose", 12), ca.SX.sym("goal", 21)
    change, base, goal_axes = ca.SX.sym("change", 6), ca.reshape(pose[3:], 3, 3), ca.reshape(goal[3:12], 3, 3)
    local, rotation = symbolic.end_effector_pose(0)(q)
    # Exponential of the displacement, to second order.
    around = ca.skew(change[3:])
    turn = ca.SX.eye(3) + around + 0.5 * around @ around
    position = turn @ (pose[:3] + base @ local) + change[:3] + 0.5 * around @ change[:3]
    turned = {
        "pose": lambda: _logarithm(turn @ base @ rotation @ goal_axes.T),
        "axis": lambda: _tilt(turn @ base @ rotation[:, 2], goal_axes)[0],
        "position": lambda: ca.SX(0, 1),
    }[kind]()
    attitude = _logarithm(turn @ base @ ca.reshape(goal[12:], 3, 3).T)
    error = ca.vertcat(position - goal[:3], turned, attitude)
    weight, variables = ca.SX.sym("weight", error.numel()), ca.vertcat(change, q)
    second = ca.jacobian(ca.gradient(ca.dot(weight, error), variables), variables)
    output = ca.substitute(ca.densify(second), change, ca.DM.zeros(6))
    name = "ending_curvature" if kind == "pose" else f"{kind}_ending_curvature"
    return ca.Function(name, [q, pose, goal, weight], ca.cse([output]))


def _bracket(twist: ca.SX) -> ca.SX:
    """Matrix (6, 6) of the commutator with a twist [v; w]."""
    linear, angular = ca.skew(twist[:3]), ca.skew(twist[3:])
    return ca.blockcat([[angular, linear], [ca.SX(3, 3), angular]])


def _exponential(omega: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Position and rotation of the exponential of [v; w]."""
    linear, around = omega[:3], ca.skew(omega[3:])
    square = ca.dot(omega[3:], omega[3:]) + 1e-24
    angle = ca.sqrt(square)
    # sin(x) / x, (1 - cos(x)) / x^2 and (x - sin(x)) / x^3, the latter two by series near 0.
    small = square < 1e-4
    first = ca.if_else(small, 1.0 - square / 6.0 + square**2 / 120.0, ca.sin(angle) / angle)
    second = ca.if_else(small, 0.5 - square / 24.0 + square**2 / 720.0, (1.0 - ca.cos(angle)) / square)
    third = ca.if_else(small, 1 / 6 - square / 120.0 + square**2 / 5040.0, (1.0 - first) / square)
    twice = around @ around
    position = linear + second * (around @ linear) + third * (twice @ linear)
    return position, ca.SX.eye(3) + first * around + second * twice


def _logarithm(rotation: ca.SX) -> ca.SX:
    """Rotation vector (3,) of a rotation matrix; of good accuracy up to 3.1 rad."""
    axial = 0.5 * ca.vertcat(
        rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]
    )
    square = ca.dot(axial, axial)
    sine = ca.sqrt(square + 1e-24)
    angle = ca.atan2(sine, 0.5 * (ca.trace(rotation) - 1.0))
    factor = ca.if_else(
        ca.logic_and(square < 1e-8, ca.trace(rotation) > 0.0), 1.0 + square / 6.0, angle / sine
    )
    return factor * axial


def _inverse_derivative(vector: ca.SX) -> ca.SX:
    """Matrix from an angular displacement, added from the left, to the change of a rotation vector."""
    square = ca.dot(vector, vector)
    angle = ca.sqrt(square + 1e-24)
    exact = (1.0 - 0.5 * angle * ca.sin(angle) / (1.0 - ca.cos(angle) + 1e-30)) / (square + 1e-24)
    factor = ca.if_else(square < 1e-4, 1 / 12 + square / 720.0, exact)
    around = ca.skew(vector)
    return ca.SX.eye(3) - 0.5 * around + factor * (around @ around)
