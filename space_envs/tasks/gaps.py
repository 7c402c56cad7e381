"""Gaps between the arms of a robot, its satellite and a target, as functions of the joint angles.

Arms are chains of capsules, the satellite and the target are boxes; their sizes are in
`space_envs.robots.capsules`.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.capsules import box_distance, segment_distance
from space_envs.dynamics.rotations import Array
from space_envs.errors import GoalError
from space_envs.robots.capsules import ArmShape, point_names


@dataclass(frozen=True, eq=False)
class ArmGaps:
    """Gaps of the arms, as chains of capsules, to each other and to the satellite and the target, as boxes.

    Attributes:
        shape: of every arm. arms: their number A.
        carrier: (A, P) links that the points are fixed to, from 0. place: (A, P, 3) m, in the links' frames.
        columns: of the model's sensors: of the points in the satellite's and in the target's frame, and of a
            grapple point in the target's; None where there are none.
    """

    shape: ArmShape
    arms: int
    carrier: NDArray[np.int64]
    place: Array
    columns: dict[str, slice]

    @classmethod
    def of(cls, model: mujoco.MjModel, shape: ArmShape, arms: int = 1) -> Self:
        """Gaps in a model whose sensors measure the shape's points."""
        names = point_names(shape, range(1, arms + 1))
        links = [int(model.jnt_bodyid[joint]) for joint in model.actuator_trnid[:, 0]]
        sites = {model.site(number).name for number in range(model.nsite)}
        carrier, place = [], []
        for name in names:
            site = model.site(name) if name in sites else None
            carrier.append(links.index(int(model.body(name).id if site is None else site.bodyid[0])))
            place.append(np.zeros(3) if site is None else site.pos.copy())
        columns = {}
        sensors = {model.sensor(number).name for number in range(model.nsensor)}
        for frame in ("satellite", "target"):
            if f"{names[0]}_in_{frame}" in sensors:
                first = int(model.sensor(f"{names[0]}_in_{frame}").adr[0])
                columns[frame] = slice(first, first + 3 * len(names))
        if "half_width" in sensors:
            first = int(model.sensor("half_width").adr[0])
            columns["half_width"] = slice(first, first + 3)
        size = len(shape.points)
        return cls(
            shape, arms, np.array(carrier).reshape(arms, size), np.reshape(place, (arms, size, 3)), columns
        )

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the contacts, by code; code 0, none, is empty."""
        return ("", *dict.fromkeys(self.pairs))

    @cached_property
    def pairs(self) -> list[str]:
        """Names of all pairs: capsules and the satellite, the target, and the capsules of the other arm."""
        capsules = range(len(self.shape.link))
        links = [self._link_name(arm, place) for arm in range(self.arms) for place in capsules]
        pairs = []
        if self.shape.half is not None:
            pairs += [f"{link} and the satellite" for link in links]
        if self.shape.body is not None:
            pairs += [f"{link} and the target" for link in links]
        if self.arms == 2:
            half = len(links) // 2
            pairs += [f"{one} and {other}" for one in links[:half] for other in links[half:]]
        return pairs

    def _link_name(self, arm: int, place: int) -> str:
        link = f"link {self.shape.link[place]}"
        return link if self.arms == 1 else f"{link} of arm {arm + 1}"

    @cached_property
    def first_pair(self) -> dict[str, int]:
        """Index in `pairs` of the first pair with each body."""
        each = self.arms * len(self.shape.link)
        with_target = 0 if self.shape.half is None else each
        return {"satellite": 0, "target": with_target, "arms": with_target + each}

    @cached_property
    def grips(self) -> NDArray[np.int64]:
        """Indices of the gaps that close when the target is grappled."""
        first, size = self.first_pair["target"], len(self.shape.link)
        near = np.flatnonzero(np.array(self.shape.target) == 0.0)
        return first + (size * np.arange(self.arms)[:, None] + near).ravel()

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

    def points(self, robot: FloatingRobot, q: Array) -> Array:
        """Points (..., A, P, 3) of the arms in the satellite's frame for joint angles q (..., n) rad, m."""
        k = robot.kinematics(q)
        offset = (k.rotation[..., self.carrier, :, :] @ self.place[..., None])[..., 0]
        return k.position[..., self.carrier, :] + offset

    def all_gaps(
        self, points: Array, in_target: Array | None = None, half: Array | None = None, **options: bool
    ) -> Array:
        """Gaps (K, M) of all pairs, m, in the order of `pairs`.

        Args:
            points, in_target: (K, A, P, 3) m, in the satellite's and in the target's frame.
            half, options: as in `target_gaps`.
        """
        found = [] if self.shape.half is None else [self.satellite_gaps(points)]
        if in_target is not None and half is not None:
            found.append(self.target_gaps(in_target, half, **options))
        if self.arms == 2:
            found.append(self.arm_gaps(points))
        return np.concatenate([gap.reshape(len(gap), math.prod(gap.shape[1:])) for gap in found], axis=1)

    def satellite_gaps(self, points: Array) -> Array:
        """Gaps (..., A, S) between capsules and the satellite, m, negative where they overlap.

        Args:
            points: (..., A, P, 3) m, in the satellite's frame.
        """
        half = np.full(3, self.shape.half)
        return box_distance(points[..., :-1, :], points[..., 1:, :], half) - np.array(self.shape.satellite)

    def target_gaps(self, points: Array, half: Array, gripper: bool = True) -> Array:
        """Gaps (..., A, S) between capsules and the target, m, negative where they overlap.

        Args:
            points: (..., A, P, 3) m, in the target's frame. half: (..., 3) m, half sides of the target.
            gripper: whether the gripper may touch the target: its radius then counts as zero.
        """
        distance = box_distance(points[..., :-1, :], points[..., 1:, :], half[..., None, None, :])
        return distance - (np.array(self.shape.target) if gripper else self.shape.radius)

    def arm_gaps(self, points: Array) -> Array:
        """Gaps (..., S, S) between the capsules of arm 1 and those of arm 2, m, negative where they overlap.

        Args:
            points: (..., 2, P, 3) m, in any frame.
        """
        one, other = points[..., 0, :, None, :], points[..., 1, None, :, :]
        ends = one[..., :-1, :, :], one[..., 1:, :, :], other[..., :-1, :], other[..., 1:, :]
        return segment_distance(*ends) - 2.0 * self.shape.radius

    def chosen_gaps(self, pair: NDArray[np.int64], points: Array, in_target: Array, half: Array) -> Array:
        """Gap (K, V) of one pair in each row, m, for V variations of all points.

        Args:
            pair: (K,) indices in the order of `all_gaps`. points, in_target: (K, V, A, P, 3) m, in the
                satellite's and in the target's frame. half: (K, 3) m, half sides of the target.
        """
        size, start = len(self.shape.link), self.first_pair
        boxes = [("target", in_target, half, self.shape.target)]
        if self.shape.half is not None:
            boxes.append(("satellite", points, np.full_like(half, self.shape.half), self.shape.satellite))
        gaps = np.empty(points.shape[:2])
        for name, seen, sides, radius in boxes:
            rows = np.flatnonzero((pair >= start[name]) & (pair < start[name] + self.arms * size))
            arm, link = np.divmod(pair[rows] - start[name], size)
            first, second = seen[rows, :, arm, link], seen[rows, :, arm, link + 1]
            gaps[rows] = box_distance(first, second, sides[rows, None]) - np.array(radius)[link, None]
        rows = np.flatnonzero(pair >= start["arms"])
        one, other = np.divmod(pair[rows] - start["arms"], size)
        ends = [points[rows, :, arm, link + end] for arm, link in ((0, one), (1, other)) for end in (0, 1)]
        gaps[rows] = segment_distance(*ends) - 2.0 * self.shape.radius
        return gaps
