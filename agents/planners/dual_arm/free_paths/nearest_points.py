"""Nearest points of segments and boxes as CasADi expressions."""

import casadi as ca

_BISECTIONS = 12  # of a link's length, for its point nearest to a box
SOFT = 1e-6  # m, keeps distances differentiable where they vanish
FAR = 1e3  # m, distance of bodies that are ignored


def _clamp(value: ca.SX) -> ca.SX:
    return ca.fmin(ca.fmax(value, 0.0), 1.0)


def nearest(a: ca.SX, b: ca.SX, c: ca.SX, d: ca.SX) -> ca.SX:
    """Phases of the nearest points of the segments from a to b and from c to d, then 1 and 0."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = (ca.dot(x, y) for x, y in ((u, u), (u, v), (v, v), (u, w), (v, w)))
    s = _clamp((uv * vw - uw * vv) / ca.fmax(uu * vv - uv * uv, 1e-12))
    t = _clamp((uv * s + vw) / vv)
    return ca.vertcat(_clamp((uv * t - uw) / uu), t, 1.0, 0.0)


def crossing(a: ca.SX, b: ca.SX, c: ca.SX, d: ca.SX) -> list[ca.SX]:
    """Phases of each end of two planar segments and the nearest point of the other segment, with factor and
    summand of their distance.

    Where the segments cross, the pair that is separated by the smallest displacement has a negative distance,
    and the others are put far away.
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
            ca.if_else(ca.logic_and(crossed, square > least), FAR, 0.0),
        )
        for (one, other), square in zip(shares, squares, strict=True)
    ]


def box_distance(point: ca.SX, half: ca.SX) -> ca.SX:
    """Signed distance of a point from a box, m."""
    beyond = ca.fabs(point) - half
    outside = ca.fmax(beyond, 0.0)
    within = ca.fmin(ca.fmax(ca.fmax(beyond[0], beyond[1]), beyond[2]), 0.0)
    return ca.sqrt(ca.dot(outside, outside) + SOFT**2) + within


def nearest_to_box(a: ca.SX, b: ca.SX, half: ca.SX) -> ca.SX:
    """Phase of the point of the segment from a to b that is nearest to a box or deepest in it."""
    along = b - a
    low, high = ca.SX(0.0), ca.SX(1.0)
    for _ in range(_BISECTIONS):
        share = 0.5 * (low + high)
        point = a + share * along
        beyond = ca.fabs(point) - half
        outside = ca.fmax(beyond, 0.0)
        most = ca.fmax(ca.fmax(beyond[0], beyond[1]), beyond[2])
        weight = ca.if_else(most > 0.0, outside, beyond >= most)
        rising = ca.dot(weight * ca.sign(point), along) > 0.0
        low, high = ca.if_else(rising, low, share), ca.if_else(rising, share, high)
    return 0.5 * (low + high)
