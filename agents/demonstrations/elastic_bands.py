"""Elastic bands (Quinlan and Khatib 1993), batched: detours around artificial obstacles.

The obstacles of shyam2020, sec. IV, lie between start and goal of the end-effector: spheres in task space,
which `task_detour` leads it around. `joint_detour` is another variation: it bends the motion in joint space.
"""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

NODES = 21
TENSION = 0.8  # share of the displacement to the middle of its neighbours that a node makes in an iteration
# Share of its depth in an obstacle that a node is pushed by in an iteration. A stiff band in soft obstacles
# bends over its whole length, which a slow arm can follow.
REPULSION = 0.01
ITERATIONS = 300
FOLLOWING = 8  # Gauss-Newton iterations that bring the end-effector onto a band
DAMPING = 1e-4  # m^2, of these iterations


@dataclass(frozen=True, eq=False)
class BandObstacles:
    """Spheres, one a band: centre (D, m) and radius (D,), in rad in joint space and in m in task space."""

    centre: Array
    radius: Array


@dataclass(frozen=True, eq=False)
class Detour:
    """Displacement (D, T, n) from the straight joint motion, rad, with its derivative by time."""

    position: Array
    velocity: Array


def straight_path(start: Array, goal: Array) -> Array:
    """Points (D, NODES, m) on the lines from start to goal (D, m)."""
    return start[:, None, :] + np.linspace(0.0, 1.0, NODES)[:, None] * (goal - start)[:, None, :]


def relax(path: Array, obstacles: BandObstacles) -> Array:
    """Bands (D, NODES, m) between the ends of paths, in the balance of contraction and repulsion.

    A band rests on its path (D, NODES, m) where there is no obstacle. Both forces act across the band alone,
    so that its nodes stay spread along it.
    """
    band = path.copy()
    centre, radius = obstacles.centre[:, None, :], obstacles.radius[:, None, None]
    for _ in range(ITERATIONS):
        inner, bent = band[:, 1:-1], band - path
        contraction = TENSION * (0.5 * (bent[:, :-2] + bent[:, 2:]) - bent[:, 1:-1])
        away = inner - centre
        distance = np.sqrt((away * away).sum(axis=-1, keepdims=True))
        depth = np.maximum(radius - distance, 0.0)
        force = contraction + REPULSION * depth * away / np.maximum(distance, 1e-9)
        along = band[:, 2:] - band[:, :-2]
        along /= np.maximum(np.sqrt((along * along).sum(axis=-1, keepdims=True)), 1e-9)
        band[:, 1:-1] += force - (force * along).sum(axis=-1, keepdims=True) * along
    return band


def joint_detour(start: Array, goal: Array, obstacles: BandObstacles, progress: Array, dt: float) -> Detour:
    """Detours around spheres in joint space, off the straight motion from start to goal (D, n).

    Args:
        progress: (T,), share of the straight motion that has been made, from 0 to 1. dt: s.
    """
    straight = straight_path(start, goal)
    return _timed(relax(straight, obstacles) - straight, progress, dt)


def task_detour(
    arm: FloatingRobot, start: Array, goal: Array, spheres: BandObstacles, progress: Array, dt: float
) -> Detour:
    """Detours around spheres between the end-effector's points at start and goal (D, n), in the base frame.

    The band starts on the end-effector's path along the straight joint motion; the joints follow it by the
    least displacement, for which the redundant arm uses all of them.

    Args:
        progress: (T,), share of the straight motion that has been made, from 0 to 1. dt: s.
    """
    straight = straight_path(start, goal)
    band = relax(end_effector_path(arm, straight), spheres)
    joints = straight.copy()
    for _ in range(FOLLOWING):
        error = band - end_effector_path(arm, joints)
        jacobian = arm.end_effector_jacobians(joints)[1][..., :3, :]
        square = jacobian @ jacobian.swapaxes(-1, -2) + DAMPING * np.eye(3)
        joints += (jacobian.swapaxes(-1, -2) @ np.linalg.solve(square, error[..., None]))[..., 0]
    joints[:, [0, -1]] = straight[:, [0, -1]]
    return _timed(joints - straight, progress, dt)


def end_effector_path(arm: FloatingRobot, joints: Array) -> Array:
    """Positions (..., 3) m of the end-effector in the base frame, for joint angles (..., n) rad."""
    return arm.end_effector_pose(joints)[0]


def _timed(displacement: Array, progress: Array, dt: float) -> Detour:
    """Displacements (D, NODES, n) off a straight motion as they follow from the progress along it."""
    # Clamped: the detour starts and ends at rest, for any progress.
    spline = CubicSpline(np.linspace(0.0, 1.0, NODES), displacement, axis=1, bc_type="clamped")
    speed = np.gradient(progress, dt)[:, None]
    return Detour(spline(progress), spline(progress, 1) * speed)
