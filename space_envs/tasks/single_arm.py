"""SpaceCapture/SingleArm: bring the end-effector to a static grapple pose in the inertial frame.

The base floats, so the pose of the end-effector depends on the path of the joints. A goal is the final pose
of a minimum-jerk joint motion of the free-floating robot from home to a configuration drawn around it, so
every goal is reachable. In a capture the end-effector is close, aligned and slow for the hold time.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from typing import ClassVar, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.reactionless import axis_rotation
from space_envs.dynamics.rotations import Array, conjugate, multiply, rotate, z_axis
from space_envs.errors import GoalError
from space_envs.robots.models import MovingTarget, SceneOptions, robot_model
from space_envs.simulation import Simulation
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import (
    EPISODE_FIELDS,
    UNIT,
    CaptureEnvelope,
    CaptureErrors,
    CaptureLimits,
    Field,
    GoalOption,
    Goals,
    ObservationLayout,
)
from space_envs.tasks.goals.kinds import GoalKind, checked_kind
from space_envs.tasks.goals.poses import SPLIT_SIZE, MovingPoseGoals, PoseGoals, goal_block
from space_envs.tasks.robots import length_factor

_TINY = 1e-300  # avoids 0 / 0
FASTEST_GRAPPLE = 1.0  # m/s and rad/s along each axis, of a user's moving grapple
_ROTATION_ERROR: dict[GoalKind, str] = {
    "pose": "rotation vector from end-effector to goal, inertial axes, rad",
    "axis": "smallest rotation from the approach axis to the goal's, inertial axes, rad",
    "position": "zero, as any orientation is accepted, rad",
}


def _moving_target_fields(factor: float) -> tuple[Field, ...]:
    """Sensors of a moving grapple and of its body, with a factor on the bounds of positions."""
    return (
        Field("goal_linear_velocity", 3, 100.0, "of the grapple, inertial axes, m/s"),
        Field("goal_angular_velocity", 3, 100.0, "of the grapple, inertial axes, rad/s"),
        Field("target_position", 3, 10.0 * factor, "target's centre of mass, inertial frame, m"),
        Field("target_quaternion", 4, UNIT, "w x y z, target's principal axes to inertial; either sign"),
        Field("target_linear_velocity", 3, 100.0, "of the target's centre of mass, inertial axes, m/s"),
        Field("target_angular_velocity", 3, 100.0, "of the target, inertial axes, rad/s"),
    )


_VELOCITY_ERRORS = (
    Field("linear_velocity_error", 3, 200.0, "goal minus end-effector, inertial axes, m/s"),
    Field("angular_velocity_error", 3, 200.0, "goal minus end-effector, inertial axes, rad/s"),
)


@lru_cache(maxsize=16)
def pose_layout(
    joints: int, factor: float = 1.0, goal: GoalKind = "pose", moving: bool = False
) -> ObservationLayout:
    """Observation of an arm with a number of joints; sensors, in order, before the errors and the time.

    Args:
        factor: on the bounds of positions. goal: kind of the goals. moving: whether the grapple moves.
    """
    sign = "either sign" if moving else "w >= 0"
    return ObservationLayout(
        (
            Field("joint_position", joints, 20.0, "joint angles, rad"),
            Field("joint_velocity", joints, 100.0, "joint rates, rad/s"),
            Field("base_position", 3, 10.0 * factor, "satellite's centre of mass, inertial frame, m"),
            Field("base_quaternion", 4, UNIT, "satellite's attitude, w x y z, body to inertial"),
            Field("base_linear_velocity", 3, 100.0, "of the satellite's centre of mass, inertial axes, m/s"),
            Field("base_angular_velocity", 3, 100.0, "of the satellite, inertial axes, rad/s"),
            Field("end_effector_position", 3, 10.0 * factor, "inertial frame, m"),
            Field("end_effector_quaternion", 4, UNIT, "w x y z, end-effector to inertial; either sign"),
            Field("end_effector_linear_velocity", 3, 100.0, "inertial axes, m/s"),
            Field("end_effector_angular_velocity", 3, 100.0, "inertial axes, rad/s"),
            Field("goal_position", 3, 10.0 * factor, "grapple, inertial frame, m"),
            Field("goal_quaternion", 4, UNIT, f"grapple, w x y z, grapple to inertial, {sign}"),
            *(_moving_target_fields(factor) if moving else ()),
            Field("position_error", 3, 20.0 * factor, "goal minus end-effector, inertial axes, m"),
            Field("rotation_error", 3, 3.1416, _ROTATION_ERROR[goal]),
            *(_VELOCITY_ERRORS if moving else ()),
            *EPISODE_FIELDS,
        )
    )


class _Columns(NamedTuple):
    """Slices of an observation that its computation needs; sensors precede those of the errors."""

    goal_position: slice
    goal_quaternion: slice
    end_effector_position: slice
    end_effector_quaternion: slice
    position_error: slice
    rotation_error: slice
    peak_attitude: slice
    time: slice


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
    """An arm on a free-floating satellite reaches a static grapple pose.

    Attributes:
        goal: pose, axis or position; what a capture asks of the end-effector: the grapple's whole pose, its
            position and approach axis z with any rotation about it, or its position with any orientation;
            its velocities have to match in any case.
    """

    envelope: CaptureEnvelope = field(default_factory=PoseEnvelope)
    goal: GoalKind = "pose"  # type: ignore[misc]

    # Free body that carries the grapple in a subclass; None is a grapple at rest. A moving one is observed
    # with its velocity and that of its body, and a capture is slow relative to it.
    moving_target: ClassVar[MovingTarget | None] = None
    own_robot = "shyam2020"
    arms = 1
    split_sizes = SPLIT_SIZE
    collides = True

    def __post_init__(self) -> None:
        checked_kind(self.goal)
        super().__post_init__()

    @cached_property
    def layout(self) -> ObservationLayout:
        """Layout of the observation vector."""
        moves = self.moving_target is not None
        return pose_layout(self.robot.n_joints, length_factor(self.robot), self.goal, moves)

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model, shared and read-only."""
        return robot_model(self.robot, SceneOptions(self.step_size, moving_target=self.moving_target))

    @property
    def render_model(self) -> mujoco.MjModel:
        """The model with geometry for rendering."""
        options = SceneOptions(self.step_size, visual=True, moving_target=self.moving_target)
        return robot_model(self.robot, options)

    @property
    def goal_options(self) -> dict[str, GoalOption]:
        """Options of `reset` that together define a goal."""
        farthest = 10.0 * length_factor(self.robot)
        any_orientation = (1.0, 0.0, 0.0, 0.0) if self.goal == "position" else None
        pose = {
            "goal_position": GoalOption(3, largest=farthest),
            "goal_quaternion": GoalOption(4, any_orientation),
        }
        if self.moving_target is None:
            return pose
        still = (0.0, 0.0, 0.0)
        velocities = ("goal_linear_velocity", "goal_angular_velocity")
        return pose | {name: GoalOption(3, still, FASTEST_GRAPPLE) for name in velocities}

    def check_start(self, goals: Goals) -> None:
        """Reject joint angles for which a link touches the satellite; errors as in the base class."""
        points = self.contacts.points(self.mechanics, goals.joint_position)
        self.contacts.refuse(self.contacts.all_gaps(points))

    def goal_block(self, split: str, block: int) -> PoseGoals:
        """Goals of a block."""
        return goal_block(self.robot, self.difficulty, split, block)

    def given_goals(self, values: Mapping[str, Array], joint_position: Array | None) -> PoseGoals:
        """Goals from the values of `goal_options`; errors as in `check_goals`."""
        position, quaternion = self.check_goals(
            values["goal_position"], values["goal_quaternion"], joint_position
        )
        start = self.mechanics.home if joint_position is None else joint_position
        k = len(position)
        pose = np.ones(k), np.broadcast_to(start, (k, len(self.mechanics.home))), position, quaternion
        if self.moving_target is None:
            return PoseGoals(*pose)
        velocities = values["goal_linear_velocity"], values["goal_angular_velocity"]
        if not np.isfinite(velocities).all():
            raise GoalError("a goal must be finite, got a velocity with NaN or infinity")
        return MovingPoseGoals(*pose, *velocities)

    def place(self, simulation: Simulation, rows: NDArray[np.int64], goals: PoseGoals) -> None:
        """Set the pose of the grapple to the goals, and its velocity if it moves."""
        if isinstance(goals, MovingPoseGoals):
            n = simulation.n_joints
            simulation.qpos[rows, 7 + n : 10 + n] = goals.position
            simulation.qpos[rows, 10 + n : 14 + n] = goals.quaternion
            simulation.qvel[rows, 6 + n : 9 + n] = goals.linear_velocity
            spin = rotate(conjugate(goals.quaternion), goals.angular_velocity)
            simulation.qvel[rows, 9 + n : 12 + n] = spin
            return
        simulation.mocap_pos[rows, 0] = goals.position
        simulation.mocap_quat[rows, 0] = goals.quaternion

    def update_visuals(
        self, model: mujoco.MjModel, data: mujoco.MjData | None, goals: PoseGoals, row: int
    ) -> None:
        """Set the pose of the rendered grapple, if it is at rest."""
        if data is not None and self.moving_target is None:
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
        if (np.abs(self.contacts.in_box(position)) < self.contacts.satellite_half).all(axis=-1).any():
            raise GoalError(f"goal inside the satellite: {position.tolist()} m")
        return position, np.where(quaternion[..., :1] < 0, -quaternion, quaternion) / norm

    @cached_property
    def _columns(self) -> _Columns:
        return _Columns(*(self.layout.slices[name] for name in _Columns._fields))

    @cached_property
    def _squares(self) -> Array:
        """(size, 5) from squared observations to the squares of the capture errors, in their order."""
        velocities = "end_effector_linear_velocity", "end_effector_angular_velocity"
        if self.moving_target is not None:
            velocities = "linear_velocity_error", "angular_velocity_error"
        squares = self.layout.sum_of_squares(
            "position_error", "rotation_error", *velocities, "base_linear_velocity"
        )
        squares[self.layout.slices["base_angular_velocity"], -1] = self.c**2
        return squares

    def observe(self, sensors: Array, time: Array, peak_attitude: Array) -> Array:
        """Observations (N, size); see the base class."""
        # Runs at every step, also for N = 1: the number of numpy calls decides the time.
        at = self._columns
        observation = np.empty((len(sensors), self.layout.size))
        observation[:, : at.position_error.start] = sensors[:, : at.position_error.start]
        np.subtract(
            sensors[:, at.goal_position],
            sensors[:, at.end_effector_position],
            out=observation[:, at.position_error],
        )
        if self.goal == "pose":
            self._write_rotation_error(sensors, observation)
        elif self.goal == "axis":
            axes = (z_axis(sensors[:, part]) for part in (at.end_effector_quaternion, at.goal_quaternion))
            observation[:, at.rotation_error] = axis_rotation(*axes)
        else:
            observation[:, at.rotation_error] = 0.0
        observation[:, at.peak_attitude] = peak_attitude[:, None]
        observation[:, at.time] = time[:, None]
        if self.moving_target is not None:
            goal, end_effector, error = self._twists
            np.subtract(observation[:, goal], observation[:, end_effector], out=observation[:, error])
        return observation

    def _write_rotation_error(self, sensors: Array, observation: Array) -> None:
        """Write the rotation vectors from the end-effectors to full poses."""
        at = self._columns
        # goal * conjugate(end-effector) as two stacked matrix products, which are bitwise the same for any N.
        product = (sensors[:, None, at.goal_quaternion] @ _QUOTIENT).reshape(-1, 4, 4)
        error = (product @ sensors[:, at.end_effector_quaternion, None])[..., 0]
        cosine, vector = error[:, :1], error[:, 1:]
        sine = np.sqrt((vector * vector).sum(axis=1, keepdims=True))
        # Twice atan2 with |w|, and the vector's sign flipped where w < 0: the smaller rotation.
        half = np.arctan2(sine, np.abs(cosine))
        factor = np.copysign(half / np.maximum(0.5 * sine, _TINY), cosine)
        np.multiply(factor, vector, out=observation[:, at.rotation_error])

    @cached_property
    def _twists(self) -> tuple[slice, slice, slice]:
        """Slices of the twists of a moving grapple and of the end-effector, and of their difference."""
        at, twists = self.layout.slices, ("goal_{}_velocity", "end_effector_{}_velocity", "{}_velocity_error")
        first, second, third = (
            slice(at[name.format("linear")].start, at[name.format("angular")].stop) for name in twists
        )
        return first, second, third

    def errors(self, observation: Array) -> CaptureErrors:
        """Capture errors (N,) from observations (N, size); speeds are relative to the grapple."""
        return CaptureErrors(*np.sqrt(((observation * observation)[:, None, :] @ self._squares)[:, 0]).T)


def _quotient_tensor() -> Array:
    """T (4, 16) with (a @ T).reshape(4, 4) @ b the quaternion product of a and the conjugate of b."""
    unit = np.eye(4)
    conjugate = unit * np.array([1.0, -1.0, -1.0, -1.0])
    return np.stack([np.stack([multiply(a, b) for b in conjugate], axis=-1) for a in unit]).reshape(4, 16)


_QUOTIENT = _quotient_tensor()
