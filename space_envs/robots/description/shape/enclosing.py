"""The capsule of small volume around the hull of spheres."""

from typing import NamedTuple

import numpy as np

from space_envs.dynamics.rotations import Array
from space_envs.robots.description.shape.clouds import Cloud, half_sphere, thinned

_FIRST = np.concatenate([np.eye(3), half_sphere(64)])  # first candidates of the axis
_ROUNDS, _NEAR = 5, 16  # refinements around the best one
_CIRCLE_STEPS = 40
_DIGITS = 4  # behind the point, of m: every machine finds the same capsule
_SHORTEST = 1e-3  # m; the centre line of a sphere has a direction too


class Segment(NamedTuple):
    """A capsule.

    Attributes:
        start, end: (3,) m, of its centre line. radius: m.
    """

    start: Array
    end: Array
    radius: float

    @property
    def volume(self) -> float:
        """m^3."""
        length = float(np.linalg.norm(self.end - self.start))
        return float(np.pi * self.radius**2 * (length + 4.0 / 3.0 * self.radius))


def enclosing_capsule(cloud: Cloud, rounds: int = _ROUNDS) -> Segment:
    """A capsule around all of a cloud, of nearly the smallest volume; nearer to it after more rounds."""
    few = thinned(cloud)
    best = _best(few, _FIRST)
    spread = 2.0 / np.sqrt(len(_FIRST))
    for _ in range(rounds):
        best = _best(few, np.concatenate([best[None], _around(best, spread)]))
        spread /= 2.5
    return _rounded(cloud, _fit(few, best[None]))


def _around(direction: Array, spread: float) -> Array:
    """Directions next to one."""
    basis = _across(direction[None])[0]
    angle = np.arange(_NEAR) * 2 * np.pi / _NEAR
    size = spread * np.where(np.arange(_NEAR) % 2, 1.0, 0.5)[:, None]
    near = direction + size * (np.cos(angle)[:, None] * basis[0] + np.sin(angle)[:, None] * basis[1])
    return near / np.linalg.norm(near, axis=1, keepdims=True)


def _across(directions: Array) -> Array:
    """(d, 2, 3) unit vectors that are orthogonal to each direction and to each other."""
    other = np.eye(3)[np.argmin(np.abs(directions), axis=1)]
    first = np.cross(directions, other)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(directions, first)], axis=1)


def _fit(cloud: Cloud, directions: Array) -> tuple[Array, Array, Array]:
    """Ends (d, 3), (d, 3) and radii (d,) of the capsules along directions (d, 3)."""
    across, radii = _across(directions), cloud.radii
    flat = across @ cloud.centres.T
    x, y = flat[:, 0], flat[:, 1]
    rows = np.arange(len(directions))
    centre = flat.mean(axis=2)
    # The smallest circle, after Badoiu and Clarkson: towards the farthest point, by ever smaller steps.
    for step in range(2, _CIRCLE_STEPS + 2):
        far = (np.hypot(x - centre[:, :1], y - centre[:, 1:]) + radii).argmax(axis=1)
        centre += (flat[rows, :, far] - centre) / step
    aside = np.hypot(x - centre[:, :1], y - centre[:, 1:])
    radius = (aside + radii).max(axis=1)
    cap = np.sqrt(np.maximum((radius[:, None] - radii) ** 2 - aside**2, 0.0))
    along = directions @ cloud.centres.T
    low, high = (along + cap).min(axis=1), (along - cap).max(axis=1)
    middle, half = (low + high) / 2, np.maximum((high - low) / 2, _SHORTEST / 2)
    low, high = middle - half, middle + half
    foot = np.einsum("di,dij->dj", centre, across)
    return foot + low[:, None] * directions, foot + high[:, None] * directions, radius


def _best(cloud: Cloud, directions: Array) -> Array:
    """The direction (3,) of the smallest capsule."""
    start, end, radius = _fit(cloud, directions)
    volume = radius**2 * (np.linalg.norm(end - start, axis=1) + 4.0 / 3.0 * radius)
    return directions[volume.argmin()]


def _rounded(cloud: Cloud, capsule: tuple[Array, Array, Array]) -> Segment:
    """A capsule with rounded ends, which still encloses the cloud."""
    start, end = (np.round(each[0], _DIGITS) + 0.0 for each in capsule[:2])
    return Segment(start, end, float(np.ceil(reach(cloud, start, end) * 10**_DIGITS) / 10**_DIGITS))


def reach(cloud: Cloud, start: Array, end: Array) -> float:
    """Radius of the capsule around a centre line that encloses a cloud, m."""
    along = end - start
    length = float(along @ along)
    share = (
        np.clip((cloud.centres - start) @ along / length, 0.0, 1.0) if length else np.zeros(len(cloud.radii))
    )
    aside = cloud.centres - start - share[:, None] * along
    return float((np.linalg.norm(aside, axis=1) + cloud.radii).max())
