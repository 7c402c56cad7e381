"""Static grapple poses of the single arm: final poses of minimum-jerk motions of the floating robot."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics import minimum_jerk, roll_out_base
from space_envs.dynamics.rotations import Array, from_matrix, multiply, rotate
from space_envs.errors import GoalError
from space_envs.robots.models import robot_mechanics, robot_model
from space_envs.robots.robot import Robot
from space_envs.tasks.base import BLOCK
from space_envs.tasks.common import DIFFICULTIES, Goals
from space_envs.tasks.contacts import Contacts
from space_envs.tasks.goals.scaling import around_home, distance_scale

# Half-width of the box around home that goal configurations are drawn from, rad.
RADIUS = {"easy": 0.3, "medium": 0.6, "hard": 1.0}
SPLIT_SIZE = {"train": 4096, "validation": 256, "test": 512, "ood": 512}
SPLIT_SEED = {"train": 20_201, "validation": 20_202, "test": 20_203, "ood": 20_204}
OOD_RADIUS = (1.0, 1.3)  # times the difficulty's radius: range of the largest joint displacement
OOD_MASS = (0.8, 1.2)  # factor on the satellite's mass and inertia
NODES, DURATION = 41, 10.0  # samples and s, of the minimum-jerk motion whose end defines a goal
REACH = 4.5  # m, of arms for which distances are those below; they are shorter for shorter arms
CLEARANCE = 0.25  # m, of a goal from the satellite
NEAREST = 0.15  # m, least distance of a goal from the end-effector's start
DRAWS, CANDIDATES = 16, 1024  # configurations drawn at once, and at most, for a goal
ROOM = 0.005  # m, between links and satellite in the configuration that a goal is drawn from


@dataclass(frozen=True)
class PoseGoals(Goals):
    """Static grapple poses in the inertial frame.

    Attributes:
        position: (K, 3) m. quaternion: (K, 4), grapple to inertial.
    """

    position: Array
    quaternion: Array


@dataclass(frozen=True)
class MovingPoseGoals(PoseGoals):
    """Grapple poses at the start of an episode, with their twists.

    Attributes:
        linear_velocity, angular_velocity: (K, 3) of the grapple, inertial axes, m/s and rad/s.
    """

    linear_velocity: Array
    angular_velocity: Array


@lru_cache(maxsize=512)
def goal_configurations(robot: Robot, difficulty: str, split: str, block: int) -> tuple[Array, Array]:
    """Joint angles (BLOCK, n), rad, that define the goals of a block, and factors (BLOCK,) on the satellite's
    mass, drawn from seeds.

    They are drawn around home until the end-effector is away from the satellite and from its start, and the
    minimum-jerk joint motion from home is clear of the satellite.

    Raises:
        GoalError: if a goal has no such configuration among `CANDIDATES`.
    """
    generators = [
        np.random.default_rng([SPLIT_SEED[split], DIFFICULTIES.index(difficulty), block * BLOCK + row])
        for row in range(BLOCK)
    ]
    chosen, mass_scale = np.empty((BLOCK, robot.n_joints)), np.ones(BLOCK)
    remaining = np.arange(BLOCK)
    for batch in range(CANDIDATES // DRAWS):
        displacement = np.empty((len(remaining), DRAWS, robot.n_joints))
        for place, row in enumerate(remaining):
            rng = generators[row]
            displacement[place] = rng.uniform(-1.0, 1.0, displacement.shape[1:])
            if split == "ood":
                largest = np.abs(displacement[place]).max(axis=1, keepdims=True)
                displacement[place] *= rng.uniform(*OOD_RADIUS, (DRAWS, 1)) / largest
                if batch == 0:
                    mass_scale[row] = rng.uniform(*OOD_MASS)
        most = OOD_RADIUS[1] if split == "ood" else 1.0
        q = around_home(robot, displacement, RADIUS[difficulty], most, DURATION)
        candidate, found = _first_usable(robot, q)
        chosen[remaining[found]] = q[found, candidate[found]]
        remaining = remaining[~found]
        if not len(remaining):
            return chosen, mass_scale
    raise GoalError(
        f"{len(remaining)} of {BLOCK} goals of split {split!r}, difficulty {difficulty!r}, could not be "
        f"drawn for {robot.name!r}: in {CANDIDATES} configurations within {RADIUS[difficulty]:g} rad of home "
        "the end-effector is close to the satellite or to its start, or the motion there touches the "
        "satellite. Choose a home farther from the satellite and from the ends of the joint ranges, or "
        "another mount"
    )


def _first_usable(robot: Robot, q: Array) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Index (K,) of the first of the configurations q (K, D, n), rad, that may define a goal; (K,) bool,
    whether there is one."""
    mechanics, contacts = robot_mechanics(robot), Contacts.of(robot_model(robot), robot)
    scale = distance_scale(robot, REACH)
    end_effector = mechanics.end_effector_pose(q)[0]
    start = mechanics.end_effector_pose(mechanics.home)[0]
    # Poses are tested in the base frame: the base moves much less than the margin.
    clear = away_from_satellite(contacts, end_effector, scale * CLEARANCE)
    usable = clear & (np.linalg.norm(end_effector - start, axis=-1) > scale * NEAREST)
    usable &= contacts.satellite_gaps(contacts.points(mechanics, q)).min(axis=-1, initial=np.inf) > ROOM
    row = np.arange(len(q))
    while True:
        candidate, found = usable.argmax(axis=1), usable.any(axis=1)
        path, _, _ = minimum_jerk(mechanics.home, q[row[found], candidate[found]], DURATION, NODES)
        gap = contacts.satellite_gaps(contacts.points(mechanics, path))
        blocked = np.flatnonzero(found)[gap.min(axis=(1, 2), initial=np.inf) <= 0.0]
        if not len(blocked):
            return candidate, found
        usable[blocked, candidate[blocked]] = False


def away_from_satellite(contacts: Contacts, position: Array, distance: float) -> NDArray[np.bool_]:
    """Whether positions (..., 3) in the satellite's frame are farther from its box than a distance, m."""
    outside = np.abs(contacts.in_box(position)) > contacts.satellite_half + distance
    return np.asarray(outside.any(axis=-1))


@lru_cache(maxsize=512)
def goal_block(robot: Robot, difficulty: str, split: str, block: int) -> PoseGoals:
    """Goals block * BLOCK to (block + 1) * BLOCK - 1 of a split.

    A goal is the final pose of the end-effector of a minimum-jerk joint motion from home to a drawn
    configuration, with a free-floating base, so every goal is reachable.
    """
    mechanics = robot_mechanics(robot)
    chosen, mass_scale = goal_configurations(robot, difficulty, split, block)
    path, rate, dt = minimum_jerk(mechanics.home, chosen, DURATION, NODES)
    position, quaternion = roll_out_base(mechanics, path, rate, dt)
    local_position, local_rotation = mechanics.end_effector_pose(chosen)
    goal_quaternion = multiply(quaternion[:, -1], from_matrix(local_rotation))
    return PoseGoals(
        joint_position=np.broadcast_to(mechanics.home, (BLOCK, robot.n_joints)),
        position=position[:, -1] + rotate(quaternion[:, -1], local_position),
        quaternion=np.where(goal_quaternion[:, :1] < 0, -goal_quaternion, goal_quaternion),
        mass_scale=mass_scale,
    )
