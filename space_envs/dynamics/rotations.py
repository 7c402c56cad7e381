"""Batched rotations. Quaternions are (w, x, y, z), unit, active, body to inertial; vectors are (..., 3)."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.floating]


def multiply(a: Array, b: Array) -> Array:
    """Product of quaternions (..., 4): first b, then a."""
    aw, ax, ay, az = a[..., 0], a[..., 1], a[..., 2], a[..., 3]
    bw, bx, by, bz = b[..., 0], b[..., 1], b[..., 2], b[..., 3]
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = aw * bw - ax * bx - ay * by - az * bz
    out[..., 1] = aw * bx + ax * bw + ay * bz - az * by
    out[..., 2] = aw * by - ax * bz + ay * bw + az * bx
    out[..., 3] = aw * bz + ax * by - ay * bx + az * bw
    return out


def conjugate(q: Array) -> Array:
    """Inverse of unit quaternions (..., 4)."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def cross(a: Array, b: Array) -> Array:
    """Cross product over the last axis (..., 3); np.cross is several times slower on small batches."""
    out = np.empty(np.broadcast_shapes(a.shape, b.shape))
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def rotate(q: Array, v: Array) -> Array:
    """Vectors (..., 3) rotated by quaternions (..., 4)."""
    t = 2.0 * cross(q[..., 1:], v)
    return v + q[..., :1] * t + cross(q[..., 1:], t)


def canonical(q: Array) -> Array:
    """The representative of each quaternion (..., 4) with w >= 0."""
    return np.where(q[..., :1] < 0.0, -q, q)


def exponential(rotation_vector: Array) -> Array:
    """Quaternions (..., 4) of rotation vectors (..., 3), rad."""
    half = 0.5 * np.sqrt(np.sum(rotation_vector * rotation_vector, axis=-1, keepdims=True))
    # np.sinc(x / pi) = sin(x) / x, with the limit at zero.
    return np.concatenate([np.cos(half), 0.5 * np.sinc(half / np.pi) * rotation_vector], axis=-1)


def logarithm(q: Array) -> Array:
    """Rotation vectors (..., 3), rad, of norm at most pi, of unit quaternions (..., 4)."""
    q = canonical(q)
    sine = np.sqrt(np.sum(q[..., 1:] * q[..., 1:], axis=-1, keepdims=True))
    angle = 2.0 * np.arctan2(sine, q[..., :1])
    return q[..., 1:] * np.divide(angle, sine, out=np.full_like(sine, 2.0), where=sine > 1e-12)


def rotation_angle(q: Array) -> Array:
    """Angle (...,) of unit quaternions (..., 4), rad, in [0, pi]."""
    vector = q[..., 1:]
    return 2.0 * np.arctan2(np.sqrt((vector * vector).sum(axis=-1)), np.abs(q[..., 0]))


def base_rotation(attitude: Array) -> Array:
    """Angle (...,) of the satellite from its initial attitude, rad.

    Args:
        attitude: unit quaternions (..., 4), body to inertial, or in the plane angles (..., 1) rad.
    """
    return np.abs(attitude[..., 0]) if attitude.shape[-1] == 1 else rotation_angle(attitude)


def angle_between(a: Array, b: Array) -> Array:
    """Angle (...,) of the rotation that takes a to b, rad, in [0, pi]."""
    return rotation_angle(multiply(conjugate(a), b))


def to_matrix(q: Array) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    out = np.empty((*q.shape[:-1], 3, 3))
    out[..., 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    out[..., 0, 1] = 2.0 * (x * y - w * z)
    out[..., 0, 2] = 2.0 * (x * z + w * y)
    out[..., 1, 0] = 2.0 * (x * y + w * z)
    out[..., 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    out[..., 1, 2] = 2.0 * (y * z - w * x)
    out[..., 2, 0] = 2.0 * (x * z - w * y)
    out[..., 2, 1] = 2.0 * (y * z + w * x)
    out[..., 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    return out


def z_axis(q: Array) -> Array:
    """Third columns (..., 3) of the rotation matrices of unit quaternions (..., 4)."""
    w, x, y, z = q[..., 0], q[..., 1], q[..., 2], q[..., 3]
    out = np.empty((*q.shape[:-1], 3))
    out[..., 0] = 2.0 * (x * z + w * y)
    out[..., 1] = 2.0 * (y * z - w * x)
    out[..., 2] = 1.0 - 2.0 * (x * x + y * y)
    return out


def from_matrix(matrix: Array) -> Array:
    """Unit quaternions (..., 4) with w >= 0 of rotation matrices (..., 3, 3).

    Of the four usual formulas the one with the largest divisor is taken, so that none is ill-conditioned.
    """
    m = np.asarray(matrix, dtype=np.float64)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    # Rows: q * 4 q_k for k = w, x, y, z.
    candidates = np.stack(
        [
            np.stack(
                [
                    1 + xx + yy + zz,
                    m[..., 2, 1] - m[..., 1, 2],
                    m[..., 0, 2] - m[..., 2, 0],
                    m[..., 1, 0] - m[..., 0, 1],
                ],
                -1,
            ),
            np.stack(
                [
                    m[..., 2, 1] - m[..., 1, 2],
                    1 + xx - yy - zz,
                    m[..., 0, 1] + m[..., 1, 0],
                    m[..., 0, 2] + m[..., 2, 0],
                ],
                -1,
            ),
            np.stack(
                [
                    m[..., 0, 2] - m[..., 2, 0],
                    m[..., 0, 1] + m[..., 1, 0],
                    1 - xx + yy - zz,
                    m[..., 1, 2] + m[..., 2, 1],
                ],
                -1,
            ),
            np.stack(
                [
                    m[..., 1, 0] - m[..., 0, 1],
                    m[..., 0, 2] + m[..., 2, 0],
                    m[..., 1, 2] + m[..., 2, 1],
                    1 - xx - yy + zz,
                ],
                -1,
            ),
        ],
        axis=-2,
    )
    norms = np.sum(candidates * candidates, axis=-1)
    best = np.argmax(norms, axis=-1)[..., None, None]
    q = np.take_along_axis(candidates, best, axis=-2)[..., 0, :]
    return canonical(q / np.sqrt(np.sum(q * q, axis=-1, keepdims=True)))
