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
from space_envs.tasks.gaps import ArmGaps

SHARES = np.linspace(0.0, 1.0, 9)  # of a control period, at which links are checked
_ROOT_3 = 3.0**0.5  # largest length of a vector whose components are at most 1


class _Course(NamedTuple):
    """Capsules (N, A, S) of the arms in a period, in a body's frame, m.

    Attributes:
        first, second: (N, A, S, 3) ends of the capsules at the end of the period. step: (N, A, S + 1, 3)
            displacements of the points in the period.
        middle, span: (N, A, S, 3) twice the middles and half widths of their bounding boxes.
        move: (N,) upper bound on the displacement of any point.
    """

    first: Array
    second: Array
    step: Array
    middle: Array
    span: Array
    move: Array

    @classmethod
    def of(cls, before: Array, after: Array) -> "_Course":
        """From points (N, A, S + 1, 3) at the two ends of the period."""
        step = after - before
        first, second = after[:, :, :-1], after[:, :, 1:]
        move = _ROOT_3 * np.abs(step).max(axis=(1, 2, 3))
        return cls(first, second, step, first + second, np.abs(second - first), move)

    def at_shares(self, place: tuple[NDArray[np.int64], ...]) -> tuple[Array, Array]:
        """Ends (k, T, 3) of capsules at `SHARES` of the period; their points are assumed to move straight.

        Args:
            place: row, arm and number (k,) of each capsule.
        """
        row, arm, number = place
        remaining = (1.0 - SHARES)[:, None]
        return (
            self.first[place][:, None] - remaining * self.step[place][:, None],
            self.second[place][:, None] - remaining * self.step[row, arm, number + 1][:, None],
        )


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
        distance = box_distance(course.first[place], course.second[place], sides[place[0]])
        place = tuple(part[distance <= radius[place[2]] + course.move[place[0]]] for part in place)
        row, arm, number = place
        touching = box_distance(*course.at_shares(place), sides[row][:, None]) <= radius[number][:, None]
        return [_Hits(row, self.first_pair[body] + arm * len(self.shape.link) + number, touching)]

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
        ends = [(course.first[row, arm, n], course.second[row, arm, n]) for arm, n in ((0, one), (1, other))]
        near = segment_distance(*ends[0], *ends[1]) <= reach + move[row]
        row, one, other = row[near], one[near], other[near]
        first, second = np.zeros_like(row), np.ones_like(row)
        paths = *course.at_shares((row, first, one)), *course.at_shares((row, second, other))
        touching = segment_distance(*paths) <= reach
        return [_Hits(row, self.first_pair["arms"] + one * len(self.shape.link) + other, touching)]

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
    def _frames(self) -> tuple[tuple[str, slice], ...]:
        return tuple((name, self.columns[name]) for name in ("satellite", "target") if name in self.columns)

    @cached_property
    def _satellite_reach(self) -> Array:
        return 2.0 * (np.array(self.shape.satellite)[:, None] + self.shape.half)

    @cached_property
    def _target_reach(self) -> Array:
        return 2.0 * np.array(self.shape.target)[:, None]

    def target_half(self, sensors: Array) -> Array:
        """Half sides (N, 3) of the target's box, m."""
        return np.abs(sensors[:, self.columns["half_width"]]).max(axis=1, keepdims=True) * self.shape.body
