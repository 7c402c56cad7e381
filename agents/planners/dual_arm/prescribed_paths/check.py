"""Independent check of plans along prescribed paths, also between their nodes."""

import numpy as np
from scipy.interpolate import make_interp_spline

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.check import check
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.reactionless import end_effectors
from space_envs.dynamics.rotations import Array

REFINEMENT = 4  # points for each node of the plan
TOLERANCES = {  # beyond which a plan counts as inaccurate
    "end_position": 1e-6,  # m
    "end_velocity": 1e-6,  # m/s
    "end_axis": 1e-5,  # rad
    "base_rate": 1e-8,  # rad/s
    "path": 1e-6,  # m
    "energy": 1e-5,  # relative
}


def checked_plan(
    method: str,
    robot: FloatingRobot,
    capture: Capture,
    limits: Limits,
    path: PolynomialPath,
    time: Array,
    position: Array,
    rate: Array,
    energy: float,
    notes: str = "",
) -> CapturePlan | Failure:
    """Return the plan with its measured errors, or a failure if they are too large.

    Args:
        path: of the end-effectors, with respect to the system's centre of mass.
        time: (K,) s. position: (K, n) rad. rate: (K, n) rad/s. energy: C by the planner, J s.
    """
    acceleration = make_interp_spline(time, rate, k=5, axis=0).derivative()(time)
    zeta = null_velocities(robot, position, rate) if has_single_zeta(robot) else None
    unchecked = CapturePlan(method, time, position, rate, acceleration, energy, zeta, notes=notes)
    inner = np.arange(REFINEMENT) / REFINEMENT
    dense = np.append((time[:-1, None] + np.diff(time)[:, None] * inner).ravel(), time[-1])
    q, qdot, qddot = unchecked.sample(dense)
    measured = check(robot, capture, limits, unchecked)
    violation = measured.violation | {
        "path": path_error(robot, path, dense, q),
        "energy": abs(measured.energy - energy) / max(energy, 1e-12),
    }
    for name, most in TOLERANCES.items():
        if not violation[name] <= most:
            reason = f"{name} is off by {violation[name]:.2e}, at most {most:.0e} may pass"
            return Failure(method, Cause.INACCURATE, reason)
    if limits.control is not None and zeta is not None:
        largest = float(np.linalg.norm(zeta, axis=1).max())
        if largest > limits.control * 1.001:
            reason = f"zeta would have to reach {largest:.3g} rad/s, the limit is {limits.control:.3g} rad/s"
            return Failure(method, Cause.INFEASIBLE, reason)
    failure = _beyond_limits(method, limits, dense, q, qdot, qddot)
    if failure is not None:
        return failure
    return CapturePlan(method, time, position, rate, acceleration, energy, zeta, violation, notes)


def path_error(robot: FloatingRobot, path: PolynomialPath, time: Array, q: Array) -> float:
    """Largest deviation of the end-effectors from their path at angles (T, n), m."""
    kinematics = robot.kinematics(q)
    positions = end_effectors(robot, q, kinematics).position - robot.centre_of_mass(kinematics)[:, None]
    flat = positions[..., : path.start.size // 2].reshape(len(time), path.start.size)
    return float(np.abs(flat - path.position(time)).max())


def has_single_zeta(robot: FloatingRobot) -> bool:
    """Whether the null space of eq. 9 has one dimension, as for two planar arms of three joints: then zeta is
    a number at each instant, up to its direction."""
    return robot.n_joints == 6


def null_velocities(robot: FloatingRobot, q: Array, qdot: Array) -> Array:
    """Part (K, 2) of the planar robot's dependent angular velocities in the null space of eq. 9, rad/s: the
    projector times zeta, which is the part of zeta that has an effect."""
    now = end_effectors(robot, q)
    rows = np.concatenate(
        [now.linear[..., :2, :].reshape(len(q), 4, q.shape[1]), now.base_angular[:, 2:]], axis=1
    )
    null = np.linalg.svd(rows)[2][:, -1]  # of five rows on six joints
    direction = (now.angular[..., 2, :] @ null[..., None])[..., 0]
    length = np.sqrt((direction * direction).sum(axis=1, keepdims=True))
    direction = direction / np.maximum(length, 1e-12)
    spins = (now.angular[..., 2, :] @ qdot[..., None])[..., 0]
    return direction * (direction * spins).sum(axis=1, keepdims=True)


def _beyond_limits(
    method: str, limits: Limits, time: Array, q: Array, qdot: Array, qddot: Array
) -> Failure | None:
    excess = limits.beyond_angles(q)
    if excess.max() > 1e-6:
        row, joint = np.unravel_index(excess.argmax(), excess.shape)
        reason = f"joint {joint + 1} passes its limit by {excess.max():.3f} rad at t = {time[row]:.2f} s"
        return Failure(method, Cause.JOINT_LIMIT, reason)
    for limit, values, unit in ((limits.rate, qdot, "rad/s"), (limits.acceleration, qddot, "rad/s^2")):
        if limit is None:
            continue
        size = np.abs(values)
        row, joint = np.unravel_index((size - limit).argmax(), size.shape)
        most, allowed = size[row, joint], float(np.broadcast_to(limit, size.shape)[row, joint])
        if most > allowed * (1.0 + 1e-6):
            reason = (
                f"joint {joint + 1} would need {most:.3f} {unit} at t = {time[row]:.2f} s, the limit is "
                f"{allowed:.3f} {unit}"
            )
            return Failure(method, Cause.INFEASIBLE, reason)
    return None
