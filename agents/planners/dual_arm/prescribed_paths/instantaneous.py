"""Reactionless motion along prescribed end-effector paths by a choice at each instant."""

from dataclasses import replace

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.prescribed_paths.integration import integrate
from agents.planners.dual_arm.prescribed_paths.model import Matrices, PathModel
from agents.planners.dual_arm.prescribed_paths.null_space import (
    METHOD,
    Choice,
    least_energy,
    solutions,
    zeta_zero,
)
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

LARGEST_RATE = 10.0  # rad/s; larger joint rates are those of a singularity


def plan_zeta_zero(
    robot: FloatingRobot, capture: Capture, limits: Limits = Limits()
) -> CapturePlan | Failure:
    """Plan by method (a): polynomial paths, zeta = 0.

    Args:
        limits: only joint angles are checked: the path leaves no freedom to satisfy the others with.

    Raises:
        ConfigurationError: for a malformed capture, or limits of another robot.
    """
    return _plan("reactionless", robot, capture, limits, zeta_zero)


def plan_local(robot: FloatingRobot, capture: Capture, limits: Limits = Limits()) -> CapturePlan | Failure:
    """Plan by method (b): polynomial paths, least energy at each instant; arguments as `plan_zeta_zero`."""
    return _plan("reactionless_local", robot, capture, limits, least_energy)


def capture_path(method: str, robot: FloatingRobot, capture: Capture) -> PolynomialPath | Failure:
    """Polynomial path of a checked capture, or a failure if its end is out of reach."""
    model = PathModel.of(robot)
    d = model.dimensions
    start = model(capture.start).positions
    end = (capture.position - robot.centre_of_mass(robot.kinematics(capture.start)))[:, :d].ravel()
    for arm in range(2):
        distance, reach = float(np.linalg.norm(end[d * arm : d * (arm + 1)])), robot.reach(arm)
        if distance > reach:
            reason = (
                f"grapple point {arm + 1} is {distance:.3f} m from the system's centre of mass, the reach of "
                f"its arm is {reach:.3f} m"
            )
            return Failure(method, Cause.OUT_OF_REACH, reason)
    rest = np.zeros(2 * d)
    return PolynomialPath(start, end, rest, capture.velocity[:, :d].ravel(), capture.duration)


def _plan(
    method: str, robot: FloatingRobot, capture: Capture, limits: Limits, choice: Choice
) -> CapturePlan | Failure:
    capture, limits = replace(capture.checked(robot), aligned=False), limits.checked(robot)
    path = capture_path(method, robot, capture)
    if isinstance(path, Failure):
        return path

    def law(time: float, q: Array, at: Matrices) -> Array | Failure:
        rate = chosen_rates(at, path.velocity(time), choice)
        if not isinstance(rate, Failure) and np.abs(rate).max() > LARGEST_RATE:
            reason = f"a joint would have to turn at {np.abs(rate).max():.3g} rad/s"
            return Failure(METHOD, Cause.SINGULAR, reason)
        return rate

    return integrate(method, robot, capture, limits, path, law)


def chosen_rates(at: Matrices, velocity: Array, choice: Choice) -> Array | Failure:
    """Reactionless joint rates (n,) for end-effector velocities (2 d,), by a choice in the null space."""
    found = solutions(at, velocity)
    if isinstance(found, Failure):
        return found
    particular, null = found
    chosen = choice(at, particular, null)
    return chosen if isinstance(chosen, Failure) else particular + null @ chosen
