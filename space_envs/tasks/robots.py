"""Checks that a robot is one for a task, its default control period, and the room that it needs."""

from functools import lru_cache

import numpy as np

from space_envs.drives import STOP_MARGIN
from space_envs.errors import ConfigurationError, UnfitRobotError
from space_envs.robots.robot import Robot, StepLimits

LEAST_TIMESTEP = 1e-4  # s; finer steps change nothing, and a control period of them takes minutes
LEAST_JOINTS = {True: 3, False: 6}  # of an arm in the plane and in space, that can reach poses nearby
USUAL_PERIOD = 0.1  # s
USUAL_EXTENT = 5.0  # m from the satellite's centre of mass, for which bounds of observed positions are 10 m
_COUNTS = {1: "one arm", 2: "two arms"}


def check_robot(robot: Robot, arms: int, planar: bool, task: str) -> None:
    """Reject a robot that a task cannot be for.

    Args:
        arms: how many it needs. planar: whether in the plane. task: its name, for messages.

    Raises:
        UnfitRobotError: for another number of arms or too few joints.
        ConfigurationError: for a home at the end of a range.
    """
    kind, needed = (_words(*pair) for pair in ((len(robot.arms), robot.planar), (arms, planar)))
    if kind != needed:
        raise UnfitRobotError(task, f"needs a robot with {needed}, {robot.name!r} has {kind}")
    least = LEAST_JOINTS[planar]
    for arm in robot.arms:
        if len(arm.links) < least:
            raise UnfitRobotError(
                task,
                f"needs arms of at least {least} joints {'in the plane' if planar else 'in space'}, "
                f"{robot.name!r} has one of {len(arm.links)}",
            )
    room = np.abs(robot.joint_range - robot.home[:, None]).min(axis=1)
    outside = (robot.home <= robot.joint_range[:, 0]) | (robot.home >= robot.joint_range[:, 1])
    if (outside | (room <= STOP_MARGIN)).any():
        joint = robot.joints[int(np.where(outside, -1.0, room).argmin())]
        raise ConfigurationError(
            f"home of joint {joint.name!r} of {robot.name!r}, {joint.home:.6g} rad, must be more than "
            f"{STOP_MARGIN:g} rad inside its range {list(joint.range)}, where the drives stop it"
        )


def _words(arms: int, planar: bool) -> str:
    return f"{_COUNTS.get(arms, f'{arms} arms')} in {'the plane' if planar else 'space'}"


def usual_period(steps: StepLimits) -> float:
    """Default control period, s: whole steps of the simulation, up to 0.1 s."""
    longest = min(USUAL_PERIOD, steps.largest_control_period)
    return max(int(longest / steps.default_timestep + 1e-9), 1) * steps.default_timestep


@lru_cache(maxsize=64)
def length_factor(robot: Robot) -> float:
    """Factor from 1 on the bounds of observed positions, for robots that reach farther than usual."""
    mounts = [float(np.linalg.norm(arm.links[0].position)) for arm in robot.arms]
    return max(1.0, (robot.reach + max(mounts)) / USUAL_EXTENT)
