"""Gaps between the arms of a robot, its satellite, a target and keep-out spheres, by the joint angles.

Arms are capsules between points that are fixed to their links, the satellite and the target are boxes; the
robot has their sizes.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.capsules import box_distance, segment_distance
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.spheres import capsule_sphere_gaps
from space_envs.errors import GoalError
from space_envs.robots.models.bodies import anchor_name, arm_numbers
from space_envs.robots.robot import UNCHECKED, Robot


class Capsules(NamedTuple):
    """Capsules of all arms, arm by arm, S of them.

    Attributes:
        arm: (S,) from 0. link: (S,) number in the arm, from 1.
        start, end: (S,) places of their ends among the points of all arms.
        radius: (S,) m, against the other arm and spheres. satellite, target: (S,) m, against these bodies;
            0 is the centre line alone, minus infinity no check.
    """

    arm: NDArray[np.int64]
    link: NDArray[np.int64]
    start: NDArray[np.int64]
    end: NDArray[np.int64]
    radius: Array
    satellite: Array
    target: Array

    @classmethod
    def of(cls, robot: Robot) -> "Capsules":
        """All capsules of a robot."""
        rows, first = [], 0
        for number, arm in enumerate(robot.arms):
            rows += [(number, c.link, first + c.start, first + c.end, *c[3:]) for c in arm.capsules]
            first += len(arm.anchors)
        places = np.array([row[:4] for row in rows], dtype=np.int64).reshape(-1, 4)
        radii = np.array([row[4:] for row in rows], dtype=np.float64).reshape(-1, 3)
        columns: list[Any] = [*places.T, *radii.T]
        return cls(*columns)

    def take(self, chosen: NDArray[np.bool_]) -> "Capsules":
        """The chosen (S,) ones."""
        columns: list[Any] = [column[chosen] for column in self]
        return Capsules(*columns)

    @property
    def split(self) -> int:
        """Number of capsules of the first arm."""
        return int((self.arm == 0).sum())


@dataclass(frozen=True, eq=False)
class ArmGaps:
    """Gaps of the arms to each other, to the satellite, to the target and to spheres.

    Attributes:
        robot: whose arms they are.
        columns: of the model's sensors: of the points of all arms in the satellite's, the target's and the
            inertial frame, and of a grapple point in the target's; without those that are not measured.
    """

    robot: Robot
    columns: dict[str, slice]

    @classmethod
    def of(cls, model: mujoco.MjModel, robot: Robot) -> Self:
        """Gaps in a model whose sensors measure the points of the robot's arms."""
        anchors = [
            anchor_name(number, anchor)
            for number, arm in zip(arm_numbers(robot), robot.arms, strict=True)
            for anchor in arm.anchors
        ]
        sensors = {model.sensor(number).name for number in range(model.nsensor)}
        names = {frame: f"{anchors[0]}_in_{frame}" for frame in ("satellite", "target", "world")}
        sizes = {**dict.fromkeys(names, 3 * len(anchors)), "half_width": 3}
        first = {
            quantity: int(model.sensor(name).adr[0])
            for quantity, name in {**names, "half_width": "half_width"}.items()
            if name in sensors
        }
        return cls(robot, {name: slice(start, start + sizes[name]) for name, start in first.items()})

    @property
    def arms(self) -> int:
        """Number of arms."""
        return len(self.robot.arms)

    @cached_property
    def fixed_points(self) -> tuple[NDArray[np.int64], Array]:
        """Links (P,) that the points are fixed to, from 0 over all arms, and places (P, 3) in them, m."""
        links, places, first = [], [], 0
        for arm in self.robot.arms:
            links += [first + anchor.link - 1 for anchor in arm.anchors]
            places += [anchor.at for anchor in arm.anchors]
            first += len(arm.links)
        return np.array(links), np.array(places)

    @cached_property
    def near_satellite(self) -> Capsules:
        """Capsules that are checked against the satellite."""
        capsules = Capsules.of(self.robot)
        return capsules.take((capsules.satellite > UNCHECKED) & self.robot.satellite.reachable)

    @cached_property
    def near_others(self) -> Capsules:
        """Capsules that are checked against the target, the other arm or spheres."""
        capsules = Capsules.of(self.robot)
        grips = self.robot.target is not None
        return capsules.take((capsules.radius > UNCHECKED) | ((capsules.target > UNCHECKED) & grips))

    @cached_property
    def satellite_half(self) -> Array:
        """(3,) m, half sides of the satellite's box."""
        return np.array(self.robot.satellite.box)

    @cached_property
    def satellite_centre(self) -> Array | None:
        """(3,) m, of the satellite's box in its frame; None for the origin."""
        centre = np.array(self.robot.satellite.box_centre)
        return centre if centre.any() else None

    @cached_property
    def target_shape(self) -> Array:
        """(3,) half sides of the target's box for each metre of the grapple points' distance from its centre;
        empty for a robot without a target."""
        target = self.robot.target
        return np.empty(0) if target is None else np.array([side / target.half_width for side in target.body])

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the contacts, by code; code 0, none, is empty."""
        return ("", *dict.fromkeys(self.pairs))

    @cached_property
    def pairs(self) -> list[str]:
        """Names of all pairs: capsules and the satellite, the target, and the capsules of the other arm."""
        pairs = [f"{link} and the satellite" for link in self.link_names(self.near_satellite)]
        links = self.link_names(self.near_others)
        if self.robot.target is not None:
            pairs += [f"{link} and the target" for link in links]
        if self.arms == 2:
            split = self.near_others.split
            pairs += [f"{one} and {other}" for one in links[:split] for other in links[split:]]
        return pairs

    def link_names(self, capsules: Capsules) -> list[str]:
        """Name of the link of each capsule."""
        numbers = zip(capsules.arm.tolist(), capsules.link.tolist(), strict=True)
        return [f"link {link}" + (f" of arm {arm + 1}" if self.arms == 2 else "") for arm, link in numbers]

    @cached_property
    def first_pair(self) -> dict[str, int]:
        """Index in `pairs` of the first pair with each body."""
        target = len(self.near_satellite.arm)
        arms = target + (0 if self.robot.target is None else len(self.near_others.arm))
        return {"satellite": 0, "target": target, "arms": arms}

    @cached_property
    def grips(self) -> NDArray[np.int64]:
        """Indices of the gaps that close when the target is grappled."""
        return self.first_pair["target"] + np.flatnonzero(self.near_others.target == 0.0)

    def refuse(self, gaps: Array) -> None:
        """Reject starts (K) in collision, from gaps (K, M) of `all_gaps`.

        Raises:
            GoalError: with the two bodies in contact and the gap.
        """
        if (gaps <= 0.0).any():
            row, pair = np.unravel_index(gaps.argmin(), gaps.shape)
            raise GoalError(
                f"the episode would begin with a collision: between {self.pairs[pair]} there is a gap of "
                f"{gaps[row, pair]:.3f} m"
            )

    def points(self, mechanics: FloatingRobot, q: Array) -> Array:
        """Points (..., P, 3) of the arms in the satellite's frame for joint angles q (..., n) rad, m."""
        link, place = self.fixed_points
        k = mechanics.kinematics(q)
        return k.position[..., link, :] + (k.rotation[..., link, :, :] @ place[..., None])[..., 0]

    def all_gaps(
        self, points: Array, in_target: Array | None = None, half: Array | None = None, gripper: bool = True
    ) -> Array:
        """Gaps (K, M) of all pairs, m, in the order of `pairs`.

        Args:
            points, in_target: (K, P, 3) m, in the satellite's and in the target's frame.
            half, gripper: as in `target_gaps`.
        """
        found = [self.satellite_gaps(points)]
        if in_target is not None and half is not None:
            found.append(self.target_gaps(in_target, half, gripper))
        if self.arms == 2:
            apart = self.arm_gaps(points)
            found.append(apart.reshape(len(apart), apart.shape[1] * apart.shape[2]))
        return np.concatenate(found, axis=1)

    def satellite_gaps(self, points: Array) -> Array:
        """Gaps (..., S) between capsules and the satellite, m, negative where they overlap.

        Args:
            points: (..., P, 3) m, in the satellite's frame.
        """
        near, points = self.near_satellite, self.in_box(points)
        distance = box_distance(points[..., near.start, :], points[..., near.end, :], self.satellite_half)
        return distance - near.satellite

    def in_box(self, points: Array) -> Array:
        """Points (..., 3) from the centre of the satellite's box instead of its centre of mass, m."""
        return points if self.satellite_centre is None else points - self.satellite_centre

    def target_gaps(self, points: Array, half: Array, gripper: bool = True) -> Array:
        """Gaps (..., S) between capsules and the target, m, negative where they overlap.

        Args:
            points: (..., P, 3) m, in the target's frame. half: (..., 3) m, half sides of the target.
            gripper: whether the gripper may touch the target: its radius then counts as zero.
        """
        near = self.near_others
        distance = box_distance(points[..., near.start, :], points[..., near.end, :], half[..., None, :])
        return distance - (near.target if gripper else np.maximum(near.target, near.radius))

    def arm_gaps(self, points: Array) -> Array:
        """Gaps (..., S1, S2) between capsules of arm 1 and of arm 2, m, negative where they overlap.

        Args:
            points: (..., P, 3) m, in any frame.
        """
        first, second = points[..., self.near_others.start, :], points[..., self.near_others.end, :]
        split = self.near_others.split
        one = first[..., :split, None, :], second[..., :split, None, :]
        other = first[..., None, split:, :], second[..., None, split:, :]
        return segment_distance(*one, *other) - self.arm_reach

    @cached_property
    def arm_reach(self) -> Array:
        """(S1, S2) m, distance of the centre lines of two capsules of different arms that touch."""
        radius, split = self.near_others.radius, self.near_others.split
        return radius[:split, None] + radius[None, split:]

    def sphere_gaps(self, points: Array, spheres: Array) -> Array:
        """Gaps (..., S, K) between capsules and spheres, m, negative where they overlap.

        Args:
            points: (..., P, 3) m, in the frame of the spheres. spheres: (..., K, 4) centres and radii, m.
        """
        near = self.near_others
        ends = points[..., near.start, :], points[..., near.end, :]
        return capsule_sphere_gaps(*ends, spheres, near.radius)

    def chosen_gaps(self, pair: NDArray[np.int64], points: Array, in_target: Array, half: Array) -> Array:
        """Gap (K, V) of one pair in each row, m, for V variations of all points.

        Args:
            pair: (K,) indices in the order of `all_gaps`. points, in_target: (K, V, P, 3) m, in the
                satellite's and in the target's frame. half: (K, 3) m, half sides of the target.
        """
        gaps, start = np.empty(points.shape[:2]), self.first_pair
        satellite = np.broadcast_to(self.satellite_half, half.shape)
        near, others = self.near_satellite, self.near_others
        for first, seen, sides, capsules, radius in (
            (start["satellite"], self.in_box(points), satellite, near, near.satellite),
            (start["target"], in_target, half, others, others.target),
        ):
            rows = np.flatnonzero((pair >= first) & (pair < first + len(radius)))
            number = pair[rows] - first
            ends = seen[rows, :, capsules.start[number]], seen[rows, :, capsules.end[number]]
            gaps[rows] = box_distance(*ends, sides[rows, None]) - radius[number][:, None]
        rows, split = np.flatnonzero(pair >= start["arms"]), others.split
        one, other = np.divmod(pair[rows] - start["arms"], max(len(others.arm) - split, 1))
        chosen = [place[number] for number in (one, split + other) for place in (others.start, others.end)]
        reach = self.arm_reach[one, other]
        gaps[rows] = segment_distance(*(points[rows, :, place] for place in chosen)) - reach[:, None]
        return gaps
