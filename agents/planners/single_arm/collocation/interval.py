"""Cost and attitude defect of one interval of the collocation mesh, with derivatives by the chain rule."""

import casadi as ca
import numpy as np

from agents.planners.common.smooth import smooth_parts

GAUSS = 3  # points on an interval at which twists are evaluated
ORDER = 4  # number of cubic B-splines that are nonzero on an interval


def interval_functions(twist: ca.SX, q: ca.SX, qdot: ca.SX, explicit: bool = False) -> dict[str, ca.Function]:
    """Functions of `SingleArm.interval`, by the chain rule through the twists at the Gauss points.

    Args:
        explicit: whether the attitude at the end that follows from the one at the start is returned in place
            of the defect; the given one has no effect then.
    """
    n = q.numel()
    at = smooth_parts("twist", twist, [q, qdot], [])
    outer, outer_bend = _outer(explicit)
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


def _outer(explicit: bool) -> tuple[ca.Function, ca.Function]:
    """From the twists (6 GAUSS) and the attitudes at both ends to cost (1) and defect (3), with derivatives.

    Explicit, the attitude (3) at the end takes the place of the defect.

    The rotation over the interval is the exponential of the integral of the angular velocity with its first
    commutator (Magnus): of fourth order.
    """
    parts = [ca.SX.sym("twists", 6 * GAUSS), ca.SX.sym("r0", 3), ca.SX.sym("r1", 3)]
    z = ca.vertcat(*parts)
    h, c2, weight = ca.SX.sym("h"), ca.SX.sym("c2"), ca.SX.sym("weight", 4)
    nodes, weights = np.polynomial.legendre.leggauss(GAUSS)
    cost, rotation = ca.SX(0.0), ca.SX(3, 1)
    for k, share in enumerate(weights):
        v, w = z[6 * k : 6 * k + 3], z[6 * k + 3 : 6 * k + 6]
        cost += 0.5 * h * share * (ca.dot(v, v) + c2 * ca.dot(w, w))
        rotation += 0.5 * h * share * w
    first, last = z[3:6], z[6 * GAUSS - 3 : 6 * GAUSS]
    rotation += h * h / (6.0 * (nodes[-1] - nodes[0])) * ca.cross(first, last)
    square = ca.dot(rotation, rotation)
    gibbs = 0.5 * rotation * (1.0 + square / 12.0 + square * square / 120.0)  # tangent of half the angle
    _, r0, r1 = parts
    rotated, divisor = r0 + gibbs + ca.cross(r0, gibbs), 1.0 - ca.dot(r0, gibbs)
    result = ca.vertcat(cost, rotated / divisor if explicit else r1 * divisor - rotated)
    curve, force = ca.hessian(ca.dot(weight, result), z)
    inputs = [*parts, h, c2]
    slope = ca.densify(ca.jacobian(result, z))
    return (
        ca.Function("outer", inputs, [result, slope]),
        ca.Function("outer_bend", [*inputs, weight], [curve, ca.densify(force)]),
    )


def _squared(n: int, pattern: ca.Sparsity) -> ca.Function:
    """(Derivatives of the twists (6 GAUSS, 4 n), outer second derivative) -> their product (4 n + 6)^2.

    It is expanded, since most of the outer derivative is zero.
    """
    across, curve = ca.SX.sym("across", 6 * GAUSS, ORDER * n), ca.SX.sym("curve", pattern)
    slope = ca.diagcat(across, ca.SX.eye(6))
    half = curve @ slope
    return ca.Function("squared", [across, curve], [ca.densify(ca.triu2symm(ca.triu(slope.T @ half)))])


def _combine(n: int) -> ca.Function:
    """(Second derivative (2 n, 2 n) at a point, splines' values and slopes (4)) -> that by coefficients."""
    bend, value, slope = ca.SX.sym("bend", 2 * n, 2 * n), ca.SX.sym("value", ORDER), ca.SX.sym("slope", ORDER)
    (qq, qd), (dq, dd) = ca.blocksplit(bend, n, n)
    rows = [(value[a] * qq + slope[a] * dq, value[a] * qd + slope[a] * dd) for a in range(ORDER)]
    blocks = [[left * value[b] + right * slope[b] for b in range(ORDER)] for left, right in rows]
    return ca.Function("combine", [bend, value, slope], [ca.blockcat(blocks)])
