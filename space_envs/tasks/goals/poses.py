"""Static grapple poses of the single arm: final poses of minimum-jerk motions of the floating robot."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from space_envs.dynamics import FloatingRobot, minimum_jerk, roll_out_base
from space_envs.dynamics.rotations import Array, from_matrix, multiply, rotate
from space_envs.errors import GoalError
from space_envs.robots.capsules import SINGLE_ARM_SHAPE
from space_envs.robots.parameters import SINGLE_ARM
from space_envs.robots.single_arm import ModelOptions, single_arm_model
from space_envs.tasks.base import BLOCK
from space_envs.tasks.common import DIFFICULTIES, Goals
from space_envs.tasks.contacts import Contacts

# Half-width of the box around home that goal configurations are drawn from, rad.
RADIUS = {"easy": 0.3, "medium": 0.6, "hard": 1.0}
SPLIT_SIZE = {"train": 4096, "validation": 256, "test": 512, "ood": 512}
SPLIT_SEED = {"train": 20_201, "validation": 20_202, "test": 20_203, "ood": 20_204}
OOD_RADIUS = (1.0, 1.3)  # times the difficulty's radius: range of the largest joint displacement
OOD_MASS = (0.8, 1.2)  # factor on the satellite's mass and inertia
NODES, DURATION = 41, 10.0  # samples and s, of the minimum-jerk motion whose end defines a goal
CLEARANCE = 0.25  # m, of a goal from the bus
NEAREST = 0.15  # m, least distance of a goal from the end-effector's start
ROOM = 0.005  # m, between links and satellite in the configuration that a goal is drawn from


@dataclass(frozen=True)
class PoseGoals(Goals):
    """Static grapple poses in the inertial frame.

    Attributes:
        position: (K, 3) m. quaternion: (K, 4), grapple to inertial.
    """

    position: Array
    quaternion: Array


@lru_cache(maxsize=4)
def robot_of(variant: str) -> FloatingRobot:
    """The robot of a model variant."""
    return FloatingRobot.from_model(single_arm_model(ModelOptions(variant)))


@lru_cache(maxsize=512)
def goal_configurations(variant: str, difficulty: str, split: str, block: int) -> tuple[Array, Array]:
    """Joint angles (BLOCK, n), rad, that define the goals of a block, and factors (BLOCK,) on the satellite's
    mass, drawn from seeds.

    They are drawn around home until the end-effector is away from the satellite and from its start, and the
    minimum-jerk joint motion from home is clear of the satellite.
    """
    robot = robot_of(variant)
    contacts = Contacts.of(single_arm_model(ModelOptions(variant)), SINGLE_ARM_SHAPE)
    draws = 16
    displacement = np.empty((BLOCK, draws, robot.n_joints))
    mass_scale = np.ones(BLOCK)
    for row in range(BLOCK):
        rng = np.random.default_rng([SPLIT_SEED[split], DIFFICULTIES.index(difficulty), block * BLOCK + row])
        displacement[row] = rng.uniform(-1.0, 1.0, (draws, robot.n_joints))
        if split == "ood":
            largest = np.abs(displacement[row]).max(axis=1, keepdims=True)
            displacement[row] *= rng.uniform(*OOD_RADIUS, (draws, 1)) / largest
            mass_scale[row] = rng.uniform(*OOD_MASS)
    q = robot.home + RADIUS[difficulty] * displacement
    end_effector = robot.end_effector_pose(q)[0]
    start = robot.end_effector_pose(robot.home)[0]
    # Poses are tested in the base frame: the base moves much less than the margin.
    clear = np.abs(end_effector).max(axis=-1) > SINGLE_ARM.satellite_side / 2 + CLEARANCE
    usable = clear & (np.linalg.norm(end_effector - start, axis=-1) > NEAREST)
    usable &= contacts.satellite_gaps(contacts.points(robot, q)).min(axis=(-1, -2)) > ROOM
    while True:
        if not usable.any(axis=1).all():
            raise GoalError(
                "a goal could not be drawn: every candidate lies in the satellite or at the start"
            )
        row, candidate = np.arange(BLOCK), usable.argmax(axis=1)
        path, _, _ = minimum_jerk(robot.home, q[row, candidate], DURATION, NODES)
        blocked = contacts.satellite_gaps(contacts.points(robot, path)).min(axis=(1, 2, 3)) <= 0.0
        if not blocked.any():
            return q[row, candidate], mass_scale
        usable[row[blocked], candidate[blocked]] = False


@lru_cache(maxsize=512)
def goal_block(variant: str, difficulty: str, split: str, block: int) -> PoseGoals:
    """Goals block * BLOCK to (block + 1) * BLOCK - 1 of a split.

    A goal is the final pose of the end-effector of a minimum-jerk joint motion from home to a drawn
    configuration, with a free-floating base, so every goal is reachable.
    """
    robot = robot_of(variant)
    chosen, mass_scale = goal_configurations(variant, difficulty, split, block)
    path, rate, dt = minimum_jerk(robot.home, chosen, DURATION, NODES)
    position, quaternion = roll_out_base(robot, path, rate, dt)
    local_position, local_rotation = robot.end_effector_pose(chosen)
    goal_quaternion = multiply(quaternion[:, -1], from_matrix(local_rotation))
    return PoseGoals(
        joint_position=np.broadcast_to(robot.home, (BLOCK, robot.n_joints)),
        position=position[:, -1] + rotate(quaternion[:, -1], local_position),
        quaternion=np.where(goal_quaternion[:, :1] < 0, -goal_quaternion, goal_quaternion),
        mass_scale=mass_scale,
    )
