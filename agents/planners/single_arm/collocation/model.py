"""What the transcription of a single arm's motion is made of: compiled functions with first and second
derivatives.

Total momentum is zero and the frame is inertial, at the base frame of t = 0. Linear momentum puts the
system's common centre of mass at rest, so where the base is follows from the joint angles and from its
attitude; what has to be integrated is the attitude. It is written as a Gibbs vector r = tan(angle / 2) axis,
in which compositions are rational; it ends at half a turn, far beyond what an arm does to its base.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from agents.planners.common.smooth import Smooth, smooth_parts
from space_envs.codegen.functions import compiled
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.errors import ConfigurationError

GAUSS = 3  # points on an interval, at which twists are evaluated
ORDER = 4  # cubic B-splines that live on an interval
SHORT = 1e-6  # m; a shorter link is a point that its neighbours cover


@dataclass(frozen=True, eq=False)
class SingleArm:
    """The functions of one robot with n joints.

    Attributes:
        interval: one interval of the mesh, in the scaled time s = t / T, of its four spline coefficients
            (n, 4) and the attitudes r at its ends (3), (3), with parameters values and slopes (4, GAUSS) of
            the splines at the Gauss points, length h and c^2 of eq. 20. Outputs: integral of eq. 20 (1) and
            the defect (3) of the attitude. The derivatives are by the 4 n + 6 variables in that order.
        ending: of q (n) and r (3) with parameters com (3), the system's centre of mass, and goal (3, 3), the
            end-effector's axes at the goal: place (3) m of the end-effector and its rotation (3), sines.
        spheres: of q (n) and r (3) with parameters com (3) and centre (3): squared distances of a ball's
            centre from the segments of the links that have a length, m^2.
        links: number of these.
        com: q -> the system's centre of mass (3) in the base frame.
    """

    interval: Smooth
    ending: Smooth
    spheres: Smooth
    links: int
    com: ca.Function

    @classmethod
    def of(cls, robot: FloatingRobot) -> "SingleArm":
        """The functions of a robot, made at first use and kept.

        Warns:
            NoCompiledCodeWarning: if they have to run in CasADi's virtual machine, twenty times slower.

        Raises:
            ConfigurationError: if the robot is no single arm.
        """
        return _build(robot)


class Torque:
    """Joint torques at zero momentum: q, q', q'' -> value (n) N m, and slope (n, 3 n) by all of them.

    There is no second derivative: it has ten times the code of all else, and little to say.
    """

    def __init__(self, robot: FloatingRobot) -> None:
        q, qdot, qddot = (ca.SX.sym(name, robot.n_joints) for name in ("q", "qdot", "qddot"))
        torque = SymbolicRobot(robot).inverse_dynamics(q, qdot, qddot)
        state = [q, qdot, qddot]
        slope = ca.densify(ca.jacobian(torque, ca.vertcat(*state)))
        ready = compiled(
            {
                "torque_value": ca.Function("torque_value", state, [torque]),
                "torque_slope": ca.Function("torque_slope", state, [ca.cse(slope)]),
            }
        )
        self.value, self.slope = ready["torque_value"], ready["torque_slope"]


def rotated(r: ca.SX, x: ca.SX, back: bool = False) -> ca.SX:
    """A vector turned by the Gibbs vector r, from base to inertial axes; or back."""
    axis = -r if back else r
    turned = ca.cross(axis, x)
    return x + 2.0 / (1.0 + ca.dot(r, r)) * (turned + ca.cross(axis, turned))


@built_once
def _build(robot: FloatingRobot) -> SingleArm:
    if len(robot.tip_link) != 1:
        raise ConfigurationError("optimal control of the single arm needs a robot with one end-effector")
    symbolic, n = SymbolicRobot(robot), robot.n_joints
    q, qdot, qddot = (ca.SX.sym(name, n) for name in ("q", "qdot", "qddot"))
    r, com, centre = (ca.SX.sym(name, 3) for name in ("r", "com", "centre"))
    goal = ca.SX.sym("goal", 3, 3)
    _, places, _, coms = symbolic.kinematics(q)
    masses = ca.DM(robot.mass[1:])
    middle = (coms @ masses + float(robot.mass[0]) * ca.DM(robot.com[0])) / float(robot.mass.sum())
    tip, axes = symbolic.end_effector_pose()(q)

    place = com + rotated(r, tip - middle)
    turned = ca.horzcat(*[rotated(r, axes[:, i]) for i in range(3)])
    off = goal.T @ turned
    ending = ca.vertcat(place, ca.inv_skew(0.5 * (off - off.T)))

    ends = ca.horzcat(places, tip)
    at_home = np.asarray(ca.Function("ends", [q], [ends])(robot.home))
    long = np.linalg.norm(np.diff(at_home, axis=1), axis=0) > SHORT
    ball = rotated(r, centre - com, back=True) + middle
    squares = []
    for link in np.flatnonzero(long).tolist():
        begin, along = ends[:, link], ends[:, link + 1] - ends[:, link]
        to_ball = ball - begin
        share = ca.fmin(ca.fmax(ca.dot(to_ball, along) / ca.dot(along, along), 0.0), 1.0)
        away = to_ball - share * along
        squares.append(ca.dot(away, away))

    ready = compiled(
        {
            **_interval(symbolic.base_twist(q, qdot), q, qdot),
            **smooth_parts("ending", ending, [q, r], [com, goal]),
            **smooth_parts("spheres", ca.vertcat(*squares), [q, r], [com, centre]),
            "com": ca.Function("com", [q], [ca.densify(middle)]),
        }
    )

    return SingleArm(
        interval=Smooth.named(ready, "interval"),
        ending=Smooth.named(ready, "ending"),
        spheres=Smooth.named(ready, "spheres"),
        links=len(squares),
        com=ready["com"],
    )


def _interval(twist: ca.SX, q: ca.SX, qdot: ca.SX) -> dict[str, ca.Function]:
    """The three functions of `SingleArm.interval` by the chain rule through the Gauss points' twists."""
    n = q.numel()
    at = smooth_parts("twist", twist, [q, qdot], [])
    outer, outer_bend = _outer()
    combine = _combine(n)
    coefficients = ca.MX.sym("c", n, ORDER)
    r0, r1 = ca.MX.sym("r0", 3), ca.MX.sym("r1", 3)
    values, slopes = ca.MX.sym("values", ORDER, GAUSS), ca.MX.sym("slopes", ORDER, GAUSS)
    h, c2, weight = ca.MX.sym("h"), ca.MX.sym("c2"), ca.MX.sym("weight", 4)
    inputs = [coefficients, r0, r1, values, slopes, h, c2]
    points = list(
        zip(
            ca.horzsplit(coefficients @ values),
            ca.horzsplit(coefficients @ slopes),
            ca.horzsplit(values),
            ca.horzsplit(slopes),
            strict=True,
        )
    )
    twists = ca.vertcat(*[at["twist_value"](x, rate) for x, rate, _, _ in points])
    result, outer_slope = outer(twists, r0, r1, h, c2)
    rows = []
    for x, rate, value, slope in points:
        by_q, by_rate = ca.horzsplit(at["twist_slope"](x, rate), n)
        rows.append(ca.horzcat(*[value[a] * by_q + slope[a] * by_rate for a in range(ORDER)]))
    across = ca.vertcat(*rows)
    curve, force = outer_bend(twists, r0, r1, h, c2, weight)
    bend = _squared(n, curve.sparsity())(across, curve)
    total = ca.MX(ORDER * n, ORDER * n)
    for k, (x, rate, value, slope) in enumerate(points):
        total += combine(at["twist_bend"](x, rate, force[6 * k : 6 * k + 6]), value, slope)
    bend += ca.diagcat(total, ca.MX(6, 6))
    inner_slope = ca.horzcat(outer_slope[:, : 6 * GAUSS] @ across, outer_slope[:, 6 * GAUSS :])
    return {
        "interval_value": ca.Function("interval_value", inputs, [ca.densify(result)]),
        "interval_slope": ca.Function("interval_slope", inputs, [ca.densify(inner_slope)]),
        "interval_bend": ca.Function("interval_bend", [*inputs, weight], [ca.densify(bend)]),
    }


def _outer() -> tuple[ca.Function, ca.Function]:
    """From the twists (6 GAUSS) and the attitudes at both ends to cost (1) and defect (3), with derivatives.

    The turn over the interval is the exponential of the integral of the angular velocity with its first
    commutator (Magnus): of fourth order.
    """
    parts = [ca.SX.sym("twists", 6 * GAUSS), ca.SX.sym("r0", 3), ca.SX.sym("r1", 3)]
    z = ca.vertcat(*parts)
    h, c2, weight = ca.SX.sym("h"), ca.SX.sym("c2"), ca.SX.sym("weight", 4)
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS)
    cost, turn = ca.SX(0.0), ca.SX(3, 1)
    for k, share in enumerate(weights):
        v, w = z[6 * k : 6 * k + 3], z[6 * k + 3 : 6 * k + 6]
        cost += 0.5 * h * share * (ca.dot(v, v) + c2 * ca.dot(w, w))
        turn += 0.5 * h * share * w
    first, last = z[3:6], z[6 * GAUSS - 3 : 6 * GAUSS]
    turn += h * h / (6.0 * (nodes[-1] - nodes[0])) * ca.cross(first, last)
    square = ca.dot(turn, turn)
    gibbs = 0.5 * turn * (1.0 + square / 12.0 + square * square / 120.0)  # of the tangent of half the angle
    _, r0, r1 = parts
    defect = r1 * (1.0 - ca.dot(r0, gibbs)) - (r0 + gibbs + ca.cross(r0, gibbs))
    result = ca.vertcat(cost, defect)
    curve, force = ca.hessian(ca.dot(weight, result), z)
    inputs = [*parts, h, c2]
    slope = ca.densify(ca.jacobian(result, z))
    return (
        ca.Function("outer", inputs, [result, slope]),
        ca.Function("outer_bend", [*inputs, weight], [curve, ca.densify(force)]),
    )


def _squared(n: int, pattern: ca.Sparsity) -> ca.Function:
    """The twists' derivatives (6 GAUSS, 4 n) and the outer second derivative -> what they make (4 n + 6)^2.

    Written out, since most of the outer derivative is zero.
    """
    across, curve = ca.SX.sym("across", 6 * GAUSS, ORDER * n), ca.SX.sym("curve", pattern)
    slope = ca.diagcat(across, ca.SX.eye(6))
    half = curve @ slope
    return ca.Function("squared", [across, curve], [ca.densify(ca.triu2symm(ca.triu(slope.T @ half)))])


def _combine(n: int) -> ca.Function:
    """Second derivative (2 n, 2 n) at a point, its splines' values and slopes (4) -> by the coefficients."""
    bend, value, slope = ca.SX.sym("bend", 2 * n, 2 * n), ca.SX.sym("value", ORDER), ca.SX.sym("slope", ORDER)
    (qq, qd), (dq, dd) = ca.blocksplit(bend, n, n)
    rows = [(value[a] * qq + slope[a] * dq, value[a] * qd + slope[a] * dd) for a in range(ORDER)]
    blocks = [[left * value[b] + right * slope[b] for b in range(ORDER)] for left, right in rows]
    return ca.Function("combine", [bend, value, slope], [ca.blockcat(blocks)])
