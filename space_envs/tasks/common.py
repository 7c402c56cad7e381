"""What all capture tasks share: named observations, the capture envelope, reward weights, splits."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.errors import positive, unknown_name

SPLITS = ("train", "validation", "test", "ood")
DIFFICULTIES = ("easy", "medium", "hard")
REWARDS = ("dense", "sparse")


class Field(NamedTuple):
    """One named part of the observation: its width, bound on every component, and meaning with unit."""

    name: str
    size: int
    bound: float
    meaning: str


@dataclass(frozen=True)
class ObservationLayout:
    """Where each named quantity lies in the observation vector."""

    fields: tuple[Field, ...]

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Slice of each field by name, in order."""
        ends = np.cumsum([field.size for field in self.fields]).tolist()
        return {
            field.name: slice(end - field.size, end) for field, end in zip(self.fields, ends, strict=True)
        }

    @property
    def size(self) -> int:
        """Length of the observation."""
        return sum(field.size for field in self.fields)

    @property
    def bound(self) -> Array:
        """(size,) bound on the absolute value of each component."""
        return np.concatenate([np.full(field.size, field.bound) for field in self.fields])

    def read(self, observation: NDArray, name: str) -> NDArray:
        """View (..., k) of the field `name` in observations (..., size).

        Raises:
            ConfigurationError: if there is no such field; the message names the nearest.
        """
        try:
            return observation[..., self.slices[name]]
        except KeyError:
            raise unknown_name("observation field", name, self.slices) from None

    def sum_of_squares(self, *names: str) -> Array:
        """Matrix (size, k) that maps squared observations to the squared norms of k fields."""
        matrix = np.zeros((self.size, len(names)))
        for column, name in enumerate(names):
            matrix[self.slices[name], column] = 1.0
        return matrix


@dataclass(frozen=True)
class CaptureEnvelope:
    """How close, aligned and slow the end-effector must be to the grapple, and for how long."""

    position: float = 0.05  # m
    orientation: float = 5.0  # deg
    linear_velocity: float = 0.05  # m/s
    angular_velocity: float = 5.0  # deg/s
    hold: float = 1.0  # s

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            positive(f"capture envelope: {name}", value)

    @cached_property
    def limits(self) -> Array:
        """(4,) position m, orientation rad, linear velocity m/s, angular velocity rad/s."""
        return np.array(
            [
                self.position,
                np.deg2rad(self.orientation),
                self.linear_velocity,
                np.deg2rad(self.angular_velocity),
            ]
        )


@dataclass(frozen=True)
class Goals:
    """Goals of K episodes.

    Attributes:
        position: (K, 3) m, grapple position in the inertial frame.
        quaternion: (K, 4) grapple orientation in the inertial frame.
        mass_scale: (K,) factor on the satellite's mass and inertia; 1 but in the ood split.
    """

    position: Array
    quaternion: Array
    mass_scale: Array
