"""Contacts of links with other bodies, by distance, from the sensors of the simulation.

Nothing has contact forces: an episode with a contact ends as a collision.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.robots.contact_checks import ContactChecks
from space_envs.robots.gaps import ArmGaps, Capsules


@dataclass(frozen=True, eq=False)
class Contacts(ArmGaps):
    """Contacts of the arms in a control period, with each other, the satellite and the target."""

    def touched(self, before: Array, sensors: Array) -> NDArray[np.int64]:
        """Codes (N,) of the first contact in a control period, 0 for none.

        Within the period the points of the arms are assumed to move straight, and are checked nine times: an
        overlap that is not detected is less deep than a sixteenth of their displacement.

        Args:
            before, sensors: (N, s) of the model at the beginning and at the end of the period.
        """
        return self._checks.first(before, sensors)

    @cached_property
    def _checks(self) -> ContactChecks:
        near, others, pair, columns = self.near_satellite, self.near_others, self.first_pair, self.columns
        centre = np.zeros(3) if self.satellite_centre is None else self.satellite_centre
        functions = []
        if "satellite" in columns:
            box = near.satellite, centre, self.satellite_half, -1
            functions.append(("box_contacts", (pair["satellite"], *self.placed(near, "satellite"), *box)))
        if "target" in columns:
            box = others.target, np.zeros(3), self.target_shape, columns["half_width"].start
            functions.append(("box_contacts", (pair["target"], *self.placed(others, "target"), *box)))
        if "target" in columns and self.arms == 2:
            reach = others.split, self.arm_reach
            functions.append(("arm_contacts", (pair["arms"], *self.placed(others, "target"), *reach)))
        points = np.concatenate([np.r_[columns[name]] for name in ("satellite", "target") if name in columns])
        codes = np.array([self.names.index(pair) for pair in self.pairs])
        return ContactChecks(functions, self._sensed_gaps, points, codes)

    def placed(self, capsules: Capsules, frame: str) -> tuple[Any, ...]:
        """Arguments of the functions of `contacts.c`: the place of capsules among the sensors."""
        return self.columns[frame].start, len(capsules.arm), capsules.start, capsules.end

    def sensed_points(self, sensors: Array, frame: str) -> Array:
        """Points (N, P, 3) of the arms in a frame, m, from sensors (N, s)."""
        return sensors[:, self.columns[frame]].reshape(len(sensors), -1, 3)

    def _sensed_gaps(self, sensors: Array) -> Array:
        """Gaps (N, M) of all pairs, m, in the order of `pairs`, from sensors (N, s)."""
        found = []
        if "satellite" in self.columns:
            found.append(self.satellite_gaps(self.sensed_points(sensors, "satellite")))
        if "target" in self.columns:
            points = self.sensed_points(sensors, "target")
            found.append(self.target_gaps(points, self.target_half(sensors)))
            if self.arms == 2:
                apart = self.arm_gaps(points)
                found.append(apart.reshape(len(apart), apart.shape[1] * apart.shape[2]))
        return np.concatenate(found, axis=1)

    def target_half(self, sensors: Array) -> Array:
        """Half sides (N, 3) of the target's box, m."""
        seen = np.abs(sensors[:, self.columns["half_width"]]).max(axis=1, keepdims=True)
        return seen * self.target_shape
