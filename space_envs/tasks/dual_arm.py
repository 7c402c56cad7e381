"""Base of the two dual-arm tasks: a tumbling target with a grapple point for each arm.

The target rotates freely in the inertial frame; its grapple points lie on opposite sides of its centre. It is
captured when arm 1 is at the first and arm 2 at the second, with matching velocities, for the hold time.
Every goal can be captured without rotating the satellite: see `space_envs.tasks.goals.tumbling`.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, cast

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, canonical, conjugate, rotate
from space_envs.errors import GoalError
from space_envs.robots.models import GRAPPLES
from space_envs.robots.robot import Target
from space_envs.scenery.dual_arm import scale_target
from space_envs.simulation import Simulation
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import CaptureErrors
from space_envs.tasks.goals.targets import Draws, TargetGoals

SPLIT_SIZE = {"train": 1024, "validation": 256, "test": 512, "ood": 512}
FASTEST_SPIN = 1.0  # rad/s about each axis, of a user's target, which keeps its observation in bounds


@dataclass(frozen=True)
class DualArmTask(CaptureTask):
    """Common part of the planar and the spatial dual-arm task."""

    kind: ClassVar[str]  # planar or spatial, in names of stored draws
    draws: ClassVar[Draws]
    # (2, 3) approach axes of the grapple points in the target's frame; None if any direction is allowed.
    approach_axes: ClassVar[Array | None]
    outward: ClassVar[Array]  # (2, 3) unit vectors from the target's centre to its grapple points
    seeds: ClassVar[Mapping[str, int]]
    arms = 2
    split_sizes = SPLIT_SIZE
    collides = True

    @property
    def target(self) -> Target:
        """The target, which a robot with two arms has."""
        return cast("Target", self.robot.target)

    @property
    def measured(self) -> tuple[tuple[str, slice], ...]:
        """Sensors with the components that are observed, in the order of the layout."""
        raise NotImplementedError

    @cached_property
    def columns(self) -> NDArray[np.int64]:
        """Columns of the sensors that are the first components of an observation."""
        columns: list[int] = []
        for name, part in self.measured:
            sensor = self.model.sensor(name)
            start, size = int(sensor.adr[0]), int(sensor.dim[0])
            columns += list(range(start, start + size))[part]
        return np.array(columns)

    def gaps(
        self, robot: FloatingRobot, q: Array, goals: TargetGoals, attitude: Array, gripper: bool = True
    ) -> Array:
        """Gaps (K, M) of the arms to the satellite, to the target and to each other, m.

        Args:
            q: (K, n) rad, with the satellite at its initial pose. attitude: (K, 4) of the target.
            gripper: whether the gripper may touch the target: its radius then counts as zero.
        """
        points = self.contacts.points(robot, q)
        half = goals.half_width[:, None] * self.contacts.target_shape
        local = rotate(conjugate(attitude)[:, None], points - goals.position[:, None])
        return self.contacts.all_gaps(points, local, half, gripper=gripper)

    def check_start(self, goals: TargetGoals) -> None:
        """Reject goals with contacts at the start; errors as in the base class."""
        self.contacts.refuse(self.gaps(self.mechanics, goals.joint_position, goals, goals.quaternion))

    def grapples(self, half_width: Array) -> Array:
        """Grapple points (K, 2, 3) in the target's frame, m, for half widths (K,)."""
        return half_width[:, None, None] * self.outward

    def draw_attitude(self, rng: np.random.Generator, largest: float) -> Array:
        """Draw an attitude (4,) of the target at the rendezvous."""
        raise NotImplementedError

    def draw_angular_velocity(self, rng: np.random.Generator, least: float, largest: float) -> Array:
        """Draw an angular velocity (3,) of the target at the rendezvous, rad/s."""
        raise NotImplementedError

    def checked_goals(
        self,
        position: Array,
        quaternion: Array,
        angular_velocity: Array,
        half_width: Array,
        joint_position: Array | None,
    ) -> TargetGoals:
        """Goals (K) from a user's values, validated.

        Raises:
            GoalError: for NaN, an invalid size, a target inside the satellite or a grapple point out of reach
                of its arm at the start of the episode.
        """
        for name, value in (("target", position), ("spin", angular_velocity), ("size", half_width)):
            if not np.isfinite(value).all():
                raise GoalError(f"a goal must be finite, got a {name} with NaN or infinity")
        widest = max(1.0, 2.0 * self.target.half_width)
        if (half_width <= 0).any() or (half_width > widest).any():
            raise GoalError(f"target_half_width must lie in (0, {widest:g}] m, got {half_width.tolist()}")
        norm = np.linalg.norm(quaternion, axis=-1, keepdims=True)
        if (abs(norm - 1.0) > 1e-3).any():
            raise GoalError(
                f"target_quaternion must be a unit quaternion (w, x, y, z), got norm {norm.ravel().tolist()}"
            )
        quaternion = canonical(quaternion / norm)
        robot, k = self.mechanics, len(position)
        start = np.broadcast_to(robot.home if joint_position is None else joint_position, (k, robot.n_joints))
        origin = robot.centre_of_mass(robot.kinematics(start))
        points = position[:, None] + rotate(quaternion[:, None], self.grapples(half_width))
        distance = np.linalg.norm(points - origin[:, None], axis=-1)
        for arm in range(2):
            far, most = distance[:, arm].max(), robot.reach(arm)
            if far > most:
                raise GoalError(
                    f"grapple point {arm + 1} out of reach: {far:.2f} m from the system's centre of mass, "
                    f"the reach of its arm is {most:.2f} m"
                )
        if (np.abs(self.contacts.in_box(position)) < self.contacts.satellite_half).all(axis=-1).any():
            raise GoalError(f"target inside the satellite: {position.tolist()} m")
        return TargetGoals(np.ones(k), start, position, quaternion, angular_velocity, half_width)

    def place(self, simulation: Simulation, rows: NDArray[np.int64], goals: TargetGoals) -> None:
        """Set the pose and the angular velocity of the target to the goals."""
        simulation.place_sites(rows, GRAPPLES, self.grapples(goals.half_width))
        n = simulation.n_joints
        if simulation.planar:
            angle = 2.0 * np.arctan2(goals.quaternion[:, 3], goals.quaternion[:, 0])
            simulation.qpos[rows, 3 + n : 5 + n] = goals.position[:, :2]
            simulation.qpos[rows, 5 + n] = angle
            simulation.qvel[rows, 5 + n] = goals.angular_velocity[:, 2]
        else:
            simulation.qpos[rows, 7 + n : 10 + n] = goals.position
            simulation.qpos[rows, 10 + n : 14 + n] = goals.quaternion
            spin = rotate(conjugate(goals.quaternion), goals.angular_velocity)
            simulation.qvel[rows, 9 + n : 12 + n] = spin

    def update_visuals(
        self, model: mujoco.MjModel, data: mujoco.MjData | None, goals: TargetGoals, row: int
    ) -> None:
        """Set the size of the rendered target."""
        scale_target(model, float(goals.half_width[row]))

    def errors(self, observation: Array) -> CaptureErrors:
        """Largest capture errors (N,) of both arms from observations (N, size)."""
        each = np.sqrt(((observation * observation)[:, None, :] @ self._squares)[:, 0])
        position, angle, velocity = np.maximum(each[:, :3], each[:, 3:6]).T
        return CaptureErrors(position, angle, velocity, np.zeros(len(each)), each[:, -1])

    @cached_property
    def _squares(self) -> Array:
        """(size, 7) from squared observations to squared position, angle and velocity errors of arm 1, those
        of arm 2, and the integrand of eq. 20."""
        matrix = np.zeros((self.layout.size, 7))
        for column, name in enumerate(("position_error", "axis_error", "velocity_error")):
            if name in self.layout.slices:
                part = self.layout.slices[name]
                half = (part.start + part.stop) // 2
                matrix[part.start : half, column] = 1.0
                matrix[half : part.stop, 3 + column] = 1.0
        matrix[self.layout.slices["base_linear_velocity"], -1] = 1.0
        matrix[self.layout.slices["base_angular_velocity"], -1] = self.c**2
        return matrix
