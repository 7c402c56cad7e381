"""Gaps between the links of an arm and keep-out spheres."""

import numpy as np

from space_envs.dynamics.floating import FloatingRobot
from space_envs.dynamics.rotations import Array, rotate

_TINY = 1e-12  # m^2, avoids 0 / 0 for a link of zero length


def link_ends(robot: FloatingRobot, q: Array, base_position: Array, base_quaternion: Array) -> Array:
    """Ends (..., n + 1, 3) of the links of a single arm in the inertial frame, m.

    Link i runs from end i - 1, on its own joint's axis, to end i, on the next joint's axis; the last one to
    the end-effector.

    Args:
        q: (..., n) rad. base_position: (..., 3) m. base_quaternion: (..., 4), body to inertial.
    """
    points = np.concatenate(
        [robot.kinematics(q).position, robot.end_effector_pose(q)[0][..., None, :]], axis=-2
    )
    return base_position[..., None, :] + rotate(base_quaternion[..., None, :], points)


def sphere_gaps(ends: Array, spheres: Array, link_radius: Array | float) -> Array:
    """Gaps (..., n, K) between links and spheres, m; negative where a link is inside.

    Links are capsules of radius `link_radius` around straight segments.

    Args:
        ends: (..., n + 1, 3) of the links, m. spheres: (..., K, 4) centres and radii, m.
        link_radius: m, (n,) or one for all.
    """
    radius = np.full(ends.shape[-2] - 1, link_radius)
    return capsule_sphere_gaps(ends[..., :-1, :], ends[..., 1:, :], spheres, radius)


def capsule_sphere_gaps(start: Array, end: Array, spheres: Array, radius: Array) -> Array:
    """Gaps (..., S, K) between capsules and spheres, m; negative where they overlap.

    Args:
        start, end: (..., S, 3) of the capsules' centre lines, m. radius: (S,) m, of the capsules.
        spheres: (..., K, 4) centres and radii, m.
    """
    start = start[..., None, :]
    along = end[..., None, :] - start
    to_centre = spheres[..., None, :, :3] - start
    square = np.maximum((along * along).sum(axis=-1), _TINY)
    share = np.minimum(np.maximum((to_centre * along).sum(axis=-1) / square, 0.0), 1.0)
    away = to_centre - share[..., None] * along
    return np.sqrt((away * away).sum(axis=-1)) - spheres[..., None, :, 3] - radius[:, None]
