"""Distances of capsules and boxes: links of arms, the satellite, a target. Exact, batched, in closed form."""

import numpy as np

from space_envs.dynamics.rotations import Array

_TINY = 1e-300  # m, keeps a segment along a face from dividing by zero
_SIGNS = np.array([[1.0, 1.0], [1.0, -1.0], [-1.0, 1.0], [-1.0, -1.0]])
_PAIRS = np.array([[0, 1], [0, 2], [1, 2]])


def segment_distance(a: Array, b: Array, c: Array, d: Array) -> Array:
    """Least distance (...) of the segments from a to b and from c to d, each (..., 3), m.

    The minimum is at two inner points whose connecting line is perpendicular to both segments, or at an end
    of one of them.
    """
    ends = [point_segment(x, c, d) for x in (a, b)] + [point_segment(x, a, b) for x in (c, d)]
    least = np.minimum(np.minimum(ends[0], ends[1]), np.minimum(ends[2], ends[3]))
    u, v, w = b - a, d - c, a - c
    uu, uv, vv = (u * u).sum(-1), (u * v).sum(-1), (v * v).sum(-1)
    uw, vw = (u * w).sum(-1), (v * w).sum(-1)
    square = uu * vv - uv * uv
    skewed = square > 1e-12 * uu * vv
    safe = np.where(skewed, square, 1.0)
    s, t = (uv * vw - vv * uw) / safe, (uu * vw - uv * uw) / safe
    inside = skewed & (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    gap = w + s[..., None] * u - t[..., None] * v
    return np.where(inside, np.sqrt((gap * gap).sum(-1)), least)


def point_segment(point: Array, a: Array, b: Array) -> Array:
    """Distance (...) of a point from the segment from a to b, each (..., 3), m."""
    along = b - a
    share = ((point - a) * along).sum(-1) / np.maximum((along * along).sum(-1), 1e-300)
    gap = point - a - np.clip(share, 0.0, 1.0)[..., None] * along
    return np.sqrt((gap * gap).sum(-1))


def box_distance(a: Array, b: Array, half: Array) -> Array:
    """Signed distance (...) of the segment from a to b, each (..., 3), from a box, in the box's frame, m.

    Negative where the segment enters the box: minus the depth of its deepest point.

    Args:
        half: (3,) or (..., 3), half sides of the box, m.
    """
    a, b, half = np.broadcast_arrays(a, b, half)
    distance = np.atleast_1d(_outside(a, b, half))
    within = distance == 0.0
    if within.any():
        inside = (np.atleast_2d(value)[within] for value in (a, b, half))
        distance[within] = _depth(*inside)
    return distance.reshape(a.shape[:-1])


def _outside(a: Array, b: Array, half: Array) -> Array:
    """Distance (...) of the segment from the box, 0 where they meet.

    The derivative of half the squared distance along the segment never decreases, and is linear between the
    points where the segment's line crosses the planes of the faces.
    """
    along = b - a
    safe = np.where(np.abs(along) > _TINY, along, _TINY)
    with np.errstate(over="ignore"):
        share = np.concatenate([(half - a) / safe, (-half - a) / safe], axis=-1)
    share = np.clip(share, 0.0, 1.0)
    share = np.concatenate([share, np.zeros_like(share[..., :1]), np.ones_like(share[..., :1])], axis=-1)
    point = a[..., None, :] + share[..., None] * along[..., None, :]
    beyond = np.maximum(np.abs(point) - half[..., None, :], 0.0) * np.sign(point)
    slope = (beyond * along[..., None, :]).sum(axis=-1)
    falls, rises = slope <= 0.0, slope >= 0.0
    low, high = np.where(falls, share, 0.0).max(axis=-1), np.where(rises, share, 1.0).min(axis=-1)
    before, after = np.where(falls, slope, -np.inf).max(axis=-1), np.where(rises, slope, np.inf).min(axis=-1)
    crosses = (before < 0.0) & np.isfinite(before) & np.isfinite(after) & (after > before)
    rise = np.where(crosses, after - before, 1.0)
    at = low + np.where(crosses, (high - low) * np.where(crosses, -before, 0.0) / rise, 0.0)
    outside = np.maximum(np.abs(a + at[..., None] * along) - half, 0.0)
    return np.sqrt((outside * outside).sum(axis=-1))


def _depth(a: Array, b: Array, half: Array) -> Array:
    """The least (K,) of max_i |p_i| - half_i over segments (K, 3) that meet the box, m.

    It is at an end, where a coordinate vanishes, or where two of the six linear functions are equal.
    """
    along = b - a
    first, second = _PAIRS.T
    s, t = _SIGNS[:, :1], _SIGNS[:, 1:]  # (4, 1), against pairs (3,)
    rate = s * along[:, None, first] - t * along[:, None, second]
    missing = half[:, None, first] - half[:, None, second] - s * a[:, None, first] + t * a[:, None, second]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        share = np.concatenate([(missing / rate).reshape(len(a), 12), -a / along], axis=1)
    share = np.concatenate(
        [np.clip(np.nan_to_num(share), 0.0, 1.0), np.tile([0.0, 1.0], (len(a), 1))], axis=1
    )
    point = a[:, None] + share[..., None] * along[:, None]
    return (np.abs(point) - half[:, None]).max(axis=-1).min(axis=-1)
