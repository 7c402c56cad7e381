"""Contacts of links with other bodies, by distance, from the sensors of the simulation.

Nothing has contact forces: an episode with a contact ends as a collision.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.capsules import box_distance, segment_distance
from space_envs.dynamics.rotations import Array
from space_envs.robots.gaps import ArmGaps, Capsules

SHARES = np.linspace(0.0, 1.0, 9)  # of a control period, at which links are checked
_ROOT_3 = 3.0**0.5  # largest length of a vector whose components are at most 1


class _Course(NamedTuple):
    """Capsules (N, S) of the arms in a period, in a body's frame, m.

    Attributes:
        capsules: S of them. first, second: (N, S, 3) their ends at the end of the period.
        step: (N, P, 3) displacements of all points in the period.
        middle, span: (N, S, 3) twice the middles and half widths of their bounding boxes.
        move: (N,) upper bound on the displacement of any point.
    """

    capsules: Capsules
    first: Array
    second: Array
    step: Array
    middle: Array
    span: Array
    move: Array

    @classmethod
    def of(cls, capsules: Capsules, before: Array, after: Array) -> "_Course":
        """From points (N, P, 3) at the two ends of the period."""
        step = after - before
        first, second = after.take(capsules.start, axis=1), after.take(capsules.end, axis=1)
        move = _ROOT_3 * np.abs(step).max(axis=(1, 2))
        return cls(capsules, first, second, step, first + second, np.abs(second - first), move)

    def at_shares(self, row: NDArray[np.int64], number: NDArray[np.int64]) -> tuple[Array, Array]:
        """Ends (k, T, 3) of capsules at `SHARES` of the period; their points are assumed to move straight.

        Args:
            row, number: (k,) of each capsule.
        """
        remaining = (1.0 - SHARES)[:, None]
        ends = (self.first, self.capsules.start), (self.second, self.capsules.end)
        first, second = (
            points[row, number][:, None] - remaining * self.step[row, place[number]][:, None]
            for points, place in ends
        )
        return first, second


class _Hits(NamedTuple):
    """Pairs (k,) that are close: row, place in `ArmGaps.pairs`, and (k, T) whether they touch."""

    row: NDArray[np.int64]
    pair: NDArray[np.int64]
    touching: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class Contacts(ArmGaps):
    """Contacts of the arms in a control period, with each other, the satellite and the target."""

    @cached_property
    def _codes(self) -> NDArray[np.int64]:
        return np.array([self.names.index(pair) for pair in self.pairs])

    def touched(self, before: Array, sensors: Array) -> NDArray[np.int64]:
        """Codes (N,) of the first contact in a control period, 0 for none.

        Within the period the points of the arms are assumed to move straight, and are checked nine times: an
        overlap that is not detected is less deep than a sixteenth of their displacement.

        Args:
            before, sensors: (N, s) of the model at the beginning and at the end of the period.
        """
        # Runs at every step, also for N = 1: the number of numpy calls decides the time. Capsules whose
        # bounding boxes, enlarged by their displacement, are apart need no closer check.
        n = len(sensors)
        hits: list[_Hits] = []
        for frame, columns, capsules in self._frames:
            course = _Course.of(
                capsules, before[:, columns].reshape(n, -1, 3), sensors[:, columns].reshape(n, -1, 3)
            )
            if frame == "satellite":
                middle = course.middle if self._twice_centre is None else course.middle - self._twice_centre
                gap = np.abs(middle) - course.span - self._satellite_reach
                hits += self._box_hits(course, gap, "satellite", None)
            else:
                half = self.target_half(sensors)
                gap = np.abs(course.middle) - course.span - self._target_reach - 2.0 * half[:, None]
                hits += self._box_hits(course, gap, "target", half)
                if self.arms == 2:
                    hits += self._arm_hits(course)
        return self._first(n, hits)

    def _box_hits(self, course: _Course, gap: Array, body: str, half: Array | None) -> list[_Hits]:
        """Capsules that touch a box; gap (N, S, 3) is twice that of the bounding boxes."""
        near = gap.max(axis=-1) <= (2.0 * course.move)[:, None]
        if not near.any():
            return []
        row, number = np.nonzero(near)
        sides = np.broadcast_to(self.satellite_half, (len(near), 3)) if half is None else half
        radius = course.capsules.satellite if body == "satellite" else course.capsules.target
        in_box = self.in_box if body == "satellite" else lambda points: points
        ends = in_box(course.first[row, number]), in_box(course.second[row, number])
        close = box_distance(*ends, sides[row]) <= radius[number] + course.move[row]
        row, number = row[close], number[close]
        first, second = course.at_shares(row, number)
        distance = box_distance(in_box(first), in_box(second), sides[row][:, None])
        touching = distance <= radius[number][:, None]
        return [_Hits(row, self.first_pair[body] + number, touching)]

    def _arm_hits(self, course: _Course) -> list[_Hits]:
        """Capsules of arm 1 that touch capsules of arm 2."""
        split, move, reach = course.capsules.split, 2.0 * course.move, self.arm_reach
        each = np.array([0, split])
        low = np.minimum.reduceat(course.middle - course.span, each, axis=1)
        high = np.maximum.reduceat(course.middle + course.span, each, axis=1)
        apart = np.maximum(low[:, 0] - high[:, 1], low[:, 1] - high[:, 0]).max(axis=1)
        rows = np.flatnonzero(apart <= 2.0 * (reach.max() + move))
        if not len(rows):
            return []
        middle, span = course.middle[rows], course.span[rows]
        gap = np.abs(middle[:, :split, None] - middle[:, None, split:])
        gap -= span[:, :split, None]
        gap -= span[:, None, split:]
        place, one, other = np.nonzero(gap.max(axis=-1) <= 2.0 * (reach + move[rows, None, None]))
        row, second = rows[place], split + other
        ends = [(course.first[row, number], course.second[row, number]) for number in (one, second)]
        near = segment_distance(*ends[0], *ends[1]) <= reach[one, other] + move[row]
        row, one, other, second = row[near], one[near], other[near], second[near]
        paths = *course.at_shares(row, one), *course.at_shares(row, second)
        touching = segment_distance(*paths) <= reach[one, other][:, None]
        return [_Hits(row, self.first_pair["arms"] + one * reach.shape[1] + other, touching)]

    def _first(self, n: int, hits: list[_Hits]) -> NDArray[np.int64]:
        """Codes (N,) of the first contact; of simultaneous ones, the first in the order of `pairs`."""
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
    def _frames(self) -> tuple[tuple[str, slice, Capsules], ...]:
        """Frames in which capsules are checked, the sensors of the points in them, and the capsules."""
        near = {"satellite": self.near_satellite, "target": self.near_others}
        return tuple((name, self.columns[name], some) for name, some in near.items() if name in self.columns)

    @cached_property
    def _twice_centre(self) -> Array | None:
        return None if self.satellite_centre is None else 2.0 * self.satellite_centre

    @cached_property
    def _satellite_reach(self) -> Array:
        return 2.0 * (self.near_satellite.satellite[:, None] + self.satellite_half)

    @cached_property
    def _target_reach(self) -> Array:
        return 2.0 * self.near_others.target[:, None]

    def target_half(self, sensors: Array) -> Array:
        """Half sides (N, 3) of the target's box, m."""
        seen = np.abs(sensors[:, self.columns["half_width"]]).max(axis=1, keepdims=True)
        return seen * self.target_shape
