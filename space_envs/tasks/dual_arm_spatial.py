"""SpaceCapture/DualArmSpatial: two 7-DoF arms capture a tumbling satellite at its fixtures."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.reactionless import axis_rotation
from space_envs.dynamics.rotations import Array, exponential, rotation_angle
from space_envs.robots.dual_arm import DualArmOptions, dual_arm_model
from space_envs.robots.parameters import DUAL_ARM_SPATIAL
from space_envs.tasks.common import UNIT, CaptureEnvelope, CaptureLimits, Field, GoalOption, ObservationLayout
from space_envs.tasks.dual_arm import FASTEST_SPIN, sensor_columns
from space_envs.tasks.goals.targets import Draws, TargetGoals
from space_envs.tasks.goals.tumbling import TumblingTargetTask

LAYOUT = ObservationLayout(
    (
        Field("joint_position", 14, 20.0, "joint angles, arm 1 first, rad"),
        Field("joint_velocity", 14, 100.0, "joint rates, rad/s"),
        Field("base_position", 3, 10.0, "satellite's centre of mass, inertial frame, m"),
        Field("base_quaternion", 4, UNIT, "satellite's attitude, w x y z, body to inertial"),
        Field("base_linear_velocity", 3, 100.0, "of the satellite's centre of mass, inertial axes, m/s"),
        Field("base_angular_velocity", 3, 100.0, "of the satellite, inertial axes, rad/s"),
        Field("end_effector_position", 6, 20.0, "of arm 1, then arm 2, inertial frame, m"),
        Field("end_effector_linear_velocity", 6, 100.0, "of arm 1, then arm 2, inertial axes, m/s"),
        Field("end_effector_axis", 6, UNIT, "approach axes of arm 1, then arm 2, inertial axes, unit"),
        Field("target_position", 3, 10.0, "target's centre, inertial frame, m"),
        Field("target_quaternion", 4, UNIT, "target's attitude, w x y z; the fixtures lie on its x axis"),
        Field("target_angular_velocity", 3, 10.0, "of the target, inertial axes, rad/s"),
        Field("goal_position", 6, 10.0, "fixtures of arm 1, then arm 2, inertial frame, m"),
        Field("goal_linear_velocity", 6, 100.0, "of the fixtures, inertial axes, m/s"),
        Field("goal_axis", 6, UNIT, "insertion axes of the fixtures, inertial axes, unit"),
        Field("position_error", 6, 30.0, "fixtures minus end-effectors, inertial axes, m"),
        Field("velocity_error", 6, 200.0, "of the fixtures minus of the end-effectors, m/s"),
        Field("axis_error", 6, 3.1416, "rotations from approach to insertion axes, inertial axes, rad"),
        Field("time", 1, 1e4, "since the start of the episode, s"),
    )
)
_ALL = slice(0, None)
_JOINTS = [f"arm{arm}_joint{number}" for arm in (1, 2) for number in range(1, 8)]
_MEASURED = tuple(
    (name, _ALL)
    for name in (
        *(f"{joint}_position" for joint in _JOINTS),
        *(f"{joint}_velocity" for joint in _JOINTS),
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
)
_COLUMNS = sensor_columns(dual_arm_model(DualArmOptions("spatial")), _MEASURED)
_SLICES = LAYOUT.slices


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
    """Two 7-DoF arms on a 500 kg satellite capture a tumbling satellite without rotating their own."""

    horizon: int = 300
    envelope: CaptureEnvelope = field(default_factory=ApproachEnvelope)

    layout = LAYOUT
    parameters = DUAL_ARM_SPATIAL
    goal_options = {
        "target_position": GoalOption(3),
        "target_quaternion": GoalOption(4, (1.0, 0.0, 0.0, 0.0)),
        "target_angular_velocity": GoalOption(3, (0.0, 0.0, 0.0), FASTEST_SPIN),
        "target_half_width": GoalOption(1, (DUAL_ARM_SPATIAL.target.half_width,)),
    }
    kind = "spatial"
    target = DUAL_ARM_SPATIAL.target
    draws = Draws(
        centre=(0.0, 1.6, 0.0),
        displacement=(0.08, 0.15, 0.2),
        rotation=(0.2, 0.35, 0.5),
        spin=tuple(np.deg2rad([0.5, 1.0, 2.0]).tolist()),
        start=(0.05, 0.1, 0.15),
        half_width=(0.25, 0.35),
    )
    approach_axes = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    measured = _MEASURED
    outward = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    seeds = {"train": 20_401, "validation": 20_402, "test": 20_403, "ood": 20_404}

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

    def observe(self, sensors: Array, time: Array) -> Array:
        """Observations (N, 106) from the model's sensors (N, 90) and the time (N,) in s."""
        n = len(sensors)
        observation = np.empty((n, LAYOUT.size))
        observation[:, : len(_COLUMNS)] = sensors.take(_COLUMNS, axis=1)
        goal = observation[:, _SLICES["goal_position"].start : _SLICES["goal_linear_velocity"].stop]
        hand = observation[:, _SLICES["end_effector_position"].start : _SLICES["end_effector_axis"].start]
        errors = slice(_SLICES["position_error"].start, _SLICES["velocity_error"].stop)
        np.subtract(goal, hand, out=observation[:, errors])
        axes, goal_axes = (
            observation[:, _SLICES[name]].reshape(n, 2, 3) for name in ("end_effector_axis", "goal_axis")
        )
        observation[:, _SLICES["axis_error"]] = axis_rotation(axes, goal_axes).reshape(n, 6)
        observation[:, -1] = time
        return observation

    def attitude(self, observation: NDArray) -> Array:
        """Angle (N,) of the satellite from its initial attitude, rad."""
        return rotation_angle(observation[:, _SLICES["base_quaternion"]])


def _direction(rng: np.random.Generator) -> Array:
    vector = rng.standard_normal(3)
    return vector / np.sqrt(vector @ vector)
