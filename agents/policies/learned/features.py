"""Inputs of a network: a fixed, normalised view, computed from the observation alone.

Errors and velocities are expressed in the satellite's axes, where the arm's kinematics do not depend on the
satellite's attitude, so that a network need not learn to rotate vectors. Every entry is divided by a stated
scale; there are no running statistics, so a policy file needs none.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array, conjugate, logarithm, rotate
from space_envs.errors import ConfigurationError, positive, shown, unknown_name
from space_envs.tasks.common import ObservationLayout

IN_BASE_AXES = ("base_axes", "from_base", "bearing", "root")
_TINY = 1e-9  # m or rad
KINDS = ("plain", "from_home", "rotation", *IN_BASE_AXES)


class Feature(NamedTuple):
    """One part of what a network sees.

    Attributes:
        field: of the observation layout.
        kind: plain (x / scale), from_home (minus the home joint angles), rotation (rotation vector of a
            quaternion), base_axes (in the satellite's axes), from_base (a position relative to the
            satellite, in its axes), bearing (x / (scale + |x|) in the satellite's axes: large near the goal,
            where a plain error is lost among larger inputs), root (x / sqrt(scale |x|) in the satellite's
            axes: motions that bring the base back grow like it). A field may hold a vector for each of
            several end-effectors.
        scale: what becomes 1, in the field's unit.
    """

    field: str
    kind: str
    scale: float


@dataclass(frozen=True, eq=False)
class FeatureView:
    """Maps observations (N, size) to features (N, F), float32.

    Attributes:
        table: the features, in order.
        layout: of the observations.
        home: (n,) rad, subtracted from joint angles.
    """

    table: tuple[Feature, ...]
    layout: ObservationLayout
    home: Array

    def __post_init__(self) -> None:
        for field, kind, _ in self.table:
            if field not in self.layout.slices:
                raise unknown_name("observation field", field, self.layout.slices)
            if kind == "from_home" and self._width(field) != len(self.home):
                raise ConfigurationError(
                    f"home has {len(self.home)} joint angles, {field} of the observation {self._width(field)}"
                )
            if kind == "rotation" and self._width(field) != 4:
                raise ConfigurationError(f"feature rotation of {field}: expected a quaternion, w x y z")
            if kind in IN_BASE_AXES and not has_base_axes(self.layout, field, kind):
                raise ConfigurationError(
                    f"feature {kind} of {field}: the observation has no base to relate it to"
                )

    @property
    def size(self) -> int:
        """F."""
        return sum(3 if kind == "rotation" else self._width(field) for field, kind, _ in self.table)

    def __call__(self, observation: NDArray) -> NDArray[np.float32]:
        """Features (N, F) of observations (N, size)."""
        parts = [self._part(observation, *feature) for feature in self.table]
        return np.concatenate(parts, axis=-1).astype(np.float32)

    def _width(self, field: str) -> int:
        place = self.layout.slices[field]
        return place.stop - place.start

    def _part(self, observation: NDArray, field: str, kind: str, scale: float) -> Array:
        """One feature (N, k) of observations (N, size)."""
        value = self.layout.read(observation, field)
        if kind == "from_home":
            value = value - self.home
        elif kind == "rotation":
            value = logarithm(value)
        elif kind in IN_BASE_AXES:
            return self._in_base_axes(observation, value, kind, scale)
        return value / scale

    def _in_base_axes(self, observation: NDArray, value: NDArray, kind: str, scale: float) -> Array:
        """Vectors (N, k) of each end-effector in the satellite's axes, scaled."""
        axes = _axes(self.layout)
        vectors = value.reshape(len(value), value.shape[1] // axes, axes)
        if kind == "from_base":
            vectors = vectors - self.layout.read(observation, "base_position")[:, None]
        if axes == 2:
            vectors = _rotated_in_plane(vectors, self.layout.read(observation, "base_angle"))
        else:
            vectors = rotate(conjugate(self.layout.read(observation, "base_quaternion"))[:, None], vectors)
        if kind not in ("bearing", "root"):
            return vectors.reshape(value.shape) / scale
        length = np.sqrt((vectors * vectors).sum(axis=-1, keepdims=True))
        divisor = scale + length if kind == "bearing" else np.sqrt(scale * length) + _TINY
        return (vectors / divisor).reshape(value.shape)


def has_base_axes(layout: ObservationLayout, field: str, kind: str) -> bool:
    """Whether a field holds vectors that a kind of feature can express in the satellite's axes."""
    needed = ["base_angle" if _axes(layout) == 2 else "base_quaternion"]
    needed += ["base_position"] if kind == "from_base" else []
    place = layout.slices[field]
    return all(name in layout.slices for name in needed) and (place.stop - place.start) % _axes(layout) == 0


def _axes(layout: ObservationLayout) -> int:
    """2 in the plane, where the attitude is an angle, 3 in space."""
    return 2 if "base_angle" in layout.slices else 3


def _rotated_in_plane(vectors: Array, angle: Array) -> Array:
    """Vectors (N, k, 2) of inertial axes in the axes of bodies at angles (N, 1), rad."""
    cosine, sine = np.cos(angle), np.sin(angle)
    x, y = vectors[..., 0], vectors[..., 1]
    return np.stack([cosine * x + sine * y, cosine * y - sine * x], axis=-1)


def feature_table(rows: Sequence[Any]) -> tuple[Feature, ...]:
    """Features from rows [field, kind, scale], as files hold them, or texts FIELD:KIND:SCALE.

    Raises:
        ConfigurationError: for rows that are not of that form, and unknown kinds.
    """
    return tuple(map(_feature, rows))


def _feature(row: Any) -> Feature:
    parts = row.split(":") if isinstance(row, str) else row
    whole = isinstance(parts, list | tuple) and len(parts) == 3
    if not whole or not isinstance(parts[0], str) or not isinstance(parts[1], str):
        expected = "[field, kind, scale] or FIELD:KIND:SCALE"
        raise ConfigurationError(f"a feature must be {expected}, got {shown(row)}")
    field, kind, scale = parts
    if kind not in KINDS:
        raise unknown_name("kind of feature", kind, KINDS)
    return Feature(field, kind, positive(f"scale of feature {field}", _number(scale)))


def _number(value: Any) -> Any:
    """The number that a text is; anything else as it is."""
    try:
        return float(value) if isinstance(value, str) else value
    except ValueError:
        return value
