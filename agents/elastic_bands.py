"""Elastic bands (Quinlan and Khatib 1993) in joint space, batched: detours around artificial obstacles."""

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from space_envs.dynamics.rotations import Array

NODES = 21
TENSION = 0.8  # share of the way to the middle of its neighbours that a node goes in an iteration
# Share of its depth in an obstacle that a node is pushed by in an iteration. A stiff band in soft obstacles
# bends over its whole length, which a slow arm can follow.
REPULSION = 0.01
ITERATIONS = 300


@dataclass(frozen=True, eq=False)
class Obstacles:
    """Balls in joint space, one a band: centre (D, n) rad and radius (D,) rad."""

    centre: Array
    radius: Array


@dataclass(frozen=True, eq=False)
class Detour:
    """Displacement (D, T, n) from the straight way, rad, with its first and second time derivatives."""

    position: Array
    velocity: Array
    acceleration: Array


def relax(start: Array, goal: Array, obstacles: Obstacles) -> Array:
    """Bands (D, NODES, n) from start to goal (D, n), in the balance of contraction and repulsion.

    Both forces act across the band alone, so that its nodes stay spread along it.
    """
    s = np.linspace(0.0, 1.0, NODES)[:, None]
    straight = start[:, None, :] + s * (goal - start)[:, None, :]
    band = straight.copy()
    centre, radius = obstacles.centre[:, None, :], obstacles.radius[:, None, None]
    for _ in range(ITERATIONS):
        inner = band[:, 1:-1]
        contraction = TENSION * (0.5 * (band[:, :-2] + band[:, 2:]) - inner)
        away = inner - centre
        distance = np.sqrt((away * away).sum(axis=-1, keepdims=True))
        depth = np.maximum(radius - distance, 0.0)
        force = contraction + REPULSION * depth * away / np.maximum(distance, 1e-9)
        along = band[:, 2:] - band[:, :-2]
        along /= np.maximum(np.sqrt((along * along).sum(axis=-1, keepdims=True)), 1e-9)
        band[:, 1:-1] += force - (force * along).sum(axis=-1, keepdims=True) * along
    return band


def detour(start: Array, goal: Array, obstacles: Obstacles, progress: Array, dt: float) -> Detour:
    """How far bands lead off the straight way, of which `progress` (T,), from 0 to 1, has been made."""
    s = np.linspace(0.0, 1.0, NODES)
    straight = start[:, None, :] + s[:, None] * (goal - start)[:, None, :]
    # Clamped: the detour begins and ends at rest, whatever the progress does there.
    spline = CubicSpline(s, relax(start, goal, obstacles) - straight, axis=1, bc_type="clamped")
    speed = np.gradient(progress, dt)[:, None]
    change = np.gradient(speed[:, 0], dt)[:, None]
    slope, curvature = spline(progress, 1), spline(progress, 2)
    return Detour(spline(progress), slope * speed, curvature * speed**2 + slope * change)
