"""Keep-out spheres of motions in weight space, and the points of links that are nearest to spheres."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from agents.planners.single_arm.weights.shapes import INTERVALS
from agents.planners.single_arm.weights.weight_space import Disturbance, WeightSpace
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.spheres import sphere_gaps

SPHERE_CANDIDATES = 0.15  # m, clearance below which a sphere gets a row
SPHERE_MARGIN = 0.02  # m, clearance of plans at their sampling times


class NearestPoints(NamedTuple):
    """Points of links that are nearest to spheres, k of them.

    Attributes:
        point: (k, 3) m, on the centre lines. out: (k, 3) unit vectors to them from the spheres' centres.
        lever: (k, n) m, velocities of the points along `out` by the joint rates, while the base is at rest.
    """

    point: Array
    out: Array
    lever: Array

    @classmethod
    def of(cls, ends: Array, axes: Array, link: NDArray[np.intp], centre: Array) -> "NearestPoints":
        """Nearest points in k configurations.

        Args:
            ends: (k, n + 1, 3) m, of the links. axes: (k, n, 3) of the joints. link: (k,) from 0.
            centre: (k, 3) m, of the spheres, in the same frame.
        """
        every = np.arange(len(link))
        start = ends[every, link]
        along = ends[every, link + 1] - start
        square = np.maximum((along * along).sum(axis=1), 1e-12)
        share = np.clip(((centre - start) * along).sum(axis=1) / square, 0.0, 1.0)
        point = start + share[:, None] * along
        out = point - centre
        out /= np.maximum(np.sqrt((out * out).sum(axis=1, keepdims=True)), 1e-9)
        # Derivative by the joints that carry the link: axis x (point - joint).
        carried = np.arange(axes.shape[1]) <= link[:, None]
        arms = point[:, None] - ends[:, :-1]
        return cls(point, out, (np.cross(axes, arms) * out[:, None]).sum(axis=-1) * carried)


class Spheres:
    """Links keep out of spheres on an even grid.

    Between the ends of the roll-out's intervals the slow motion of the base is interpolated linearly.

    Args:
        spheres: (K, 4) centre and radius, m, in the initial base frame. link_radius: m, (n,) or one for all.
    """

    def __init__(
        self, space: WeightSpace, robot: FloatingRobot, spheres: Array, link_radius: Array | float
    ) -> None:
        self._space, self._robot, self._spheres, self._radius = space, robot, spheres, link_radius
        count = space.even.shape[1]
        place = np.linspace(0.0, INTERVALS, count)
        self._left = np.minimum(place.astype(int), INTERVALS - 1)
        self._share = place - self._left

    def gaps(self, y: Array) -> Array:
        """Clearances (S, T, n, K), m, of coordinates (S, n, m) on the grid."""
        ends, _ = self._ends(y, self._space.poses(y))
        return sphere_gaps(ends, self._spheres, self._radius)

    def violation(self, y: Array) -> float:
        """Sum over the grid of clearance below the margin, m."""
        ends, _ = self._ends(y, self._space.poses(y[None])[0])
        gap = sphere_gaps(ends, self._spheres, self._radius)
        return float(np.maximum(SPHERE_MARGIN - gap, 0.0).sum())

    def _ends(self, y: Array, pose: Array) -> tuple[Array, Array]:
        """Ends of the links (..., T, n + 1, 3) m and axes of the joints (..., T, n, 3)."""
        before, after = pose[..., self._left, :], pose[..., self._left + 1, :]
        mixed = before + self._share[:, None] * (after - before)
        # Rotations are stored by columns; read by rows they are transposed, as row vectors need them.
        place, rotation = mixed[..., :3], mixed[..., 3:].reshape(*mixed.shape[:-1], 3, 3)
        q = self._space.even_fixed[0] + self._space.even[0] @ y.swapaxes(-1, -2)
        k = self._robot.kinematics(q)
        points = np.concatenate([k.position, self._robot.end_effector_pose(q)[0][..., None, :]], axis=-2)
        return place[..., None, :] + points @ rotation, k.axis @ rotation

    def linear(self, y: Array, at: Disturbance, part: float) -> tuple[Array, Array, Array]:
        """Rows for links close to a sphere: velocity of the nearest point away from the centre."""
        ends, axes = self._ends(y, at.pose[0])
        gap = sphere_gaps(ends, self._spheres, self._radius)
        time, link, sphere = np.nonzero(gap < SPHERE_CANDIDATES)
        near = NearestPoints.of(ends[time], axes[time], link, self._spheres[sphere, :3])
        rows = (near.lever[..., None] * self._space.even[0][time][:, None]).reshape(len(time), y.size)
        # Derivative by the displacement of the base so far.
        displacement = self._space.displacements(at.influence)[0]
        weight = np.concatenate([near.out, np.cross(near.point, near.out)], axis=1)
        left, ahead = self._left[time], self._share[time][:, None, None]
        moved = (1.0 - ahead) * displacement[left] + ahead * displacement[left + 1]
        rows += (weight[:, None] @ moved)[:, 0]
        missing = SPHERE_MARGIN - gap[time, link, sphere]
        return rows, np.where(missing > 0.0, part * missing, missing), np.full(len(time), np.inf)
