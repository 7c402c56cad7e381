"""SpaceCapture/DualArmSpatial: two 7-DoF arms capture a tumbling satellite at its fixtures."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np

from space_envs.dynamics.reactionless import axis_rotation
from space_envs.dynamics.rotations import Array, exponential
from space_envs.robots.models import joint_names
from space_envs.tasks.common import (
    EPISODE_FIELDS,
    UNIT,
    CaptureEnvelope,
    CaptureLimits,
    Field,
    GoalOption,
    ObservationLayout,
)
from space_envs.tasks.dual_arm import FASTEST_SPIN
from space_envs.tasks.goals.targets import Draws, TargetGoals
from space_envs.tasks.goals.tumbling import TumblingTargetTask
from space_envs.tasks.robots import length_factor

_ALL = slice(0, None)
_MEASURED = (
    "satellite_position",
    "satellite_quaternion",
    "satellite_linear_velocity",
    "satellite_angular_velocity",
    "end_effector1_position",
    "end_effector2_position",
    "end_effector1_linear_velocity",
    "end_effector2_linear_velocity",
    "end_effector1_axis",
    "end_effector2_axis",
    "target_position",
    "target_quaternion",
    "target_angular_velocity",
    "grapple1_position",
    "grapple2_position",
    "grapple1_linear_velocity",
    "grapple2_linear_velocity",
    "grapple1_axis",
    "grapple2_axis",
)


@lru_cache(maxsize=16)
def spatial_layout(joints: int, factor: float = 1.0) -> ObservationLayout:
    """Observation of two arms in space with a number of joints together.

    Args:
        factor: on the bounds of positions.
    """
    return ObservationLayout(
        (
            Field("joint_position", joints, 20.0, "joint angles, arm 1 first, rad"),
            Field("joint_velocity", joints, 100.0, "joint rates, rad/s"),
            Field("base_position", 3, 10.0 * factor, "satellite's centre of mass, inertial frame, m"),
            Field("base_quaternion", 4, UNIT, "satellite's attitude, w x y z, body to inertial"),
            Field("base_linear_velocity", 3, 100.0, "of the satellite's centre of mass, inertial axes, m/s"),
            Field("base_angular_velocity", 3, 100.0, "of the satellite, inertial axes, rad/s"),
            Field("end_effector_position", 6, 20.0 * factor, "of arm 1, then arm 2, inertial frame, m"),
            Field("end_effector_linear_velocity", 6, 100.0, "of arm 1, then arm 2, inertial axes, m/s"),
            Field("end_effector_axis", 6, UNIT, "approach axes of arm 1, then arm 2, inertial axes, unit"),
            Field("target_position", 3, 10.0 * factor, "target's centre, inertial frame, m"),
            Field("target_quaternion", 4, UNIT, "target's attitude, w x y z; the fixtures lie on its x axis"),
            Field("target_angular_velocity", 3, 10.0, "of the target, inertial axes, rad/s"),
            Field("goal_position", 6, 10.0 * factor, "fixtures of arm 1, then arm 2, inertial frame, m"),
            Field("goal_linear_velocity", 6, 100.0, "of the fixtures, inertial axes, m/s"),
            Field("goal_axis", 6, UNIT, "insertion axes of the fixtures, inertial axes, unit"),
            Field("position_error", 6, 30.0 * factor, "fixtures minus end-effectors, inertial axes, m"),
            Field("velocity_error", 6, 200.0, "of the fixtures minus of the end-effectors, m/s"),
            Field("axis_error", 6, 3.1416, "rotations from approach to insertion axes, inertial axes, rad"),
            *EPISODE_FIELDS,
        )
    )


class _Blocks(NamedTuple):
    """Parts of an observation: positions and velocities of the grapple points and of the end-effectors, their
    differences, and axes."""

    goal: slice
    hand: slice
    errors: slice
    axis: slice
    goal_axis: slice
    axis_error: slice


@dataclass(frozen=True)
class ApproachEnvelope(CaptureEnvelope):
    """Capture envelope with limits on position, velocity and approach direction."""

    approach: float = 5.0  # deg

    @property
    def limits(self) -> CaptureLimits:
        """Largest errors of a capture; infinite where the task has no limit."""
        return CaptureLimits(self.position, float(np.deg2rad(self.approach)), self.linear_velocity, np.inf)


@dataclass(frozen=True)
class DualArmSpatialTask(TumblingTargetTask):
    """Two arms on a satellite capture a tumbling satellite without rotating their own."""

    horizon: int = 300
    envelope: CaptureEnvelope = field(default_factory=ApproachEnvelope)

    own_robot = frozen_robot = "spatial_dual_arm"
    kind = "spatial"
    draws = Draws(
        reach=2.3,
        displacement=(0.08, 0.15, 0.2),
        rotation=(0.2, 0.35, 0.5),
        spin=tuple(np.deg2rad([0.5, 1.0, 2.0]).tolist()),
        start=(0.05, 0.1, 0.15),
        half_width=(0.25, 0.35),
    )
    approach_axes = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    outward = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    seeds = {"train": 20_401, "validation": 20_402, "test": 20_403, "ood": 20_404}

    @cached_property
    def layout(self) -> ObservationLayout:
        """Layout of the observation vector."""
        return spatial_layout(self.robot.n_joints, length_factor(self.robot))

    @property
    def measured(self) -> tuple[tuple[str, slice], ...]:
        """Sensors with the components that are observed, in the order of the layout."""
        joints = joint_names(self.robot)
        names = [f"{joint}_{quantity}" for quantity in ("position", "velocity") for joint in joints]
        return tuple((name, _ALL) for name in (*names, *_MEASURED))

    @property
    def goal_options(self) -> dict[str, GoalOption]:
        """Options of `reset` that together define a goal."""
        return {
            "target_position": GoalOption(3, largest=10.0 * length_factor(self.robot)),
            "target_quaternion": GoalOption(4, (1.0, 0.0, 0.0, 0.0)),
            "target_angular_velocity": GoalOption(3, (0.0, 0.0, 0.0), FASTEST_SPIN),
            "target_half_width": GoalOption(1, (self.target.half_width,)),
        }

    def draw_attitude(self, rng: np.random.Generator, largest: float) -> Array:
        """Draw an attitude (4,) of the target at the rendezvous."""
        return exponential(_direction(rng) * rng.uniform(0.0, largest))

    def draw_angular_velocity(self, rng: np.random.Generator, least: float, largest: float) -> Array:
        """Draw an angular velocity (3,) of the target at the rendezvous, rad/s."""
        return _direction(rng) * rng.uniform(least, largest)

    def given_goals(self, values: Mapping[str, Array], joint_position: Array | None) -> TargetGoals:
        """Goals from the values of `goal_options`; errors as in `checked_goals`."""
        return self.checked_goals(
            values["target_position"],
            values["target_quaternion"],
            values["target_angular_velocity"],
            values["target_half_width"][:, 0],
            joint_position,
        )

    def observe(self, sensors: Array, time: Array, peak_attitude: Array) -> Array:
        """Observations (N, size); see the base class."""
        n, at = len(sensors), self._blocks
        observation = np.empty((n, self.layout.size))
        observation[:, : len(self.columns)] = sensors.take(self.columns, axis=1)
        np.subtract(observation[:, at.goal], observation[:, at.hand], out=observation[:, at.errors])
        axes, goal_axes = (observation[:, part].reshape(n, 2, 3) for part in (at.axis, at.goal_axis))
        observation[:, at.axis_error] = axis_rotation(axes, goal_axes).reshape(n, 6)
        observation[:, -2], observation[:, -1] = peak_attitude, time
        return observation

    @cached_property
    def _blocks(self) -> _Blocks:
        at = self.layout.slices
        return _Blocks(
            slice(at["goal_position"].start, at["goal_linear_velocity"].stop),
            slice(at["end_effector_position"].start, at["end_effector_linear_velocity"].stop),
            slice(at["position_error"].start, at["velocity_error"].stop),
            *(at[name] for name in ("end_effector_axis", "goal_axis", "axis_error")),
        )


def _direction(rng: np.random.Generator) -> Array:
    vector = rng.standard_normal(3)
    return vector / np.sqrt(vector @ vector)
