"""Parts of every capture task: named observations, the capture envelope and its errors, goals, splits."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.errors import positive, unknown_name

SPLITS = ("train", "validation", "test", "ood")
DIFFICULTIES = ("easy", "medium", "hard")
REWARDS = ("dense", "sparse")
LARGEST_TOLERANCE = 1e4  # of a capture, in any unit: larger values are no limits
UNIT = 1.000001  # bound on the components of unit vectors and quaternions, with room for rounding


class Field(NamedTuple):
    """One named part of the observation: its width, bound on every component, and meaning with unit."""

    name: str
    size: int
    bound: float
    meaning: str


# Of the episode so far, in the layout of every task. The peak counts every step of the simulation.
EPISODE_FIELDS = (
    Field("peak_attitude", 1, 100.0, "largest angle of the satellite from its initial attitude so far, rad"),
    Field("time", 1, 1e4, "since the start of the episode, s"),
)


@dataclass(frozen=True)
class ObservationLayout:
    """Layout of the observation vector: a slice for each named quantity."""

    fields: tuple[Field, ...]

    @cached_property
    def slices(self) -> dict[str, slice]:
        """Slice of each field by name, in order."""
        ends = np.cumsum([field.size for field in self.fields]).tolist()
        return {
            field.name: slice(end - field.size, end) for field, end in zip(self.fields, ends, strict=True)
        }

    @cached_property
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


class CaptureLimits(NamedTuple):
    """Limits of a capture: position m, orientation rad, linear velocity m/s, angular velocity rad/s."""

    position: float
    orientation: float
    linear_velocity: float
    angular_velocity: float


class CaptureErrors(NamedTuple):
    """Capture errors (N,) of the arm farther from a capture; zero where the task has no limit.

    Attributes:
        position: distance to the grapple, m. orientation: angle to the grapple, rad.
        linear_velocity, angular_velocity: relative speeds, m/s and rad/s.
        base_speed: root of the integrand of eq. 20 of shyam2020, sqrt(c^2 w.w + v.v) of the satellite, m/s.
    """

    position: Array
    orientation: Array
    linear_velocity: Array
    angular_velocity: Array
    base_speed: Array

    def within(self, limits: CaptureLimits) -> NDArray[np.bool_]:
        """Whether all errors of the end-effector are within the limits, (N,) bool."""
        inside = self.position <= limits.position
        inside &= self.orientation <= limits.orientation
        inside &= self.linear_velocity <= limits.linear_velocity
        inside &= self.angular_velocity <= limits.angular_velocity
        return inside


@dataclass(frozen=True)
class CaptureEnvelope:
    """Limits of a capture: distance, angle and speeds of an end-effector to its grapple, and hold time.

    A task's own envelope adds its limits and overrides `limits`.
    """

    position: float = 0.05  # m
    linear_velocity: float = 0.05  # m/s
    hold: float = 1.0  # s

    def __post_init__(self) -> None:
        for name, value in tuple(vars(self).items()):
            number = positive(f"capture envelope: {name}", value, LARGEST_TOLERANCE)
            object.__setattr__(self, name, number)

    @property
    def limits(self) -> CaptureLimits:
        """Largest errors of a capture; infinite where the task has no limit."""
        return CaptureLimits(self.position, np.inf, self.linear_velocity, np.inf)


@dataclass(frozen=True)
class Goals:
    """Goals of K episodes; subclasses add the pose or target to be captured.

    Attributes:
        mass_scale: (K,) factor on the satellite's mass and inertia; 1 but in the ood split.
        joint_position: (K, n) rad at the start.
    """

    mass_scale: Array
    joint_position: Array

    def take(self, rows: NDArray[np.int64]) -> Self:
        """The goals of rows (k,)."""
        return type(self)(**{name: getattr(self, name)[rows] for name in self.__dataclass_fields__})


@dataclass(frozen=True)
class GoalOption:
    """Option of `reset` that is part of a goal: its size and its default.

    Attributes:
        width: number of components. default: value if omitted; None if it is required.
        largest: absolute value of each component, which keeps its observation in bounds.
        parts: shape in words, for error messages; empty if the width is enough.
    """

    width: int
    default: tuple[float, ...] | None = None
    largest: float = 10.0
    parts: str = ""
