"""Clearances of the arms from the satellite's body, from each other and from a moving target, batched.

Links are capsules from joint to joint; the satellite and the target are boxes. This module checks plans; it
shares nothing with the expressions that the planner uses.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.planners.dual_arm.surroundings import Surroundings
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.capsules import box_distance, segment_distance
from space_envs.dynamics.rotations import Array, conjugate, rotate

_SHORT = 1e-6  # m; shorter links are joints without a body


@dataclass(frozen=True, eq=False)
class Links:
    """Links of a robot that have a length.

    Attributes:
        link: (S,) their numbers, from 1. arm: (S,) number of their arm. order: (S,) position in the arm,
            counted over all its links from 0. end: (S, 3) m, their ends in the link's frame.
        last: (S,) whether it carries the end-effector.
    """

    link: NDArray[np.int64]
    arm: NDArray[np.int64]
    order: NDArray[np.int64]
    end: Array
    last: NDArray[np.bool_]

    @classmethod
    def of(cls, robot: FloatingRobot) -> "Links":
        """Return the links from joint to joint, and from the last joint to the end-effector."""
        rows = []
        for arm, last_link in enumerate(robot.end_effector_link):
            chain = [int(last_link)]
            while robot.parent[chain[0] - 1] != 0:
                chain.insert(0, int(robot.parent[chain[0] - 1]))
            ends = [robot.offset[link - 1] for link in chain[1:]] + [robot.end_effector_offset[arm]]
            for order, (link, end) in enumerate(zip(chain, ends, strict=True)):
                if np.linalg.norm(end) > _SHORT:
                    rows.append((link, arm, order, end, link == last_link))
        link, arm, order, end, last = (np.array(column) for column in zip(*rows, strict=True))
        return cls(link, arm, order, end, last)

    def segments(self, robot: FloatingRobot, q: Array) -> tuple[Array, Array, Array]:
        """Both ends (K, S, 3) of the links in the base frame and the centre of mass (K, 3), m."""
        k = robot.kinematics(q)
        root = k.position[:, self.link - 1]
        end = root + (k.rotation[:, self.link - 1] @ self.end[:, :, None])[..., 0]
        return root, end, robot.centre_of_mass(k)


@dataclass(frozen=True, eq=False)
class Gaps:
    """Clearances between surfaces along a motion, m, negative where they overlap, infinite without an
    obstacle.

    Attributes:
        arms, bus, target: (K,) least clearance of the arms from each other, from the satellite and from the
            target.
    """

    arms: Array
    bus: Array
    target: Array

    @property
    def each(self) -> Array:
        """(K,) least clearance, m."""
        return np.minimum(np.minimum(self.arms, self.bus), self.target)

    @property
    def least(self) -> float:
        """Least clearance at any time, m."""
        return float(self.each.min())

    def row(self, place: int) -> "Gaps":
        """Clearances at one index of the motion."""
        return Gaps(*(gap[place : place + 1] for gap in (self.arms, self.bus, self.target)))

    def worst(self) -> tuple[str, int]:
        """Nearest bodies, in words, and the index in the motion."""
        names = {"arm 1 and arm 2": self.arms, "an arm and the satellite": self.bus}
        names |= {"an arm and the target": self.target}
        name = min(names, key=lambda key: names[key].min())
        return name, int(names[name].argmin())


def gaps(
    robot: FloatingRobot,
    around: Surroundings,
    time: Array,
    q: Array,
    duration: float,
    start: Array,
    poses: tuple[Array, Array] | None = None,
) -> Gaps:
    """Clearances along a motion with constant base attitude.

    Args:
        time: (K,) s. q: (K, n) rad. duration: s, of the plan, which ends with the grapple of the target.
        start: (n,) rad at the start of the plan, where the base's origin is the inertial origin.
        poses: of the target at these times, if they are known.
    """
    links = Links.of(robot)
    root, end, centre = links.segments(robot, q)
    infinite = np.full(len(time), np.inf)
    result = {"arms": infinite, "bus": infinite, "target": infinite}
    if around.arms and links.arm.any():
        one, other = np.flatnonzero(links.arm == 0), np.flatnonzero(links.arm == 1)
        one, other = (part.ravel() for part in np.meshgrid(one, other, indexing="ij"))
        apart = segment_distance(root[:, one], end[:, one], root[:, other], end[:, other])
        result["arms"] = apart.min(axis=1) - 2.0 * around.radius
    if around.bus is not None:
        free = links.order >= around.standing
        first, second = (point[:, free] - around.bus_centre for point in (root, end))
        apart = box_distance(first, second, around.bus)
        result["bus"] = apart.min(axis=1) - around.radius
    if around.target is not None and around.motion is not None:
        position, quaternion = around.motion(time) if poses is None else poses
        # The common centre of mass is at rest, and the base moves.
        base = robot.centre_of_mass(robot.kinematics(start)) - centre
        counted = around.counted(np.linalg.norm(links.end, axis=1), time, duration)
        share = np.where(links.last, counted, 1.0)
        outer = root + share[..., None] * (end - root)
        back = conjugate(quaternion)[:, None]
        points = (point + (base - position)[:, None] for point in (root, outer, end))
        root, outer, outermost = (rotate(back, point) for point in points)
        apart = box_distance(root, outer, around.target).min(axis=1) - around.radius
        # An open gripper counts by its centre line.
        line = box_distance(outer[:, links.last], outermost[:, links.last], around.target).min(axis=1)
        result["target"] = np.minimum(apart, line)
    return Gaps(**result)
