"""Clearance of planned joint motions of the single arm from the satellite and keep-out spheres.

By the same distances by which the simulation ends an episode; a plan keeps a little farther away.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.plans import Cause, Failure
from space_envs.dynamics import FloatingRobot, roll_out_base
from space_envs.dynamics.rotations import Array, conjugate, rotate
from space_envs.policy import PolicyContext
from space_envs.robots.robot import Robot
from space_envs.tasks.contacts import Contacts

MARGIN = 0.002  # m, added to the clearance that the simulation requires, for errors of the drives
SPHERE_MARGIN = 0.004  # m, by which optimisers enlarge spheres, so that their plans satisfy `MARGIN`
COARSE = 5  # every so many samples one is checked where a motion is only selected
CHUNK = 10  # motions checked at once


def link_radii(robot: Robot) -> Array:
    """Radii (n,) of the links from joint to joint: of the thickest capsule of each, m.

    A link without a capsule, which hardly has a length, has that of the thickest of all.
    """
    thickest = max(capsule.radius for arm in robot.arms for capsule in arm.capsules)
    radii = []
    for arm in robot.arms:
        for number in range(1, len(arm.links) + 1):
            own = [capsule.radius for capsule in arm.capsules if capsule.link == number]
            radii.append(max(own, default=thickest))
    return np.array(radii)


def spheres_seen(context: PolicyContext, observation: Array) -> Array | None:
    """Centres and radii (N, K, 4) in m of the keep-out spheres, in the satellite's current frame.

    None for a task without spheres.
    """
    read = context.layout.read
    if "obstacle_position" not in context.layout.slices:
        return None
    radius = read(observation, "obstacle_radius")[..., None]
    centre = read(observation, "obstacle_position").reshape(*radius.shape[:2], 3)
    to_base = conjugate(read(observation, "base_quaternion"))
    local = rotate(to_base[:, None], centre - read(observation, "base_position")[:, None])
    return np.concatenate([local, radius], axis=-1)


@dataclass(frozen=True, eq=False)
class KeepOut:
    """Bodies that the links of a single arm may not touch in N motions.

    Attributes:
        arm: the robot. contacts: of its links with other bodies.
        spheres: (N, K, 4) from `spheres_seen` at the start of the motions; None without.
    """

    arm: FloatingRobot
    contacts: Contacts
    spheres: Array | None = None

    @classmethod
    def of(cls, context: PolicyContext, observation: Array) -> Self | None:
        """Bodies around motions that start at observations (N, size); None if collisions are not checked."""
        contacts = context.contacts
        spheres = spheres_seen(context, observation)
        if contacts is None or not (context.robot.satellite.reachable or spheres is not None):
            return None
        return cls(context.arm, contacts, spheres)

    def take(self, rows: NDArray[Any]) -> Self:
        """Bodies of the selected rows, by number or mask."""
        return self if self.spheres is None else replace(self, spheres=self.spheres[rows])

    def gaps(self, path: Array, rate: Array, dt: float) -> Array:
        """Gaps (N, T, S + R K) in m: of S capsules and the satellite, then of R capsules and K spheres.

        Those to the satellite depend on the joint angles alone; spheres are static while the satellite moves,
        with zero total momentum.

        Args:
            path, rate: (N, T, n) rad and rad/s. dt: s, between samples.
        """
        points = self.contacts.points(self.arm, path)
        found = self.contacts.satellite_gaps(points)
        if self.spheres is None:
            return found
        position, quaternion = roll_out_base(self.arm, path, rate, dt)
        points = position[..., None, :] + rotate(quaternion[..., None, :], points)
        gaps = self.contacts.sphere_gaps(points, self.spheres[:, None])
        return np.concatenate([found, gaps.reshape(*gaps.shape[:2], gaps.shape[2] * gaps.shape[3])], axis=-1)

    def clear(self, path: Array, rate: Array, dt: float) -> NDArray[np.bool_]:
        """Whether each motion (N,) has a clearance of at least `MARGIN`; arguments as in `gaps`."""
        return self.gaps(path, rate, dt).min(axis=(1, 2)) > MARGIN

    def first_clear(self, paths: Array, rates: Array, dt: float, order: Sequence[int]) -> int | None:
        """Index of the first clear motion of (M, T, n) in a given order, or None; for N = 1.

        Only every `COARSE`-th sample is checked where the satellite's motion does not matter: enough to
        choose by, not to be sure.
        """
        step = COARSE if self.spheres is None else 1
        for first in range(0, len(order), CHUNK):
            some = list(order[first : first + CHUNK])
            every = self.take(np.zeros(len(some), dtype=np.int64))
            clear = every.clear(paths[some, ::step], rates[some, ::step], step * dt)
            if clear.any():
                return some[int(clear.argmax())]
        return None

    def refusal(self, method: str, path: Array, rate: Array, dt: float) -> Failure | None:
        """Failure of a joint motion (T, n) that comes too near to a body; None if clear. For N = 1."""
        gaps = self.gaps(path[None], rate[None], dt)[0]
        if gaps.min() > MARGIN:
            return None
        node, place = np.unravel_index(gaps.argmin(), gaps.shape)
        names, contacts = self.contacts.link_names, self.contacts
        pairs = [f"{link} would be {{gap}} from the satellite" for link in names(contacts.near_satellite)]
        count = 0 if self.spheres is None else self.spheres.shape[1]
        pairs += [
            f"{link} would be {{gap}} from obstacle {k + 1}"
            for link in names(contacts.near_others)
            for k in range(count)
        ]
        reason = f"{pairs[place].format(gap=f'{gaps.min():.3f} m')} at t = {node * dt:.2f} s"
        return Failure(method, Cause.CLEARANCE, reason)
