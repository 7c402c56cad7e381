"""Checks of a problem before anything is solved."""

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits, start_beyond_limits
from agents.planners.single_arm.problem import Reach
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import to_matrix
from space_envs.dynamics.spheres import link_ends, sphere_gaps

NO_ROTATION = np.array([1.0, 0.0, 0.0, 0.0])


def infeasible_start(method: str, robot: FloatingRobot, reach: Reach, limits: Limits) -> Failure | None:
    """Failure if a checked problem starts beyond the limits, or starts or ends in a collision."""
    return (
        start_beyond_limits(method, reach.start, limits)
        or _too_fast(method, reach, limits)
        or _collision(method, robot, reach)
    )


def _too_fast(method: str, reach: Reach, limits: Limits) -> Failure | None:
    rate = reach.rate
    if rate is None or limits.rate is None or not (np.abs(rate) > limits.rate).any():
        return None
    joint = int((np.abs(rate) - limits.rate).argmax())
    allowed = float(np.broadcast_to(limits.rate, rate.shape)[joint])
    reason = f"joint {joint + 1} starts at {rate[joint]:.3f} rad/s, {allowed:.4g} are allowed"
    return Failure(method, Cause.INFEASIBLE, reason)


def _collision(method: str, robot: FloatingRobot, reach: Reach) -> Failure | None:
    if reach.spheres is None or not len(reach.spheres):
        return None
    ends = link_ends(robot, reach.start, np.zeros(3), NO_ROTATION)
    radii = np.broadcast_to(reach.link_radius, robot.n_joints)
    places = [("the start", ends)]
    if reach.kind == "pose":  # the pose of the last link at the end follows from the goal
        _, axes = robot.end_effector_pose(reach.start)
        last = reach.end.position + to_matrix(reach.end.quaternion) @ axes.T @ (ends[-2] - ends[-1])
        places.append(("the goal", np.stack([last, reach.end.position])))
    for when, points in places:
        gap = float(sphere_gaps(points, reach.spheres, radii[1 - len(points) :]).min())
        if gap < 0.0:
            reason = f"{when} is in a collision: a link is {-gap:.3f} m deep in a ball"
            return Failure(method, Cause.CLEARANCE, reason)
    return None
