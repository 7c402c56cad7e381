"""What the two dual-arm tasks share: a tumbling target with a grapple point for each arm.

The target turns freely in the inertial frame; its grapple points lie on opposite sides of its centre, and
arm 1 has to be at the first and arm 2 at the second, as fast as they move, for long enough. A goal is drawn
as the pose that the target will have after `MEETING` seconds, and is kept if a reactionless motion of the
resting robot reaches it: every goal can be captured without turning the satellite.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from importlib.resources import files
from typing import ClassVar

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.reactionless import reach
from space_envs.dynamics.rigid_body import tumble
from space_envs.dynamics.rotations import Array, canonical, conjugate, rotate
from space_envs.errors import GoalError
from space_envs.robots.dual_arm import END_EFFECTORS, GRAPPLES, SHAPES, DualArmOptions, dual_arm_model
from space_envs.robots.parameters import LARGEST_CONTROL_PERIOD, LARGEST_TIMESTEP, TargetParameters
from space_envs.scenery.dual_arm import scale_target
from space_envs.simulation import Simulation
from space_envs.tasks.base import BLOCK, CaptureTask
from space_envs.tasks.common import DIFFICULTIES, CaptureErrors
from space_envs.tasks.contacts import Contacts
from space_envs.tasks.targets import Draws, TargetGoals

# Largest steps of docs/momentum.md whose drift stays well inside the bound, s.
DEFAULT_TIMESTEP = {"planar": 0.02, "spatial": 0.01}
SPLIT_SIZE = {"train": 1024, "validation": 256, "test": 512, "ood": 512}
MEETING = 20.0  # s after the start, when the target is where the goal was drawn
ATTEMPTS = 2000  # to draw a goal that can be reached
TRIED, FEW = 2, 4  # draws of each goal of a block after which so few that were found are too few to go on
REACHED = (1e-3, np.deg2rad(0.2))  # m and rad left at the end of the motion that proves a goal reachable
LIMIT_MARGIN = 0.25  # rad, of that motion's end from the joint limits
CLEARANCE = 0.04  # m, of links from what they must not touch, at the start and at the end of that motion
OOD_FACTOR = (1.0, 1.5)  # of the difficulty's largest spin and displacement
OOD_MASS = (0.8, 1.2)  # factor on the satellite's mass and inertia
FASTEST_SPIN = 1.0  # rad/s about each axis, of a user's target; what is observed of it stays in its bounds


@dataclass(frozen=True)
class DualArmTask(CaptureTask):
    """The part of a dual-arm task that is the same in the plane and in space."""

    kind: ClassVar[str]
    target: ClassVar[TargetParameters]
    draws: ClassVar[Draws]
    way_in: ClassVar[Array | None]  # (2, 3) approach axes in the target's frame; None where any will do
    measured: ClassVar[tuple[tuple[str, slice], ...]]  # sensors, in the order of the layout
    outward: ClassVar[Array]  # (2, 3) unit vectors from the target's centre to its grapple points
    seeds: ClassVar[Mapping[str, int]]
    split_sizes = SPLIT_SIZE
    collides = True

    @property
    def default_timestep(self) -> float:
        """By robot, s."""
        return DEFAULT_TIMESTEP[self.kind]

    @property
    def largest_timestep(self) -> float:
        """By robot, s."""
        return LARGEST_TIMESTEP[self.kind]

    @property
    def largest_control_period(self) -> float:
        """By robot, s."""
        return LARGEST_CONTROL_PERIOD[self.kind]

    @property
    def options(self) -> DualArmOptions:
        """Of the model that is simulated."""
        return DualArmOptions(self.kind, self.step_size)

    @property
    def model(self) -> mujoco.MjModel:
        """The compiled model, shared and read-only."""
        return dual_arm_model(self.options)

    @property
    def render_model(self) -> mujoco.MjModel:
        """The same model with its drawn geometry."""
        options = self.options
        return dual_arm_model(DualArmOptions(options.kind, options.timestep, True, options.mounts))

    @property
    def robot(self) -> FloatingRobot:
        """The robot's momentum-level mathematics, read from the model."""
        return _robot(self.kind, self.options.mounts)

    @cached_property
    def contacts(self) -> Contacts:
        """Which links may not touch the satellite, the target and each other."""
        return Contacts.of(self.model, SHAPES[self.kind], arms=2)

    @property
    def contact_names(self) -> tuple[str, ...]:
        """What may touch what, by the codes of `collided`."""
        return self.contacts.names

    def collided(self, before: Array, sensors: Array) -> NDArray[np.int64]:
        """Codes (N,) of what touched what in a control period."""
        return self.contacts.touched(before, sensors)

    def gaps(
        self, robot: FloatingRobot, q: Array, goals: TargetGoals, attitude: Array, gripper: bool = True
    ) -> Array:
        """Gaps (K, M) of the arms to the satellite, to the target and to each other, m.

        Args:
            q: (K, n) rad, of a robot whose satellite is where it starts. attitude: (K, 4) of the target.
            gripper: whether the gripper may be at the target, so that only its centre line counts.
        """
        points = self.contacts.points(robot, q)
        half = goals.half_width[:, None] * np.array(self.contacts.shape.body)
        local = rotate(conjugate(attitude)[:, None, None], points - goals.position[:, None, None])
        return self.contacts.all_gaps(points, local, half, gripper=gripper)

    def check_start(self, goals: TargetGoals) -> None:
        """Refuse goals with which arms touch something at the start; errors as in the base class."""
        self.contacts.refuse(self.gaps(self.robot, goals.joint_position, goals, goals.quaternion))

    def grapples(self, half_width: Array) -> Array:
        """Grapple points (K, 2, 3) in the target's frame, m, for half widths (K,)."""
        return half_width[:, None, None] * self.outward

    def goal_block(self, split: str, block: int) -> TargetGoals:
        """Goals of a block."""
        return _goal_block(type(self), self.options.mounts, self.difficulty, split, block)

    def turned(self, rng: np.random.Generator, largest: float) -> Array:
        """Draw an attitude (4,) of the target at the meeting."""
        raise NotImplementedError

    def spun(self, rng: np.random.Generator, least: float, largest: float) -> Array:
        """Draw an angular velocity (3,) of the target at the meeting, rad/s."""
        raise NotImplementedError

    def checked_goals(
        self,
        position: Array,
        quaternion: Array,
        angular_velocity: Array,
        half_width: Array,
        joint_position: Array | None,
    ) -> TargetGoals:
        """Goals (K) from a user's numbers.

        Raises:
            GoalError: for NaN, a size that is none, a target in the satellite or a grapple point out of reach
                of its arm at the start of the episode.
        """
        for name, value in (("target", position), ("spin", angular_velocity), ("size", half_width)):
            if not np.isfinite(value).all():
                raise GoalError(f"a goal must be finite, got a {name} with NaN or infinity")
        if (half_width <= 0).any() or (half_width > 1.0).any():
            raise GoalError(f"target_half_width must lie in (0, 1] m, got {half_width.tolist()}")
        norm = np.linalg.norm(quaternion, axis=-1, keepdims=True)
        if (abs(norm - 1.0) > 1e-3).any():
            raise GoalError(
                f"target_quaternion must be a unit quaternion (w, x, y, z), got norm {norm.ravel().tolist()}"
            )
        quaternion = canonical(quaternion / norm)
        robot, k = self.robot, len(position)
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
        if (np.abs(position).max(axis=-1) < 0.5).any():
            raise GoalError(f"target inside the satellite: {position.tolist()} m")
        return TargetGoals(np.ones(k), start, position, quaternion, angular_velocity, half_width)

    def place(self, simulation: Simulation, rows: NDArray[np.int64], goals: TargetGoals) -> None:
        """Put the target where the goals say, turning."""
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
        """Give the drawn target the goal's size."""
        scale_target(model, float(goals.half_width[row]))

    def errors(self, observation: Array) -> CaptureErrors:
        """Capture errors (N,) of the worse arm from observations (N, size)."""
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


def sensor_columns(model: mujoco.MjModel, measured: tuple[tuple[str, slice], ...]) -> NDArray[np.int64]:
    """Columns of the sensor data that an observation begins with."""
    columns: list[int] = []
    for name, part in measured:
        sensor = model.sensor(name)
        start, size = int(sensor.adr[0]), int(sensor.dim[0])
        columns += list(range(start, start + size))[part]
    return np.array(columns)


@lru_cache(maxsize=16)
def _robot(kind: str, mounts: tuple[tuple[float, float], ...] | None) -> FloatingRobot:
    model = dual_arm_model(DualArmOptions(kind, mounts=mounts))
    return FloatingRobot.from_model(model, end_effectors=END_EFFECTORS)


@lru_cache(maxsize=512)
def _goal_block(
    kind: type[DualArmTask],
    mounts: tuple[tuple[float, float], ...] | None,
    difficulty: str,
    split: str,
    block: int,
) -> TargetGoals:
    """Goals block * BLOCK ... of a split, from seeds alone."""
    rows = slice(block * BLOCK, (block + 1) * BLOCK)
    if mounts is None:
        attempts = frozen_attempts(f"{kind.kind}_{difficulty}_{split}")[rows]
    else:
        attempts = find_attempts(kind, mounts, difficulty, split, block)
    goals = _drawn(
        kind(), _robot(kind.kind, mounts), difficulty, split, np.arange(BLOCK) + rows.start, attempts
    )
    # From the meeting back to the start.
    attitude, spin = tumble(
        goals.quaternion, goals.angular_velocity, np.array(kind.target.inertia), np.array([-MEETING])
    )
    return replace(goals, quaternion=canonical(attitude[:, 0]), angular_velocity=spin[:, 0])


@lru_cache(maxsize=1)
def _frozen() -> dict[str, NDArray[np.int64]]:
    with np.load(str(files("space_envs") / "tasks" / "dual_arm_attempts.npz"), allow_pickle=False) as archive:
        return {name: archive[name].astype(np.int64) for name in archive.files}


def frozen_attempts(name: str) -> NDArray[np.int64]:
    """Which draw of each goal of a split is the first that can be reached, as `freeze.py` found out."""
    return _frozen()[name]


def find_attempts(
    kind: type[DualArmTask],
    mounts: tuple[tuple[float, float], ...] | None,
    difficulty: str,
    split: str,
    block: int,
) -> NDArray[np.int64]:
    """Draw the goals of a block until each can be reached; (BLOCK,) number of draws that were in vain.

    Raises:
        GoalError: if that does not come to an end, or if hardly any draw can be reached with other mounts.
    """
    task, robot = kind(), _robot(kind.kind, mounts)
    attempts, left = np.zeros(BLOCK, dtype=np.int64), np.arange(BLOCK)
    while len(left) and attempts.max() < ATTEMPTS:
        if mounts is not None and attempts[left].min() >= TRIED and BLOCK - len(left) < FEW:
            raise GoalError(f"hardly a goal of {split!r} is in reach with mounts {mounts}: give one to reset")
        # Several attempts at a time where few goals are left: small batches take as long as large ones.
        ahead = np.arange(max(BLOCK // len(left), 1))
        index, attempt = np.repeat(left, len(ahead)), (attempts[left][:, None] + ahead).ravel()
        tried = _drawn(task, robot, difficulty, split, block * BLOCK + index, attempt)
        ok = _reachable(task, robot, tried).reshape(len(left), len(ahead))
        found = ok.any(axis=1)
        attempts[left] += np.where(found, ok.argmax(axis=1), len(ahead))
        left = left[~found]
    if len(left):
        raise GoalError(f"{len(left)} goals of split {split!r} could not be drawn: no candidate is reachable")
    return attempts


def _drawn(
    task: DualArmTask,
    robot: FloatingRobot,
    difficulty: str,
    split: str,
    indices: NDArray[np.int64],
    attempts: NDArray[np.int64],
) -> TargetGoals:
    """Goals (k) as they are at the meeting, from seed, index and attempt."""
    level = DIFFICULTIES.index(difficulty)
    drawn = [
        _draw(task, robot, level, split == "ood", np.random.default_rng([task.seeds[split], level, *pair]))
        for pair in zip(indices.tolist(), attempts.tolist(), strict=True)
    ]
    return TargetGoals(*(np.stack(part) for part in zip(*drawn, strict=True)))


def _draw(
    task: DualArmTask, robot: FloatingRobot, level: int, ood: bool, rng: np.random.Generator
) -> tuple[Array, ...]:
    """Draw the fields of one goal, at the meeting, in the order of `TargetGoals`."""
    draws = task.draws
    scale = rng.uniform(*OOD_MASS) if ood else 1.0
    start = robot.home + draws.start[level] * rng.uniform(-1.0, 1.0, robot.n_joints)
    way = rng.uniform(-1.0, 1.0, 3)
    if task.kind == "planar":
        way[2] = 0.0
    least = 0.0
    if ood:
        way *= rng.uniform(*OOD_FACTOR) / np.abs(way).max()
        least = 1.0
    centre = np.array(draws.centre) + draws.displacement[level] * way
    attitude = task.turned(rng, draws.turn[level])
    spin = task.spun(rng, least * draws.spin[level], (OOD_FACTOR[1] if ood else 1.0) * draws.spin[level])
    return np.array(scale), start, centre, attitude, spin, np.array(rng.uniform(*draws.half_width))


def _reachable(task: DualArmTask, robot: FloatingRobot, goals: TargetGoals) -> NDArray[np.bool_]:
    """Whether a reactionless motion from rest ends at the goals (K), clear of everything at both ends."""
    before, _ = tumble(
        goals.quaternion, goals.angular_velocity, np.array(task.target.inertia), np.array([-MEETING])
    )
    ok = _clear(task, robot, goals.joint_position, goals, before[:, 0], False)
    rows = np.flatnonzero(ok)
    if not len(rows):
        return ok
    goals = goals.take(rows)
    points = goals.position[:, None] + rotate(goals.quaternion[:, None], task.grapples(goals.half_width))
    axes = None if task.way_in is None else rotate(goals.quaternion[:, None], task.way_in)
    found = reach(robot, goals.joint_position, points, axes)
    inside = (found.q > robot.range[:, 0] + LIMIT_MARGIN) & (found.q < robot.range[:, 1] - LIMIT_MARGIN)
    ok[rows] = (found.distance < REACHED[0]) & (found.angle < REACHED[1]) & inside.all(axis=1)
    ok[rows] &= _clear(task, robot, found.q, goals, goals.quaternion, True)
    return ok


def _clear(
    task: DualArmTask, robot: FloatingRobot, q: Array, goals: TargetGoals, attitude: Array, gripper: bool
) -> NDArray[np.bool_]:
    """Whether the arms at q (K, n) keep away from each other, the target and the satellite.

    The base has hardly moved at the start, and by centimetres at the end; the margin covers that.
    """
    return task.gaps(robot, q, goals, attitude, gripper).min(axis=1) > CLEARANCE
