"""Detours around keep-out spheres, which prove that a goal of the single arm is reachable.

A detour is a minimum-jerk joint motion with a bump on it, whose end is corrected until it meets the inertial
goal; a scene is accepted if one of its candidate detours is clear of all spheres and within the limits of
rate and acceleration.
"""

import numpy as np
from numpy.typing import NDArray

from space_envs.drives import STOP_MARGIN
from space_envs.dynamics import FloatingRobot, minimum_jerk, roll_out_base
from space_envs.dynamics.rotations import Array, conjugate, from_matrix, logarithm, multiply, rotate
from space_envs.errors import GoalError
from space_envs.robots.models import robot_mechanics
from space_envs.robots.robot import Robot
from space_envs.tasks.base import BLOCK
from space_envs.tasks.goals.clutter import (
    ATTEMPTS,
    COUNT,
    DENSE_NODES,
    DETOURS,
    DURATION,
    LIMIT_SHARE,
    MET,
    PATH_CLEARANCE,
    ClutteredGoals,
    Scenes,
    arm_points,
    choose_spheres,
    contacts_of,
    draw_scenes,
    generators,
    satellite_gaps,
)
from space_envs.tasks.goals.poses import NODES, REACH, ROOM
from space_envs.tasks.goals.scaling import distance_scale
from space_envs.tasks.goals.stored import search_bar


def detour(start: Array, end: Array, via: Array, nodes: int) -> tuple[Array, Array, float]:
    """Minimum-jerk joint motion with a bump on it, at rest at both ends.

    Args:
        start, end: (..., n) rad. via: (..., n) rad from the straight path at half time. nodes: T.

    Returns:
        q, qdot (..., T, n) rad and rad/s, and the sampling period, s.
    """
    q, qdot, dt = minimum_jerk(start, end, DURATION, nodes)
    s = np.linspace(0.0, 1.0, nodes)[:, None]
    bump, slope = 64.0 * (s * (1.0 - s)) ** 3, 192.0 * (s * (1.0 - s)) ** 2 * (1.0 - 2.0 * s) / DURATION
    return q + bump * via[..., None, :], qdot + slope * via[..., None, :], dt


def draw_detours(
    robot: Robot,
    scenes: Scenes,
    difficulty: str,
    split: str,
    indices: NDArray[np.int64],
    attempts: NDArray[np.int64],
) -> Array:
    """Bumps (k, DETOURS, n), rad, of the candidate detours of scenes (k)."""
    vias = np.empty((len(indices), DETOURS, scenes.end.shape[1]))
    for row, rng in enumerate(generators(difficulty, split, indices, attempts, 1)):
        vias[row] = rng.uniform(-1.0, 1.0, vias.shape[1:])
    # Every second candidate displaces only a few joints.
    vias[:, ::2] *= np.abs(vias[:, ::2]) > 0.5
    # The bump is steepest, 3.43 / DURATION, where the motion covers 1.20 / DURATION of its path a second.
    spare = LIMIT_SHARE * robot.rate_limit * DURATION - 1.2 * np.abs(scenes.end - scenes.start)
    return vias * spare[:, None] / 3.43


def correct_detours(
    robot: Robot, goals: ClutteredGoals, end: Array, via: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """End configurations (K, n), rad, for which the detours via (K, n) end at the goals.

    Also (K,) bool, whether the detours are valid: end at the goals, are within the limits of rate and
    acceleration, and are clear of the spheres and the satellite throughout.

    Args:
        end: (K, n) rad, initial guess of the end configurations. via: (K, n) rad, as in `detour`.
    """
    mechanics = robot_mechanics(robot)
    for _ in range(8):
        q, qdot, dt = detour(goals.joint_position, end, via, NODES)
        position, quaternion = _roll_out(mechanics, q, qdot, dt, goals.mass_scale)
        error = _pose_error(mechanics, goals, end, position[:, -1], quaternion[:, -1])
        end = end + (np.linalg.pinv(mechanics.generalized_jacobian(end)) @ error[..., None])[..., 0]
    q, qdot, dt = detour(goals.joint_position, end, via, DENSE_NODES)
    position, quaternion = _roll_out(mechanics, q, qdot, dt, goals.mass_scale)
    error = _pose_error(mechanics, goals, end, position[:, -1], quaternion[:, -1])
    points = arm_points(robot, q, position, quaternion)
    gap = contacts_of(robot).sphere_gaps(points, goals.spheres[:, None]).min(axis=(1, 2, 3))
    acceleration = np.diff(qdot, axis=1) / dt
    return end, (
        (np.linalg.norm(error[:, :3], axis=-1) < MET[0])
        & (np.linalg.norm(error[:, 3:], axis=-1) < MET[1])
        & (np.abs(qdot) < LIMIT_SHARE * robot.rate_limit).all(axis=(1, 2))
        & (np.abs(acceleration) < LIMIT_SHARE * robot.acceleration_limit).all(axis=(1, 2))
        & _within_stops(robot, q)
        & (gap > distance_scale(robot, REACH) * PATH_CLEARANCE)
        & (satellite_gaps(robot, q).min(axis=-1) > 0.0)
        & (satellite_gaps(robot, end) > ROOM)
    )


def find_draws(robot: Robot, difficulty: str, split: str, block: int) -> NDArray[np.int64]:
    """Draw numbers (BLOCK, 2 + COUNT) of the first reachable draw of each goal of a block.

    They are the numbers of the scene, of the detour that ends at the goal, and of the three spheres.

    Raises:
        GoalError: if some goal has no reachable draw.
    """
    found = np.zeros((BLOCK, 2 + COUNT), dtype=np.int64)
    remaining = np.arange(BLOCK)
    bar = search_bar(robot)
    while len(remaining) and found[remaining, 0].max() < ATTEMPTS:
        # Several attempts at a time when few goals remain: small batches take as long as large ones.
        ahead = np.arange(max(BLOCK // len(remaining), 1))
        index = np.repeat(block * BLOCK + remaining, len(ahead))
        attempt = (found[remaining, :1] + ahead).ravel()
        scenes = draw_scenes(robot, difficulty, split, index, attempt)
        spheres, ok = choose_spheres(robot, scenes)
        rows = np.flatnonzero(ok)
        usable = scenes.take(rows)
        vias = draw_detours(robot, usable, difficulty, split, index[rows], attempt[rows])
        number, ok[rows] = _search(robot, usable, spheres[rows], vias)
        detours = np.zeros(len(index), dtype=np.int64)
        detours[rows] = number
        ok = ok.reshape(len(remaining), len(ahead))
        first = np.arange(len(remaining)) * len(ahead) + ok.argmax(axis=1)
        some = ok.any(axis=1)
        found[remaining] = np.column_stack([attempt[first], detours[first], spheres[first]])
        found[remaining[~some], 0] = attempt.reshape(ok.shape)[~some, -1] + 1
        remaining = remaining[~some]
        bar.update(int(some.sum()))
    bar.close()
    if len(remaining):
        raise GoalError(
            f"{len(remaining)} of {BLOCK} goals of split {split!r}, difficulty {difficulty!r}, could not be "
            f"drawn for {robot.name!r}: in {ATTEMPTS} scenes no motion reaches the goal clear of the spheres "
            "within its limits. Choose a home with more room around the arm, or higher limits of rate and "
            "acceleration"
        )
    return found


def _search(
    robot: Robot, scenes: Scenes, spheres: NDArray[np.int64], vias: Array
) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """Index (K,) of the detour with the largest gap among via (K, D, n), and whether it is valid (K,)."""
    if not len(vias):
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.bool_)
    goals = scenes.goals(spheres)
    q, qdot, dt = detour(goals.joint_position[:, None], scenes.end[:, None], vias, NODES // 2 + 1)
    position, quaternion = roll_out_base(robot_mechanics(robot), q, qdot, dt)
    points = arm_points(robot, q, position, quaternion)
    gap = contacts_of(robot).sphere_gaps(points, goals.spheres[:, None, None]).min(axis=(2, 3, 4))
    gap[satellite_gaps(robot, q).min(axis=-1) <= 0.0] = -1.0
    gap[(np.abs(qdot) > LIMIT_SHARE * robot.rate_limit).any(axis=(2, 3))] = -1.0
    gap[~_within_stops(robot, q)] = -1.0
    number = gap.argmax(axis=1)
    best = vias[np.arange(len(vias)), number]
    return number, correct_detours(robot, goals, scenes.end, best)[1]


def _within_stops(robot: Robot, q: Array) -> NDArray[np.bool_]:
    """Whether motions (..., T, n), rad, stay inside the angles that the drives allow, (...)."""
    low, high = robot.joint_range.T
    return ((q > low + STOP_MARGIN) & (q < high - STOP_MARGIN)).all(axis=(-1, -2))


def _pose_error(
    mechanics: FloatingRobot, goals: ClutteredGoals, end: Array, position: Array, quaternion: Array
) -> Array:
    """Error (K, 6) [m; rad] from the end-effectors to the goals, base axes."""
    end_effector, rotation = mechanics.end_effector_pose(end)
    back = conjugate(quaternion)
    rotation_vector = logarithm(multiply(multiply(back, goals.quaternion), conjugate(from_matrix(rotation))))
    return np.concatenate([rotate(back, goals.position - position) - end_effector, rotation_vector], axis=-1)


def _roll_out(
    mechanics: FloatingRobot, q: Array, qdot: Array, dt: float, mass_scale: Array
) -> tuple[Array, Array]:
    """`roll_out_base` of satellites whose mass and inertia are scaled by (K,)."""
    if (mass_scale == 1.0).all():
        return roll_out_base(mechanics, q, qdot, dt)
    base, coupling = mechanics.momentum_matrices(q)
    own = np.zeros((6, 6))  # of the satellite, whose frame is at its centre of mass
    own[range(3), range(3)] = mechanics.mass[0]
    own[3:, 3:] = mechanics.inertia[0]
    base = base + (mass_scale - 1.0)[:, None, None, None] * own
    twist = -np.linalg.solve(base, coupling @ qdot[..., None])[..., 0]
    return roll_out_base(mechanics, q, qdot, dt, twist=twist)
