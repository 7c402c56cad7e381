"""Scenes of keep-out spheres for a goal of the single arm.

A goal is where a minimum-jerk joint motion of the floating robot ends. Spheres are drawn around that motion:
one blocks it, the others lie next to it. `detours` decides which scenes are accepted.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics import minimum_jerk, roll_out_base
from space_envs.dynamics.rotations import Array, from_matrix, multiply, rotate
from space_envs.robots.models import SceneOptions, robot_mechanics, robot_model
from space_envs.robots.robot import Robot
from space_envs.tasks.common import DIFFICULTIES
from space_envs.tasks.contacts import Contacts
from space_envs.tasks.goals.poses import (
    CLEARANCE,
    NODES,
    OOD_MASS,
    OOD_RADIUS,
    REACH,
    ROOM,
    PoseGoals,
    away_from_satellite,
)
from space_envs.tasks.goals.scaling import around_home, distance_scale

COUNT = 3  # spheres
CLUTTERED_SPLIT_SEED = {"train": 20_231, "validation": 20_232, "test": 20_233, "ood": 20_234}
# Half-width of the box around home that goal configurations are drawn from, rad.
CLUTTERED_RADIUS = {"easy": 0.45, "medium": 0.7, "hard": 1.0}
SPHERE_RADIUS = (0.15, 0.35)  # m
OOD_SPHERE_RADIUS = (0.25, 0.45)  # m
BLOCKING, NEARBY = 160, 24  # candidate spheres of a scene: on its motion, one is chosen; next to it, two
FARTHEST = 0.6  # m, largest distance of a nearby sphere from the link that it was drawn at
START_CLEARANCE = 0.10  # m, of links from the spheres at the start
GOAL_CLEARANCE = 0.06  # m, of links from the spheres at the goal
PATH_CLEARANCE = 0.03  # m, of links from the spheres along the detour
BUS_CLEARANCE = 0.30  # m, of the spheres from the bus at the start
SPHERES_APART = 0.05  # m, between the surfaces of two spheres
BLOCKED = 0.03  # m, by which the minimum-jerk motion runs into a sphere
FAR_ENOUGH = 0.40  # m, least displacement of the end-effector to a goal, in the satellite's frame
DURATION = 10.0  # s, of both motions
LIMIT_SHARE = 0.95  # of the limits of rate and acceleration that a detour may use
DETOURS = 32  # candidates per scene
DENSE_NODES = 201  # samples at which a detour is checked
MET = (1e-3, np.deg2rad(0.05))  # m and rad, terminal error of a detour
ATTEMPTS = 4000  # to draw a goal that can be reached


@dataclass(frozen=True)
class ClutteredGoals(PoseGoals):
    """Static grapple poses and keep-out spheres in the inertial frame.

    Attributes:
        obstacle_position: (K, 3, 3) m, centres. obstacle_radius: (K, 3) m.
    """

    obstacle_position: Array
    obstacle_radius: Array

    @property
    def spheres(self) -> Array:
        """(K, 3, 4) centres and radii, for `space_envs.dynamics.spheres`, m."""
        return np.concatenate([self.obstacle_position, self.obstacle_radius[..., None]], axis=-1)


@lru_cache(maxsize=16)
def contacts_of(robot: Robot) -> Contacts:
    """Contact checks of a robot with keep-out spheres."""
    return Contacts.of(robot_model(robot, SceneOptions(obstacles=COUNT)), robot)


def satellite_gaps(robot: Robot, q: Array) -> Array:
    """Gaps (...) in m between the arm at q (..., n) rad and its own satellite."""
    contacts = contacts_of(robot)
    gaps = contacts.satellite_gaps(contacts.points(robot_mechanics(robot), q))
    return gaps.min(axis=-1, initial=np.inf)


def arm_points(robot: Robot, q: Array, base_position: Array, base_quaternion: Array) -> Array:
    """Points (..., P, 3) of the arm in the inertial frame, m.

    Args:
        q: (..., n) rad. base_position: (..., 3) m. base_quaternion: (..., 4), body to inertial.
    """
    points = contacts_of(robot).points(robot_mechanics(robot), q)
    return base_position[..., None, :] + rotate(base_quaternion[..., None, :], points)


def bus_gaps(contacts: Contacts, centre: Array, radius: Array) -> Array:
    """Gaps (...) in m between spheres, centre (..., 3) m and radius (...) m, and the satellite at its initial
    pose."""
    outside = np.maximum(np.abs(contacts.in_box(centre)) - contacts.satellite_half, 0.0)
    return np.linalg.norm(outside, axis=-1) - radius


@dataclass(frozen=True)
class Scenes:
    """K drawn goals, the joint motions that define them, and all candidate spheres.

    Attributes:
        mass_scale: (K,). start, end: (K, n) rad, of the minimum-jerk motions.
        position, quaternion: (K, 3) m and (K, 4), goals. points: (K, T, P, 3) m, of the arm along the
            motions, inertial frame.
        spheres: (K, M, 4) m, the first BLOCKING of them on the motions.
        order: (K, 3), random permutation of the chosen three, so that their order carries no information.
    """

    mass_scale: Array
    start: Array
    end: Array
    position: Array
    quaternion: Array
    points: Array
    spheres: Array
    order: NDArray[np.int64]

    def take(self, rows: NDArray[np.int64]) -> "Scenes":
        """The scenes of rows (k,)."""
        return Scenes(**{name: value[rows] for name, value in vars(self).items()})

    def goals(self, chosen: NDArray[np.int64]) -> ClutteredGoals:
        """Goals with the chosen (K, 3) spheres."""
        chosen = np.take_along_axis(chosen, self.order, axis=1)
        spheres = np.take_along_axis(self.spheres, chosen[..., None], axis=1)
        return ClutteredGoals(
            mass_scale=self.mass_scale,
            joint_position=self.start,
            position=self.position,
            quaternion=self.quaternion,
            obstacle_position=spheres[..., :3],
            obstacle_radius=spheres[..., 3],
        )


def draw_scenes(
    robot: Robot,
    difficulty: str,
    split: str,
    indices: NDArray[np.int64],
    attempts: NDArray[np.int64],
) -> Scenes:
    """Scenes (k) from split, index (k,) and attempt (k,); goals are drawn as those of the single arm."""
    k, n, m, ood = len(indices), robot.n_joints, BLOCKING + NEARBY, split == "ood"
    mechanics, scale, capsules = (
        robot_mechanics(robot),
        distance_scale(robot, REACH),
        contacts_of(robot).near_others,
    )
    displacement, mass_scale = np.empty((k, n)), np.ones(k)
    place, away, radius = np.empty((k, m, 3)), np.empty((k, m, 3)), np.empty((k, m))
    order = np.empty((k, COUNT), dtype=np.int64)
    last = len(capsules.link) - 1
    for row, rng in enumerate(generators(difficulty, split, indices, attempts)):
        displacement[row] = rng.uniform(-1.0, 1.0, n)
        if ood:
            displacement[row] *= rng.uniform(*OOD_RADIUS) / np.abs(displacement[row]).max()
            mass_scale[row] = rng.uniform(*OOD_MASS)
        order[row] = rng.permutation(COUNT)
        # Time, capsule (not the first, if there are more), point on it; displacement from that point.
        place[row] = rng.uniform([0.2, 2.0, 0.0], [0.8, 2.0 + max(last, 1), 1.0], (m, 3))
        place[row, : BLOCKING // 2, 1] = 1 + last  # the last one goes farthest
        radius[row] = scale * rng.uniform(*(OOD_SPHERE_RADIUS if ood else SPHERE_RADIUS), m)
        direction = rng.normal(size=(m, 3))
        number = np.minimum(place[row, :, 1].astype(np.int64) - 1, last)
        share, reach = rng.uniform(0.0, 1.0, m), radius[row] + capsules.radius[number]
        over = np.sqrt(share) * (reach - scale * BLOCKED)  # the ends of the motion must be clear
        distance = np.where(np.arange(m) < BLOCKING, over, reach + share * (scale * FARTHEST))
        away[row] = direction * (distance / np.linalg.norm(direction, axis=-1))[:, None]
    start = np.broadcast_to(mechanics.home, (k, n))
    most = OOD_RADIUS[1] if ood else 1.0
    end = around_home(robot, displacement, CLUTTERED_RADIUS[difficulty], most, DURATION)
    path, rate, dt = minimum_jerk(start, end, DURATION, NODES)
    position, quaternion = roll_out_base(mechanics, path, rate, dt)
    points = arm_points(robot, path, position, quaternion)
    node = np.rint(place[..., 0] * (NODES - 1)).astype(np.int64)
    number = np.minimum(place[..., 1].astype(np.int64) - 1, last)
    rows = np.arange(k)[:, None]
    near, far = (points[rows, node, ends[number]] for ends in (capsules.start, capsules.end))
    centre = near + place[..., 2:] * (far - near) + away
    local = mechanics.end_effector_pose(path[:, -1])[0]
    rotated = multiply(quaternion[:, -1], from_matrix(mechanics.end_effector_pose(end)[1]))
    return Scenes(
        mass_scale=mass_scale,
        start=start,
        end=end,
        position=position[:, -1] + rotate(quaternion[:, -1], local),
        quaternion=np.where(rotated[:, :1] < 0, -rotated, rotated),
        points=points,
        spheres=np.concatenate([centre, radius[..., None]], axis=-1),
        order=order,
    )


def generators(
    difficulty: str, split: str, indices: NDArray[np.int64], attempts: NDArray[np.int64], *more: int
) -> Iterator[np.random.Generator]:
    level = DIFFICULTIES.index(difficulty)
    for index, attempt in zip(indices.tolist(), attempts.tolist(), strict=True):
        yield np.random.default_rng([CLUTTERED_SPLIT_SEED[split], level, index, attempt, *more])


def choose_spheres(robot: Robot, scenes: Scenes) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Compatible spheres (K, 3), the first of which blocks the motion; (K,) bool, whether there are any."""
    spheres, k, scale = scenes.spheres, len(scenes.end), distance_scale(robot, REACH)
    mechanics, contacts = robot_mechanics(robot), contacts_of(robot)
    end_effector, start = (mechanics.end_effector_pose(q)[0] for q in (scenes.end, mechanics.home))
    goal = away_from_satellite(contacts, end_effector, scale * CLEARANCE)
    goal &= np.linalg.norm(end_effector - start, axis=-1) > scale * FAR_ENOUGH
    goal &= satellite_gaps(robot, scenes.end) > ROOM
    at_ends = contacts.sphere_gaps(scenes.points[:, [0, -1]], spheres[:, None]).min(axis=2)
    feasible = (at_ends > [[scale * START_CLEARANCE], [scale * GOAL_CLEARANCE]]).all(axis=1)
    feasible &= bus_gaps(contacts, spheres[..., :3], spheres[..., 3]) > scale * BUS_CLEARANCE
    feasible &= goal[:, None]
    chosen = np.zeros((k, COUNT), dtype=np.int64)
    found = feasible[:, :BLOCKING].any(axis=1)
    chosen[:, 0] = feasible[:, :BLOCKING].argmax(axis=1)
    feasible[:, :BLOCKING] = False
    for place in range(1, COUNT):
        last = np.take_along_axis(spheres, chosen[:, place - 1, None, None], axis=1)
        apart = np.linalg.norm(spheres[..., :3] - last[..., :3], axis=-1) - spheres[..., 3] - last[..., 3]
        feasible &= apart > scale * SPHERES_APART
        found &= feasible.any(axis=1)
        chosen[:, place] = feasible.argmax(axis=1)
    return chosen, found
