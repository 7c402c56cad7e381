"""What a network sees of an observation: a fixed, normalised view, computed from the observation alone.

Errors and velocities are turned into the satellite's axes, where the arm's kinematics do not depend on the
satellite's attitude, so that a network need not learn to rotate vectors. Every entry is divided by a stated
scale; there are no running statistics, so a policy file needs none.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array, conjugate, logarithm, rotate
from space_envs.errors import ConfigurationError, positive, unknown_name
from space_envs.tasks.common import ObservationLayout

KINDS = ("plain", "from_home", "rotation", "base_axes", "from_base", "bearing")


class Feature(NamedTuple):
    """One part of what a network sees.

    Attributes:
        field: of the observation layout.
        kind: plain (x / scale), from_home (minus the home joint angles), rotation (rotation vector of a
            quaternion), base_axes (in the satellite's axes), from_base (a position relative to the
            satellite, in its axes), bearing (x / (scale + |x|) in the satellite's axes: large near the goal,
            where a plain error is lost among larger inputs). A field may hold a vector for each of several
            end-effectors.
        scale: what becomes 1, in the field's unit.
    """

    field: str
    kind: str
    scale: float


SINGLE_ARM_FEATURES = (
    Feature("joint_position", "from_home", 0.5),
    Feature("joint_velocity", "plain", 0.2),
    Feature("base_quaternion", "rotation", 0.1),
    Feature("base_linear_velocity", "base_axes", 0.05),
    Feature("base_angular_velocity", "base_axes", 0.05),
    Feature("end_effector_position", "from_base", 1.0),
    Feature("end_effector_linear_velocity", "base_axes", 0.2),
    Feature("end_effector_angular_velocity", "base_axes", 0.2),
    Feature("position_error", "base_axes", 0.5),
    Feature("rotation_error", "base_axes", 0.5),
    Feature("position_error", "bearing", 0.1),
    Feature("rotation_error", "bearing", 0.2),
)
CLUTTERED_FEATURES = (
    *SINGLE_ARM_FEATURES,
    Feature("obstacle_position", "from_base", 1.0),
    Feature("obstacle_radius", "plain", 0.3),
)
DUAL_PLANAR_FEATURES = (
    Feature("joint_position", "from_home", 0.5),
    Feature("joint_velocity", "plain", 0.2),
    Feature("base_angle", "plain", 0.02),
    Feature("base_linear_velocity", "base_axes", 0.02),
    Feature("base_angular_velocity", "plain", 0.02),
    Feature("end_effector_position", "from_base", 1.0),
    Feature("end_effector_linear_velocity", "base_axes", 0.2),
    Feature("goal_linear_velocity", "base_axes", 0.02),
    Feature("position_error", "base_axes", 0.5),
    Feature("position_error", "bearing", 0.1),
    Feature("velocity_error", "base_axes", 0.1),
)
DUAL_SPATIAL_FEATURES = (
    Feature("joint_position", "from_home", 0.5),
    Feature("joint_velocity", "plain", 0.2),
    Feature("base_quaternion", "rotation", 0.02),
    Feature("base_linear_velocity", "base_axes", 0.02),
    Feature("base_angular_velocity", "base_axes", 0.02),
    Feature("end_effector_position", "from_base", 0.5),
    Feature("end_effector_linear_velocity", "base_axes", 0.2),
    Feature("goal_linear_velocity", "base_axes", 0.02),
    Feature("goal_axis", "base_axes", 1.0),
    Feature("position_error", "base_axes", 0.3),
    Feature("position_error", "bearing", 0.1),
    Feature("axis_error", "base_axes", 0.3),
    Feature("axis_error", "bearing", 0.1),
    Feature("velocity_error", "base_axes", 0.1),
)


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
        for feature in self.table:
            if feature.kind not in KINDS:
                raise unknown_name("kind of feature", feature.kind, KINDS)
            if feature.field not in self.layout.slices:
                raise unknown_name("observation field", feature.field, self.layout.slices)
            if not feature.scale > 0:
                raise ConfigurationError(
                    f"scale of feature {feature.field} must be positive, got {feature.scale!r}"
                )

    @property
    def size(self) -> int:
        """F."""
        width = {field.name: field.size for field in self.layout.fields}
        return sum(3 if f.kind == "rotation" else width[f.field] for f in self.table)

    def __call__(self, observation: NDArray) -> NDArray[np.float32]:
        """Features (N, F) of observations (N, size)."""
        layout = self.layout
        planar = "base_angle" in layout.slices
        axes = 2 if planar else 3
        to_base = _turn(layout.read(observation, "base_angle" if planar else "base_quaternion"))
        parts: list[Array] = []
        for field, kind, scale in self.table:
            value = layout.read(observation, field)
            if kind == "from_home":
                value = value - self.home
            elif kind == "rotation":
                value = logarithm(value)
            elif kind != "plain":
                value = value.reshape(len(value), value.shape[1] // axes, axes)  # one vector an end-effector
                if kind == "from_base":
                    value = value - layout.read(observation, "base_position")[:, None]
                value = to_base(value)
                if kind == "bearing":
                    value = value / (scale + np.sqrt((value * value).sum(axis=-1, keepdims=True)))
                value = value.reshape(len(value), value.shape[1] * value.shape[2])
            parts.append(value if kind == "bearing" else value / scale)
        return np.concatenate(parts, axis=-1).astype(np.float32)


def _turn(attitude: Array) -> Callable[[Array], Array]:
    """What turns vectors (N, k, 3) or, in the plane, (N, k, 2) into the axes of bodies of an attitude."""
    if attitude.shape[1] == 4:
        back = conjugate(attitude)[:, None]
        return lambda vectors: rotate(back, vectors)
    cosine, sine = np.cos(attitude), np.sin(attitude)

    def turned(vectors: Array) -> Array:
        x, y = vectors[..., 0], vectors[..., 1]
        return np.stack([cosine * x + sine * y, cosine * y - sine * x], axis=-1)

    return turned


def feature_table(rows: Sequence[Sequence[object]]) -> tuple[Feature, ...]:
    """Build a table from rows [field, kind, scale], as a policy file holds them.

    Raises:
        ConfigurationError: for rows that are not of that form.
    """
    table = []
    for row in rows:
        whole = isinstance(row, list | tuple) and len(row) == 3
        if not whole or not isinstance(row[0], str) or not isinstance(row[1], str):
            raise ConfigurationError(f"a feature must be [field, kind, scale], got {row!r}")
        table.append(Feature(row[0], row[1], positive(f"scale of feature {row[0]}", row[2])))
    return tuple(table)
