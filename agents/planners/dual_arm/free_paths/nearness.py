"""A cost on motions that come too near to something, for the planner with free paths.

The nearest points of each pair of bodies are found first and then taken as fixed to their links: the
distance between them has the same first derivative as the least distance. The planner has the squares of what
is missing to the wanted distances as a cost; what it leaves is measured by `clearance.py`.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from agents.planners.common.smooth import Smooth
from agents.planners.dual_arm.clearance import Links, Surroundings
from space_envs.codegen.functions import compiled
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, rotate
from space_envs.dynamics.symbolic import SymbolicRobot

_BISECTIONS = 12  # of a link's length, for its point nearest to a box
_SOFT = 1e-6  # m, keeps distances differentiable where they vanish
_FAR = 1e3  # m, where bodies are that do not count
POSE = 3 + 9 + 1  # numbers at each time: centre from the system's centre of mass, rotation, counted share
# Half sides: target, satellite; wanted distances: arms, satellite, target; standing; wanted of open grippers.
SHARED = 3 + 3 + 3 + 1 + 1
EACH = POSE + SHARED + 1  # with the weight of what is missing


@dataclass(frozen=True, eq=False)
class Nearness:
    """Functions of q (n), pose (13) and shared (11), compiled.

    Attributes:
        missing: -> (P,) m, what is missing to the wanted distance of each pair, 0 where nothing is.
        slope: -> that and its derivative by q (P, n).
    """

    missing: ca.Function
    slope: ca.Function

    @classmethod
    def of(cls, robot: FloatingRobot, planar: bool) -> "Nearness":
        """Of all pairs of links of different arms, links and target and, in space, links and satellite."""
        symbolic, links, n = SymbolicRobot(robot), Links.of(robot), robot.n_joints
        q, pose, shared = ca.SX.sym("q", n), ca.SX.sym("pose", POSE), ca.SX.sym("shared", SHARED)
        rotation, position, _, places = symbolic.kinematics(q)
        centre = places @ ca.DM(robot.mass[1:]) / float(robot.mass.sum())
        begin = [position[:, int(link) - 1] for link in links.link]
        end = [
            begin[s] + rotation[:, 3 * (int(link) - 1) : 3 * int(link)] @ ca.DM(links.end[s])
            for s, link in enumerate(links.link)
        ]
        turn = ca.reshape(pose[3:12], 3, 3)
        away = pose[:3] + centre  # of the target in the base frame
        distances, wanted, found, symbols = [], [], [], []
        for one in np.flatnonzero(links.arm == 0):
            for other in np.flatnonzero(links.arm == 1):
                ways = begin[one], end[one], begin[other], end[other]
                for points in _crossing(*ways) if planar else [_nearest(*ways)]:
                    at = ca.SX.sym("at", 4)
                    gap = begin[one] + at[0] * (end[one] - begin[one])
                    gap -= begin[other] + at[1] * (end[other] - begin[other])
                    distances.append(at[2] * ca.sqrt(ca.dot(gap, gap) + _SOFT**2) + at[3])
                    wanted.append(shared[6])
                    found.append(points)
                    symbols.append(at)
        for s in range(len(links.link)):
            a, b = (turn.T @ (point - away) for point in (begin[s], end[s]))
            boxes = [(a, a + (pose[12] if links.last[s] else 1.0) * (b - a), shared[:3], shared[8])]
            if links.last[s]:  # what is open counts by its centre line
                boxes.append((a + pose[12] * (b - a), b, shared[:3], shared[10]))
            if not planar:
                counts = shared[9] <= float(links.order[s])
                boxes.append((begin[s], end[s], shared[3:6], ca.if_else(counts, shared[7], -_FAR)))
            for a, b, half, distance in boxes:
                at = ca.SX.sym("at")
                distances.append(_depth(a + at * (b - a), half))
                wanted.append(distance)
                found.append(_deepest(a, b, half))
                symbols.append(at)
        missing = ca.fmax(ca.vertcat(*wanted) - ca.vertcat(*distances), 0.0)
        at, inputs = ca.vertcat(*symbols), [q, pose, shared]
        find = ca.Function("nearest_points", inputs, list(ca.cse([ca.vertcat(*found)])))
        slope = ca.densify(ca.jacobian(missing, q))
        held = ca.Function("missing_held", [q, at, pose, shared], list(ca.cse([missing])))
        slope_held = ca.Function("slope_held", [q, at, pose, shared], list(ca.cse([missing, slope])))
        given = [ca.MX.sym("q", n), ca.MX.sym("pose", POSE), ca.MX.sym("shared", SHARED)]
        points = find(*given)
        functions = {
            "missing": ca.Function("missing", given, [held(given[0], points, *given[1:])]),
            "slope": ca.Function("missing_slope", given, list(slope_held(given[0], points, *given[1:]))),
        }
        return cls(**compiled(functions))

    def added_to(self, energy: Smooth, n: int) -> Smooth:
        """energy + weight |missing|^2, a function of q, qdot and [pose; shared; weight], with the
        Gauss-Newton approximation of the second derivative."""
        y = [ca.MX.sym("q", n), ca.MX.sym("qdot", n)]
        p, factor = ca.MX.sym("p", EACH), ca.MX.sym("factor")
        pose, shared, weight = p[:POSE], p[POSE:-1], p[-1]
        missing = self.missing(y[0], pose, shared)
        left, slope = self.slope(y[0], pose, shared)
        gradient = ca.horzcat(2.0 * weight * (left.T @ slope), ca.MX.zeros(1, n))
        bend = ca.diagcat(2.0 * weight * factor * (slope.T @ slope), ca.MX.zeros(n, n))
        return Smooth(
            ca.Function("clear_value", [*y, p], [energy.value(*y) + weight * ca.dot(missing, missing)]),
            ca.Function("clear_slope", [*y, p], [energy.slope(*y) + gradient]),
            ca.Function("clear_bend", [*y, p, factor], [energy.bend(*y, factor) + ca.densify(bend)]),
        )


def parameters(
    robot: FloatingRobot,
    around: Surroundings,
    start: Array,
    times: Array,
    duration: float,
    poses: tuple[Array, Array] | None,
    extra: float,
    weight: Array | float,
) -> Array:
    """[pose; shared; weight] (K, 25) of `Nearness.added_to` at times (K,) s of a plan.

    Args:
        poses: centre (K, 3) m and quaternion (K, 4) of the target then. extra: m, of gap beyond the margin.
        weight: (K,) or one for all.
    """
    wanted = around.margin + extra + around.radius
    p = np.zeros((len(times), EACH))
    p[:, :3], p[:, 3:12:4], p[:, 12] = _FAR, 1.0, 1.0
    target, bus = np.ones(3), np.full(3, -_FAR)
    if around.target is not None and poses is not None:
        target = around.target
        centre, quaternion = poses
        p[:, :3] = centre - robot.centre_of_mass(robot.kinematics(start))
        columns = [rotate(quaternion, np.broadcast_to(unit, (len(times), 3))) for unit in np.eye(3)]
        p[:, 3:12] = np.concatenate(columns, axis=1)
        length = np.linalg.norm(robot.end_effector_offset[:1], axis=1)
        p[:, 12] = around.counted(length, times, duration)[:, 0]
    if around.bus is not None:
        bus = around.bus
    arms = wanted + around.radius if around.arms else -_FAR
    line = wanted - around.radius
    p[:, POSE:-1] = [*target, *bus, arms, wanted, wanted, around.standing, line]
    p[:, -1] = weight
    return p


def _clamp(value: ca.SX) -> ca.SX:
    return ca.fmin(ca.fmax(value, 0.0), 1.0)


def _nearest(a: ca.SX, b: ca.SX, c: ca.SX, d: ca.SX) -> ca.SX:
    """Shares of the ways from a to b and from c to d where the segments are nearest, 1 and 0."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = (ca.dot(x, y) for x, y in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    s = _clamp((uv * vw - uw * vv) / ca.fmax(uu * vv - uv * uv, 1e-12))
    t = _clamp((uv * s + vw) / vv)
    return ca.vertcat(_clamp((uv * t - uw) / uu), t, 1.0, 0.0)


def _crossing(a: ca.SX, b: ca.SX, c: ca.SX, d: ca.SX) -> list[ca.SX]:
    """The same for each end of two segments in the plane and the nearest point of the other segment, with
    factor and summand of the distance.

    Of segments that cross, the pair that is parted with the least movement counts, its distance negative; the
    others are put far away.
    """
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = (ca.dot(x, y) for x, y in ((u, u), (u, v), (v, v), (u, w), (v, w)))

    def side(x: ca.SX, y: ca.SX, z: ca.SX) -> ca.SX:
        return (y[0] - x[0]) * (z[1] - x[1]) - (y[1] - x[1]) * (z[0] - x[0])

    crossed = ca.logic_and(side(a, b, c) * side(a, b, d) < 0.0, side(c, d, a) * side(c, d, b) < 0.0)
    shares = [(ca.SX(end), _clamp((uv * end + vw) / vv)) for end in (0.0, 1.0)]
    shares += [(_clamp((uv * end - uw) / uu), ca.SX(end)) for end in (0.0, 1.0)]
    squares = [ca.sumsqr(w + one * u - other * v) for one, other in shares]
    least = ca.mmin(ca.vertcat(*squares))
    return [
        ca.vertcat(
            one,
            other,
            ca.if_else(crossed, -1.0, 1.0),
            ca.if_else(ca.logic_and(crossed, square > least), _FAR, 0.0),
        )
        for (one, other), square in zip(shares, squares, strict=True)
    ]


def _depth(point: ca.SX, half: ca.SX) -> ca.SX:
    """Signed distance of a point from a box, m."""
    beyond = ca.fabs(point) - half
    outside = ca.fmax(beyond, 0.0)
    within = ca.fmin(ca.fmax(ca.fmax(beyond[0], beyond[1]), beyond[2]), 0.0)
    return ca.sqrt(ca.dot(outside, outside) + _SOFT**2) + within


def _deepest(a: ca.SX, b: ca.SX, half: ca.SX) -> ca.SX:
    """Share of the way from a to b where the segment is nearest to a box or deepest in it."""
    way = b - a
    low, high = ca.SX(0.0), ca.SX(1.0)
    for _ in range(_BISECTIONS):
        share = 0.5 * (low + high)
        point = a + share * way
        beyond = ca.fabs(point) - half
        outside = ca.fmax(beyond, 0.0)
        most = ca.fmax(ca.fmax(beyond[0], beyond[1]), beyond[2])
        weight = ca.if_else(most > 0.0, outside, beyond >= most)
        rising = ca.dot(weight * ca.sign(point), way) > 0.0
        low, high = ca.if_else(rising, low, share), ca.if_else(rising, share, high)
    return 0.5 * (low + high)
