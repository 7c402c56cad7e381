"""SpaceCapture/DualArmPlanar: two planar arms capture a tumbling object at its grapple points (shah2013)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from space_envs.checks import numbers
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError, shown
from space_envs.robots.models import joint_names
from space_envs.robots.robot import Robot
from space_envs.tasks.common import EPISODE_FIELDS, Field, GoalOption, ObservationLayout
from space_envs.tasks.dual_arm import FASTEST_SPIN
from space_envs.tasks.goals.targets import Draws, TargetGoals
from space_envs.tasks.goals.tumbling import TumblingTargetTask
from space_envs.tasks.rewards import DENSE
from space_envs.tasks.robots import length_factor

FARTHEST_MOUNT = 5.0  # m along each axis
_PLANE, _ALL, _ROTATION = slice(0, 2), slice(0, None), slice(2, 3)
_MEASURED = (
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


@lru_cache(maxsize=16)
def planar_layout(joints: int, factor: float = 1.0) -> ObservationLayout:
    """Observation of two planar arms with a number of joints together.

    Args:
        factor: on the bounds of positions.
    """
    return ObservationLayout(
        (
            Field("joint_position", joints, 20.0, "joint angles, arm 1 first, rad"),
            Field("joint_velocity", joints, 100.0, "joint rates, rad/s"),
            Field("base_position", 2, 10.0 * factor, "satellite's centre of mass, inertial frame, m"),
            Field("base_angle", 1, 100.0, "satellite's attitude from its initial one, rad"),
            Field("base_linear_velocity", 2, 100.0, "of the satellite's centre of mass, inertial axes, m/s"),
            Field("base_angular_velocity", 1, 100.0, "of the satellite, rad/s"),
            Field("end_effector_position", 4, 20.0 * factor, "of arm 1, then arm 2, inertial frame, m"),
            Field("end_effector_linear_velocity", 4, 100.0, "of arm 1, then arm 2, inertial axes, m/s"),
            Field("target_position", 2, 10.0 * factor, "target's centre, inertial frame, m"),
            Field("target_angle", 1, 2e4, "target's attitude, rad; the grapple points lie on its y axis"),
            Field("target_angular_velocity", 1, 10.0, "of the target, rad/s"),
            Field("goal_position", 4, 10.0 * factor, "grapple points, arm 1 first, inertial frame, m"),
            Field("goal_linear_velocity", 4, 100.0, "of the grapple points, inertial axes, m/s"),
            Field("position_error", 4, 30.0 * factor, "grapple points minus end-effectors, inertial axes, m"),
            Field("velocity_error", 4, 200.0, "of the grapple points minus of the end-effectors, m/s"),
            *EPISODE_FIELDS,
        )
    )


@dataclass(frozen=True)
class DualArmPlanarTask(TumblingTargetTask):
    """Two planar arms on a satellite capture a tumbling object without rotating the satellite.

    Attributes:
        mounts: two points (x, y) of the arms in the satellite's frame, m, instead of the robot's.
    """

    horizon: int = 300
    mounts: tuple[tuple[float, float], ...] | None = None

    own_robot = frozen_robot = "shah2013"
    planar = True
    dense_reward = tuple(term for term in DENSE if term.name != "orientation")
    kind = "planar"
    draws = Draws(
        reach=2.9,
        displacement=(0.15, 0.3, 0.5),
        rotation=(0.3, 0.6, 1.0),
        spin=tuple(np.deg2rad([1.0, 2.0, 4.0]).tolist()),
        start=(0.1, 0.2, 0.35),
        half_width=(0.2, 0.4),
        along=(1.0, 1.0, 0.0),
    )
    approach_axes = None
    outward = np.array([[0.0, -1.0, 0.0], [0.0, 1.0, 0.0]])
    seeds = {"train": 20_301, "validation": 20_302, "test": 20_303, "ood": 20_304}

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.mounts is not None:
            object.__setattr__(self, "robot", mounted(self.robot, self.mounts))
            object.__setattr__(self, "mounts", None)  # they are the robot's

    @cached_property
    def layout(self) -> ObservationLayout:
        """Layout of the observation vector."""
        return planar_layout(self.robot.n_joints, length_factor(self.robot))

    @property
    def measured(self) -> tuple[tuple[str, slice], ...]:
        """Sensors with the components that are observed, in the order of the layout."""
        joints = joint_names(self.robot)
        angles, rates = (
            [(f"{joint}_{quantity}", _ALL) for joint in joints] for quantity in ("position", "velocity")
        )
        return (*angles, *rates, *_MEASURED)

    @property
    def goal_options(self) -> dict[str, GoalOption]:
        """Options of `reset` that together define a goal."""
        return {
            "target_position": GoalOption(2, largest=10.0 * length_factor(self.robot)),
            "target_angle": GoalOption(1, (0.0,), 1e4),
            "target_angular_velocity": GoalOption(1, (0.0,), FASTEST_SPIN),
            "target_half_width": GoalOption(1, (self.target.half_width,)),
        }

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

    def observe(self, sensors: Array, time: Array, peak_attitude: Array) -> Array:
        """Observations (N, size); see the base class."""
        observation = np.empty((len(sensors), self.layout.size))
        observation[:, : len(self.columns)] = sensors.take(self.columns, axis=1)
        goal, hand, errors = self._blocks
        np.subtract(observation[:, goal], observation[:, hand], out=observation[:, errors])
        observation[:, -2], observation[:, -1] = peak_attitude, time
        return observation

    @cached_property
    def _blocks(self) -> tuple[slice, slice, slice]:
        """Positions and velocities of the grapple points, of the end-effectors, and their errors."""
        at = self.layout.slices
        return (
            slice(at["goal_position"].start, at["goal_linear_velocity"].stop),
            slice(at["end_effector_position"].start, at["end_effector_linear_velocity"].stop),
            slice(at["position_error"].start, at["velocity_error"].stop),
        )


def mounted(robot: Robot, mounts: Sequence[Sequence[float]]) -> Robot:
    """The robot with its arms mounted at two points (x, y) in the satellite's frame, m.

    Raises:
        ConfigurationError: if they are not two points within `FARTHEST_MOUNT`.
    """
    points = numbers(mounts)
    if points is None or points.shape != (2, 2) or not (np.abs(points) <= FARTHEST_MOUNT).all():
        raise ConfigurationError(
            f"mounts must be two points (x, y) within {FARTHEST_MOUNT:g} m of the satellite, got "
            f"{shown(mounts)}"
        )
    return robot.mounted_at(points.tolist())
