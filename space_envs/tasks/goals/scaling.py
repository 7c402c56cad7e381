"""Draws around the home of any robot: within its joint ranges, at distances that it can reach.

For the robots that the distances were chosen for, all factors are 1.
"""

import numpy as np

from space_envs.drives import STOP_MARGIN
from space_envs.dynamics.rotations import Array
from space_envs.robots.robot import Robot

PEAK_RATE = 15 / 8  # of a minimum-jerk motion, times displacement over duration
PEAK_ACCELERATION = 10 / 3**0.5  # likewise, over the square of the duration


def distance_scale(robot: Robot, reach: float) -> float:
    """Factor up to 1 on distances between bodies, for a robot with shorter arms than `reach`, m."""
    return min(1.0, robot.reach / reach)


def around_home(
    robot: Robot, displacement: Array, radius: float, largest: float = 1.0, duration: float = np.inf
) -> Array:
    """Joint angles (..., n), rad, displaced from home but less where the range of a joint ends.

    Args:
        displacement: (..., n) in -largest to largest. radius: rad, displacement of a joint for 1.
        duration: s, of a minimum-jerk motion to them that the limits of rate and acceleration allow.
    """
    home, ends = robot.home, robot.joint_range
    room = np.array([home - ends[:, 0], ends[:, 1] - home]) - STOP_MARGIN
    fastest = (
        duration / PEAK_RATE * robot.rate_limit,
        duration**2 / PEAK_ACCELERATION * robot.acceleration_limit,
    )
    room = np.minimum(room, np.minimum(*fastest))
    down, up = np.minimum(room / largest, radius)
    return home + np.where(displacement < 0.0, down, up) * displacement
