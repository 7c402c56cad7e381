"""Accelerations that the torques of a robot's joints give its whole arm, floating freely."""

from collections.abc import Iterable
from dataclasses import replace
from functools import lru_cache

import mujoco
import numpy as np

from space_envs.dynamics.rotations import Array
from space_envs.robots.models.bodies import add_robot, empty_spec
from space_envs.robots.robot import Arm, Robot

CONFIGURATIONS = 500
SHORTEST_START = 1.0  # s from rest to the rate limit, ten control periods of 0.1 s


def default_acceleration(robot: Robot) -> tuple[float, ...]:
    """Acceleration limit (n) of a robot that has none, rad/s^2.

    It is the largest that all joints can have at once, in any direction, at home and at 500 random
    configurations: the least of tau_i / sum_j |M*_ij| over joints i and configurations, with the torque
    limits tau and the joints' mass matrix M* of the floating robot. No joint gets more than its rate limit in
    half a second.

    Args:
        robot: its acceleration limits are not used.
    """
    able = float((robot.torque_limit / np.abs(reduced_masses(robot)).sum(axis=2)).min())
    return tuple(np.minimum(able, robot.rate_limit / SHORTEST_START).tolist())


def with_accelerations(robot: Robot) -> Robot:
    """The robot with default acceleration limits where it has none (NaN), and a note that says so."""
    missing = np.isnan(robot.acceleration_limit)
    if not missing.any():
        return robot
    limits = np.where(missing, default_acceleration(robot), robot.acceleration_limit)
    values = iter(limits.tolist())
    arms = tuple(_limited(arm, values) for arm in robot.arms)
    names = [joint.name for joint, lacks in zip(robot.joints, missing, strict=True) if lacks]
    least, most = limits[missing].min(), limits[missing].max()
    figure = f"{least:.3g}" if least == most else f"{least:.3g} to {most:.3g}"
    note = (
        f"{', '.join(names)} have no acceleration limits and get {figure} rad/s^2: what the torque limits "
        "give the whole arm in any direction, but no more than the rate limit in a second."
    )
    return replace(robot, arms=arms, notes=(*robot.notes, note))


def _limited(arm: Arm, accelerations: Iterable[float]) -> Arm:
    """The arm with the next acceleration limits, one for each joint."""
    links = [
        replace(link, joint=replace(link.joint, acceleration_limit=limit))
        for link, limit in zip(arm.links, accelerations, strict=False)
    ]
    return replace(arm, links=tuple(links))


@lru_cache(maxsize=8)
def reduced_masses(robot: Robot) -> Array:
    """M* (K, n, n) at home and at random configurations, kg m^2: the mass matrix with the base eliminated.

    The base moves as momentum has it, so M* times joint accelerations are the torques that they take.
    """
    spec = empty_spec(robot, 0.01)
    add_robot(spec, robot)
    model = spec.compile()
    data, n = mujoco.MjData(model), robot.n_joints
    ends, b = robot.joint_range, model.nv - n
    drawn = np.random.default_rng(0).uniform(ends[:, 0], ends[:, 1], (CONFIGURATIONS, n))
    masses = np.empty((1 + CONFIGURATIONS, model.nv, model.nv))
    for place, q in enumerate([robot.home, *drawn]):
        data.qpos[model.nq - n :] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_crb(model, data)
        mujoco.mj_fullM(model, data, masses[place])
    coupling = masses[:, :b, b:]
    return masses[:, b:, b:] - coupling.swapaxes(1, 2) @ np.linalg.solve(masses[:, :b, :b], coupling)
