"""Which links touch what they must not, by distance: from the model's sensors, or for joint angles.

Arms are chains of capsules, the satellite and the target are boxes; `space_envs.robots.capsules` says what
counts. Nothing has contact forces: an episode in which something is touched ends as a collision.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.capsules import box_distance, segment_distance
from space_envs.dynamics.rotations import Array
from space_envs.errors import GoalError
from space_envs.robots.capsules import ArmShape, point_names

SHARES = np.linspace(0.0, 1.0, 9)  # of a control period, at which links are seen
_ROOT_3 = 3.0**0.5  # largest length of a vector whose components are at most 1


class _Course(NamedTuple):
    """Capsules (N, A, S) of the arms in a period, in a body's frame, m.

    Attributes:
        begin, end: (N, A, S, 3) at the end of the period. step: (N, A, S + 1, 3) of their points in it.
        middle, span: (N, A, S, 3) twice the middles and half widths of their bounding boxes.
        move: (N,) that no point has moved farther than.
    """

    begin: Array
    end: Array
    step: Array
    middle: Array
    span: Array
    move: Array

    @classmethod
    def of(cls, before: Array, after: Array) -> "_Course":
        """From points (N, A, S + 1, 3) at the two ends of the period."""
        step = after - before
        begin, end = after[:, :, :-1], after[:, :, 1:]
        move = _ROOT_3 * np.abs(step).max(axis=(1, 2, 3))
        return cls(begin, end, step, begin + end, np.abs(end - begin), move)

    def at_shares(self, place: tuple[NDArray[np.int64], ...]) -> tuple[Array, Array]:
        """Begin and end (k, T, 3) of capsules at `SHARES` of the period, their points taken to move straight.

        Args:
            place: row, arm and number (k,) of each capsule.
        """
        row, arm, number = place
        left = (1.0 - SHARES)[:, None]
        return (
            self.begin[place][:, None] - left * self.step[place][:, None],
            self.end[place][:, None] - left * self.step[row, arm, number + 1][:, None],
        )


class _Hits(NamedTuple):
    """Pairs (k,) that are close: row, place in `Contacts._pairs`, and (k, T) whether they touch."""

    row: NDArray[np.int64]
    pair: NDArray[np.int64]
    touching: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Contacts:
    """The capsules of a robot and the boxes that they keep out of.

    Attributes:
        shape: of every arm. arms: their number A.
        carrier: (A, P) links of the robot that the points are fixed to, from 0. place: (A, P, 3) m, in them.
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
        """Of a model whose sensors measure the shape's points."""
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

    # What is called what ---------------------------------------------------------------------------------

    @cached_property
    def names(self) -> tuple[str, ...]:
        """What may touch what, by code; nothing, code 0, is empty."""
        return ("", *dict.fromkeys(self._pairs))

    @cached_property
    def _pairs(self) -> list[str]:
        """Names of all that is looked at: capsules and satellite, and target, and those of the other arm."""
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
    def _codes(self) -> NDArray[np.int64]:
        return np.array([self.names.index(pair) for pair in self._pairs])

    # In the simulation -----------------------------------------------------------------------------------

    def touched(self, before: Array, sensors: Array) -> NDArray[np.int64]:
        """Codes (N,) of what was touched first in a control period, 0 for nothing.

        Between the ends of the period the points of the arms are taken to move straight, and are looked at
        nine times: what is missed is less deep than a sixteenth of their way in a period.

        Args:
            before, sensors: (N, s) of the model at the beginning and at the end of the period.
        """
        # Runs at every step, also for N = 1: what counts here is the number of numpy calls. Capsules whose
        # bounding boxes, grown by what they have moved, stay away from each other need no closer look.
        n = len(sensors)
        hits: list[_Hits] = []
        for frame, columns in self._frames:
            shape = (n, self.arms, len(self.shape.points), 3)
            course = _Course.of(before[:, columns].reshape(shape), sensors[:, columns].reshape(shape))
            if frame == "satellite":
                gap = np.abs(course.middle) - course.span - self._satellite_reach
                hits += self._box_hits(course, gap, "satellite", None)
            else:
                half = self.target_half(sensors)
                gap = np.abs(course.middle) - course.span - self._target_reach - 2.0 * half[:, None, None]
                hits += self._box_hits(course, gap, "target", half)
                if self.arms == 2:
                    hits += self._arm_hits(course)
        return self._first(n, hits)

    def _box_hits(self, course: _Course, gap: Array, body: str, half: Array | None) -> list[_Hits]:
        """Capsules that touch a box; gap (N, A, S, 3) is twice that of the bounding boxes."""
        near = gap.max(axis=-1) <= (2.0 * course.move)[:, None, None]
        if not near.any():
            return []
        place = np.nonzero(near)
        sides = np.full((len(near), 3), self.shape.half) if half is None else half
        radius = np.array(self.shape.satellite if body == "satellite" else self.shape.target)
        distance = box_distance(course.begin[place], course.end[place], sides[place[0]])
        place = tuple(part[distance <= radius[place[2]] + course.move[place[0]]] for part in place)
        row, arm, number = place
        touching = box_distance(*course.at_shares(place), sides[row][:, None]) <= radius[number][:, None]
        return [_Hits(row, self._first_pair[body] + arm * len(self.shape.link) + number, touching)]

    def _arm_hits(self, course: _Course) -> list[_Hits]:
        """Capsules of arm 1 that touch capsules of arm 2."""
        reach, move = 2.0 * self.shape.radius, 2.0 * course.move
        low, high = (course.middle - course.span).min(axis=2), (course.middle + course.span).max(axis=2)
        apart = np.maximum(low[:, 0] - high[:, 1], low[:, 1] - high[:, 0]).max(axis=1)
        rows = np.flatnonzero(apart <= 2.0 * (reach + move))
        if not len(rows):
            return []
        middle, span = course.middle[rows], course.span[rows]
        gap = np.abs(middle[:, 0, :, None] - middle[:, 1, None]) - span[:, 0, :, None] - span[:, 1, None]
        place, one, other = np.nonzero(gap.max(axis=-1) <= 2.0 * (reach + move[rows])[:, None, None])
        row = rows[place]
        ends = [(course.begin[row, arm, n], course.end[row, arm, n]) for arm, n in ((0, one), (1, other))]
        near = segment_distance(*ends[0], *ends[1]) <= reach + move[row]
        row, one, other = row[near], one[near], other[near]
        first, second = np.zeros_like(row), np.ones_like(row)
        ways = *course.at_shares((row, first, one)), *course.at_shares((row, second, other))
        touching = segment_distance(*ways) <= reach
        return [_Hits(row, self._first_pair["arms"] + one * len(self.shape.link) + other, touching)]

    def _first(self, n: int, hits: list[_Hits]) -> NDArray[np.int64]:
        """Codes (N,) of what was touched first, and of that the first in the order of `_pairs`."""
        code = np.zeros(n, dtype=np.int64)
        if hits:
            none = len(SHARES) * len(self._codes)
            earliest = np.full(n, none)
            for row, pair, touching in hits:
                when = np.where(touching.any(axis=1), touching.argmax(axis=1), len(SHARES))
                np.minimum.at(earliest, row, when * len(self._codes) + np.where(when < len(SHARES), pair, 0))
            found = np.flatnonzero(earliest < none)
            code[found] = self._codes[earliest[found] % len(self._codes)]
        return code

    @cached_property
    def _frames(self) -> tuple[tuple[str, slice], ...]:
        return tuple((name, self.columns[name]) for name in ("satellite", "target") if name in self.columns)

    @cached_property
    def _first_pair(self) -> dict[str, int]:
        """Places in `_pairs` at which those with each body begin."""
        each = self.arms * len(self.shape.link)
        with_target = 0 if self.shape.half is None else each
        return {"satellite": 0, "target": with_target, "arms": with_target + each}

    @cached_property
    def grips(self) -> NDArray[np.int64]:
        """Places among all gaps of those that close when the target is grappled."""
        first, size = self._first_pair["target"], len(self.shape.link)
        near = np.flatnonzero(np.array(self.shape.target) == 0.0)
        return first + (size * np.arange(self.arms)[:, None] + near).ravel()

    @cached_property
    def _satellite_reach(self) -> Array:
        return 2.0 * (np.array(self.shape.satellite)[:, None] + self.shape.half)

    @cached_property
    def _target_reach(self) -> Array:
        return 2.0 * np.array(self.shape.target)[:, None]

    def target_half(self, sensors: Array) -> Array:
        """Half sides (N, 3) of the target's box, m."""
        return np.abs(sensors[:, self.columns["half_width"]]).max(axis=1, keepdims=True) * self.shape.body

    def refuse(self, gaps: Array) -> None:
        """Refuse starts (K) with which something is touched, from gaps (K, M) of `all_gaps`.

        Raises:
            GoalError: naming what touches what, and the gap.
        """
        if (gaps <= 0.0).any():
            row, pair = np.unravel_index(gaps.argmin(), gaps.shape)
            raise GoalError(
                f"the episode would begin with a collision: between {self._pairs[pair]} there is a gap of "
                f"{gaps[row, pair]:.3f} m"
            )

    # For joint angles ------------------------------------------------------------------------------------

    def points(self, robot: FloatingRobot, q: Array) -> Array:
        """Points (..., A, P, 3) of the arms in the satellite's frame for joint angles q (..., n) rad, m."""
        k = robot.kinematics(q)
        turned = (k.rotation[..., self.carrier, :, :] @ self.place[..., None])[..., 0]
        return k.position[..., self.carrier, :] + turned

    def all_gaps(
        self, points: Array, in_target: Array | None = None, half: Array | None = None, **how: bool
    ) -> Array:
        """All gaps (K, M) there are, m, in the order in which pairs are looked at.

        Args:
            points, in_target: (K, A, P, 3) m, in the satellite's and in the target's frame.
            half, how: as in `target_gaps`.
        """
        found = [] if self.shape.half is None else [self.satellite_gaps(points)]
        if in_target is not None and half is not None:
            found.append(self.target_gaps(in_target, half, **how))
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
            gripper: whether the gripper may be at the target, so that only its centre line counts.
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
        """The gap (K, V) of one pair in each row, m, under V variations of where everything is.

        Args:
            pair: (K,) places in the order of `all_gaps`. points, in_target: (K, V, A, P, 3) m, in the
                satellite's and in the target's frame. half: (K, 3) m, half sides of the target.
        """
        size, start = len(self.shape.link), self._first_pair
        boxes = [("target", in_target, half, self.shape.target)]
        if self.shape.half is not None:
            boxes.append(("satellite", points, np.full_like(half, self.shape.half), self.shape.satellite))
        gaps = np.empty(points.shape[:2])
        for name, seen, sides, radius in boxes:
            rows = np.flatnonzero((pair >= start[name]) & (pair < start[name] + self.arms * size))
            arm, link = np.divmod(pair[rows] - start[name], size)
            begin, end = seen[rows, :, arm, link], seen[rows, :, arm, link + 1]
            gaps[rows] = box_distance(begin, end, sides[rows, None]) - np.array(radius)[link, None]
        rows = np.flatnonzero(pair >= start["arms"])
        one, other = np.divmod(pair[rows] - start["arms"], size)
        ends = [points[rows, :, arm, link + end] for arm, link in ((0, one), (1, other)) for end in (0, 1)]
        gaps[rows] = segment_distance(*ends) - 2.0 * self.shape.radius
        return gaps
