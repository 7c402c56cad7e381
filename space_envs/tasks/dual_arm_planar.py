"""SpaceCapture/DualArmPlanar: two planar arms capture a tumbling object at its grapple points (shah2013)."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.robots.dual_arm import DualArmOptions, dual_arm_model
from space_envs.robots.parameters import DUAL_ARM_PLANAR
from space_envs.tasks.common import Field, GoalOption, ObservationLayout
from space_envs.tasks.dual_arm import FASTEST_SPIN, sensor_columns
from space_envs.tasks.goals.targets import Draws, TargetGoals
from space_envs.tasks.goals.tumbling import TumblingTargetTask
from space_envs.tasks.rewards import DENSE

LAYOUT = ObservationLayout(
    (
        Field("joint_position", 6, 20.0, "joint angles, arm 1 first, rad"),
        Field("joint_velocity", 6, 100.0, "joint rates, rad/s"),
        Field("base_position", 2, 10.0, "satellite's centre of mass, inertial frame, m"),
        Field("base_angle", 1, 100.0, "satellite's attitude from its initial one, rad"),
        Field("base_linear_velocity", 2, 100.0, "of the satellite's centre of mass, inertial axes, m/s"),
        Field("base_angular_velocity", 1, 100.0, "of the satellite, rad/s"),
        Field("end_effector_position", 4, 20.0, "of arm 1, then arm 2, inertial frame, m"),
        Field("end_effector_linear_velocity", 4, 100.0, "of arm 1, then arm 2, inertial axes, m/s"),
        Field("target_position", 2, 10.0, "target's centre, inertial frame, m"),
        Field("target_angle", 1, 2e4, "target's attitude, rad; the grapple points lie on its y axis"),
        Field("target_angular_velocity", 1, 10.0, "of the target, rad/s"),
        Field("goal_position", 4, 10.0, "grapple points of arm 1, then arm 2, inertial frame, m"),
        Field("goal_linear_velocity", 4, 100.0, "of the grapple points, inertial axes, m/s"),
        Field("position_error", 4, 30.0, "grapple points minus end-effectors, inertial axes, m"),
        Field("velocity_error", 4, 200.0, "of the grapple points minus of the end-effectors, m/s"),
        Field("time", 1, 1e4, "since the start of the episode, s"),
    )
)
_PLANE, _ALL, _ROTATION = slice(0, 2), slice(0, None), slice(2, 3)
_JOINTS = [f"arm{arm}_joint{number}" for arm in (1, 2) for number in (1, 2, 3)]
_MEASURED = (
    *((f"{joint}_position", _ALL) for joint in _JOINTS),
    *((f"{joint}_velocity", _ALL) for joint in _JOINTS),
    ("satellite_position", _PLANE),
    ("satellite_angle", _ALL),
    ("satellite_linear_velocity", _PLANE),
    ("satellite_angular_velocity", _ROTATION),
    ("end_effector1_position", _PLANE),
    ("end_effector2_position", _PLANE),
    ("end_effector1_linear_velocity", _PLANE),
    ("end_effector2_linear_velocity", _PLANE),
    ("target_position", _PLANE),
    ("target_angle", _ALL),
    ("target_angular_velocity", _ROTATION),
    ("grapple1_position", _PLANE),
    ("grapple2_position", _PLANE),
    ("grapple1_linear_velocity", _PLANE),
    ("grapple2_linear_velocity", _PLANE),
)
_COLUMNS = sensor_columns(dual_arm_model(DualArmOptions("planar")), _MEASURED)
_SLICES = LAYOUT.slices


@dataclass(frozen=True)
class DualArmPlanarTask(TumblingTargetTask):
    """Two planar arms on a 500 kg satellite capture a tumbling object without rotating the satellite.

    Attributes:
        mounts: of the arms in the satellite's frame, m; None is (0.5, 0) and (-0.5, 0).
    """

    horizon: int = 300
    mounts: tuple[tuple[float, float], ...] | None = None

    layout = LAYOUT
    parameters = DUAL_ARM_PLANAR
    dense_reward = tuple(term for term in DENSE if term.name != "orientation")
    goal_options = {
        "target_position": GoalOption(2),
        "target_angle": GoalOption(1, (0.0,), 1e4),
        "target_angular_velocity": GoalOption(1, (0.0,), FASTEST_SPIN),
        "target_half_width": GoalOption(1, (DUAL_ARM_PLANAR.target.half_width,)),
    }
    kind = "planar"
    target = DUAL_ARM_PLANAR.target
    draws = Draws(
        centre=(2.0, 1.0, 0.0),
        displacement=(0.15, 0.3, 0.5),
        rotation=(0.3, 0.6, 1.0),
        spin=tuple(np.deg2rad([1.0, 2.0, 4.0]).tolist()),
        start=(0.1, 0.2, 0.35),
        half_width=(0.2, 0.4),
        along=(1.0, 1.0, 0.0),
    )
    approach_axes = None
    measured = _MEASURED
    outward = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    seeds = {"train": 20_301, "validation": 20_302, "test": 20_303, "ood": 20_304}

    def __post_init__(self) -> None:
        super().__post_init__()
        mounts = DualArmOptions("planar", mounts=self.mounts).mounts
        # The default mounts, given explicitly, are the same task with the same stored goals.
        object.__setattr__(self, "mounts", None if mounts == DUAL_ARM_PLANAR.mounts else mounts)

    @property
    def options(self) -> DualArmOptions:
        """Options of the simulated model."""
        return DualArmOptions("planar", self.step_size, mounts=self.mounts)

    def draw_attitude(self, rng: np.random.Generator, largest: float) -> Array:
        """Draw an attitude (4,) of the target at the rendezvous."""
        half = 0.5 * rng.uniform(-largest, largest)
        return np.array([np.cos(half), 0.0, 0.0, np.sin(half)])

    def draw_angular_velocity(self, rng: np.random.Generator, least: float, largest: float) -> Array:
        """Draw an angular velocity (3,) of the target at the rendezvous, rad/s."""
        return np.array([0.0, 0.0, rng.choice([-1.0, 1.0]) * rng.uniform(least, largest)])

    def given_goals(self, values: Mapping[str, Array], joint_position: Array | None) -> TargetGoals:
        """Goals from the values of `goal_options`; errors as in `checked_goals`."""
        position, spin = (np.zeros((len(values["target_position"]), 3)) for _ in range(2))
        position[:, :2] = values["target_position"]
        spin[:, 2] = values["target_angular_velocity"][:, 0]
        half = 0.5 * values["target_angle"]
        quaternion = np.concatenate([np.cos(half), np.zeros((len(half), 2)), np.sin(half)], axis=1)
        width = values["target_half_width"][:, 0]
        return self.checked_goals(position, quaternion, spin, width, joint_position)

    def observe(self, sensors: Array, time: Array) -> Array:
        """Observations (N, 47) from the model's sensors (N, 68) and the time (N,) in s."""
        observation = np.empty((len(sensors), LAYOUT.size))
        observation[:, : len(_COLUMNS)] = sensors.take(_COLUMNS, axis=1)
        goal = observation[:, _SLICES["goal_position"].start : _SLICES["goal_linear_velocity"].stop]
        hand = observation[:, _SLICES["end_effector_position"].start : _SLICES["target_position"].start]
        errors = slice(_SLICES["position_error"].start, _SLICES["velocity_error"].stop)
        np.subtract(goal, hand, out=observation[:, errors])
        observation[:, -1] = time
        return observation

    def attitude(self, observation: NDArray) -> Array:
        """Angle (N,) of the satellite from its initial attitude, rad."""
        return np.abs(observation[:, _SLICES["base_angle"].start])
