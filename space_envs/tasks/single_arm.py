"""SpaceCapture/SingleArm: bring the end-effector to a static grapple pose in the inertial frame.

The base floats, so the pose of the end-effector depends on the path of the joints. A goal is the final pose
of a minimum-jerk joint motion of the free-floating robot from home to a configuration drawn around it, so
every goal is reachable. In a capture the end-effector is close, aligned and slow for the hold time.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, multiply, rotation_angle
from space_envs.errors import GoalError, unknown_name
from space_envs.robots.capsules import SINGLE_ARM_SHAPE
from space_envs.robots.parameters import SINGLE_ARM, STEP_LIMITS, VARIANTS
from space_envs.robots.single_arm import ModelOptions, single_arm_model
from space_envs.simulation import Simulation
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import (
    UNIT,
    CaptureEnvelope,
    CaptureErrors,
    CaptureLimits,
    Field,
    GoalOption,
    Goals,
    ObservationLayout,
)
from space_envs.tasks.contacts import Contacts
from space_envs.tasks.goals.poses import SPLIT_SIZE, PoseGoals, goal_block, robot_of

LAYOUT = ObservationLayout(
    (
        Field("joint_position", 7, 20.0, "joint angles, rad"),
        Field("joint_velocity", 7, 100.0, "joint rates, rad/s"),
        Field("base_position", 3, 10.0, "satellite's centre of mass, inertial frame, m"),
        Field("base_quaternion", 4, UNIT, "satellite's attitude, w x y z, body to inertial"),
        Field("base_linear_velocity", 3, 100.0, "of the satellite's centre of mass, inertial axes, m/s"),
        Field("base_angular_velocity", 3, 100.0, "of the satellite, inertial axes, rad/s"),
        Field("end_effector_position", 3, 10.0, "inertial frame, m"),
        Field("end_effector_quaternion", 4, UNIT, "w x y z, end-effector to inertial; either sign"),
        Field("end_effector_linear_velocity", 3, 100.0, "inertial axes, m/s"),
        Field("end_effector_angular_velocity", 3, 100.0, "inertial axes, rad/s"),
        Field("goal_position", 3, 10.0, "grapple, inertial frame, m"),
        Field("goal_quaternion", 4, UNIT, "grapple, w x y z, grapple to inertial, w >= 0"),
        Field("position_error", 3, 20.0, "goal minus end-effector, inertial axes, m"),
        Field("rotation_error", 3, 3.1416, "rotation vector from end-effector to goal, inertial axes, rad"),
        Field("time", 1, 1e4, "since the start of the episode, s"),
    )
)
_GOAL, _GOAL_QUATERNION, _END_EFFECTOR, _END_EFFECTOR_QUATERNION, _POSITION_ERROR, _ROTATION_ERROR, _TIME = (
    LAYOUT.slices[name]
    for name in (
        "goal_position",
        "goal_quaternion",
        "end_effector_position",
        "end_effector_quaternion",
        "position_error",
        "rotation_error",
        "time",
    )
)
_TINY = 1e-300  # avoids 0 / 0
MEASURED = 47  # first components of the observation: the first sensors of the model, in order


@dataclass(frozen=True)
class PoseEnvelope(CaptureEnvelope):
    """Capture envelope with limits on pose and twist."""

    orientation: float = 5.0  # deg
    angular_velocity: float = 5.0  # deg/s

    @property
    def limits(self) -> CaptureLimits:
        """Largest errors of a capture."""
        angle, rate = np.deg2rad(self.orientation), np.deg2rad(self.angular_velocity)
        return CaptureLimits(self.position, float(angle), self.linear_velocity, float(rate))


@dataclass(frozen=True)
class SingleArmTask(CaptureTask):
    """A 7-DoF arm on a free-floating 200 kg satellite reaches a static grapple pose.

    Attributes:
        variant: inertias of the model, paper or physical.
    """

    variant: str = "paper"
    envelope: CaptureEnvelope = field(default_factory=PoseEnvelope)

    def __post_init__(self) -> None:
        if not isinstance(self.variant, str) or self.variant not in VARIANTS:
            raise unknown_name("model variant", self.variant, VARIANTS)
        super().__post_init__()

    layout = LAYOUT
    parameters = SINGLE_ARM
    split_sizes = SPLIT_SIZE
    goal_options = {"goal_position": GoalOption(3), "goal_quaternion": GoalOption(4)}
    collides = True

    @property
    def default_timestep(self) -> float:
        """By variant, s."""
        return STEP_LIMITS[self.variant].default_timestep

    @property
    def largest_timestep(self) -> float:
        """By variant, s."""
        return STEP_LIMITS[self.variant].largest_timestep

    @property
    def largest_control_period(self) -> float:
        """By variant, s."""
        return STEP_LIMITS[self.variant].largest_control_period

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model, shared and read-only."""
        return single_arm_model(ModelOptions(self.variant, self.step_size))

    @property
    def render_model(self) -> mujoco.MjModel:
        """The model with geometry for rendering."""
        return single_arm_model(ModelOptions(self.variant, self.step_size, visual=True))

    @property
    def mechanics(self) -> FloatingRobot:
        """The robot's momentum-level mathematics, read from the model."""
        return robot_of(self.variant)

    @cached_property
    def contacts(self) -> Contacts:
        """Contacts of links with the satellite."""
        return Contacts.of(self.model, SINGLE_ARM_SHAPE)

    @property
    def contact_names(self) -> tuple[str, ...]:
        """Names of the contacts, by the codes of `collided`."""
        return self.contacts.names

    def collided(self, before: Array, sensors: Array) -> NDArray[np.int64]:
        """Codes (N,) of the first contact in a control period."""
        return self.contacts.touched(before, sensors)

    def check_start(self, goals: Goals) -> None:
        """Reject joint angles for which a link touches the satellite; errors as in the base class."""
        self.contacts.refuse(
            self.contacts.all_gaps(self.contacts.points(self.mechanics, goals.joint_position))
        )

    def goal_block(self, split: str, block: int) -> PoseGoals:
        """Goals of a block."""
        return goal_block(self.variant, self.difficulty, split, block)

    def given_goals(self, values: Mapping[str, Array], joint_position: Array | None) -> PoseGoals:
        """Goals from `goal_position` and `goal_quaternion`; errors as in `check_goals`."""
        position, quaternion = self.check_goals(
            values["goal_position"], values["goal_quaternion"], joint_position
        )
        start = self.mechanics.home if joint_position is None else joint_position
        k = len(position)
        return PoseGoals(
            np.ones(k), np.broadcast_to(start, (k, len(self.mechanics.home))), position, quaternion
        )

    def place(self, simulation: Simulation, rows: NDArray[np.int64], goals: PoseGoals) -> None:
        """Set the pose of the grapple to the goals."""
        simulation.mocap_pos[rows, 0] = goals.position
        simulation.mocap_quat[rows, 0] = goals.quaternion

    def update_visuals(
        self, model: mujoco.MjModel, data: mujoco.MjData | None, goals: PoseGoals, row: int
    ) -> None:
        """Set the pose of the rendered grapple."""
        if data is not None:
            data.mocap_pos[0], data.mocap_quat[0] = goals.position[row], goals.quaternion[row]

    def check_goals(
        self, position: Array, quaternion: Array, joints: Array | None = None
    ) -> tuple[Array, Array]:
        """A user's grapple poses, validated, with unit quaternions, w >= 0.

        Args:
            position: (K, 3) m. quaternion: (K, 4). joints: (K, n) rad at the start; None is home.

        Raises:
            GoalError: for NaN, a quaternion without unit norm, a position out of reach or inside the bus.
        """
        if not (np.isfinite(position).all() and np.isfinite(quaternion).all()):
            raise GoalError("a goal must be finite, got NaN or infinity")
        norm = np.linalg.norm(quaternion, axis=-1, keepdims=True)
        if (abs(norm - 1.0) > 1e-3).any():
            raise GoalError(
                f"goal_quaternion must be a unit quaternion (w, x, y, z), got norm {norm.ravel().tolist()}"
            )
        robot = self.mechanics
        # The base starts at the origin, and with zero momentum the system's centre of mass is at rest.
        centre = robot.centre_of_mass(robot.kinematics(robot.home if joints is None else joints))
        distance = np.linalg.norm(position - centre, axis=-1)
        reach = self.mechanics.reach()
        if (distance > reach).any():
            raise GoalError(
                f"goal out of reach: {distance.max():.2f} m from the system's centre of mass, the reach is "
                f"{reach:.2f} m"
            )
        if (np.abs(position).max(axis=-1) < SINGLE_ARM.satellite_side / 2).any():
            raise GoalError(f"goal inside the satellite: {position.tolist()} m")
        return position, np.where(quaternion[..., :1] < 0, -quaternion, quaternion) / norm

    @cached_property
    def _squares(self) -> Array:
        """(size, 5) from squared observations to the squares of the capture errors, in their order."""
        squares = self.layout.sum_of_squares(
            "position_error",
            "rotation_error",
            "end_effector_linear_velocity",
            "end_effector_angular_velocity",
            "base_linear_velocity",
        )
        squares[self.layout.slices["base_angular_velocity"], -1] = self.c**2
        return squares

    def observe(self, sensors: Array, time: Array) -> Array:
        """Observations (N, size) from the model's sensors (N, 47) and the time (N,) in s."""
        # Runs at every step, also for N = 1: the number of numpy calls decides the time.
        observation = np.empty((len(sensors), self.layout.size))
        observation[:, :MEASURED] = sensors[:, :MEASURED]
        np.subtract(sensors[:, _GOAL], sensors[:, _END_EFFECTOR], out=observation[:, _POSITION_ERROR])
        # goal * conjugate(end-effector) as two stacked matrix products, which are bitwise the same for any N.
        product = (sensors[:, None, _GOAL_QUATERNION] @ _QUOTIENT).reshape(-1, 4, 4)
        error = (product @ sensors[:, _END_EFFECTOR_QUATERNION, None])[..., 0]
        cosine, vector = error[:, :1], error[:, 1:]
        sine = np.sqrt((vector * vector).sum(axis=1, keepdims=True))
        # Twice atan2 with |w|, and the vector's sign flipped where w < 0: the smaller rotation.
        half = np.arctan2(sine, np.abs(cosine))
        factor = np.copysign(half / np.maximum(0.5 * sine, _TINY), cosine)
        np.multiply(factor, vector, out=observation[:, _ROTATION_ERROR])
        observation[:, _TIME] = time[:, None]
        return observation

    def errors(self, observation: Array) -> CaptureErrors:
        """Capture errors (N,) from observations (N, size); the grapple is at rest."""
        return CaptureErrors(*np.sqrt(((observation * observation)[:, None, :] @ self._squares)[:, 0]).T)

    def attitude(self, observation: Array) -> Array:
        """Angle (N,) of the satellite from its initial attitude, rad."""
        return rotation_angle(observation[:, LAYOUT.slices["base_quaternion"]])


def _quotient_tensor() -> Array:
    """T (4, 16) with (a @ T).reshape(4, 4) @ b the quaternion product of a and the conjugate of b."""
    unit = np.eye(4)
    conjugate = unit * np.array([1.0, -1.0, -1.0, -1.0])
    return np.stack([np.stack([multiply(a, b) for b in conjugate], axis=-1) for a in unit]).reshape(4, 16)


_QUOTIENT = _quotient_tensor()
