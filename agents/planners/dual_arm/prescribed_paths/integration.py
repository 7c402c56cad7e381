"""Integration of a law of joint rates into a plan along prescribed paths."""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.prescribed_paths.check import checked_plan
from agents.planners.dual_arm.prescribed_paths.model import Matrices, PathModel
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

TOLERANCE = 1e-9  # of the integration, relative and absolute
MAX_CALLS = 4000  # of the law of joint rates; a regular motion takes a tenth of that
NODES_PER_STEP = 6  # of a plan, in each step of the integration

Law = Callable[[float, Array, Matrices], Array | Failure]
"""Joint rates (n,) from the time, joint angles (n,) and the matrices there."""


class _Stopped(Exception):
    """Ends an integration."""


def integrate(
    method: str,
    robot: FloatingRobot,
    capture: Capture,
    limits: Limits,
    path: PolynomialPath,
    law: Law,
    notes: str = "",
) -> CapturePlan | Failure:
    """Follow a law of joint rates from the start of a capture to its end, and check the result."""
    model = PathModel.of(robot)
    reached, calls = [0.0], [0]

    def derivative(time: float, state: Array) -> Array:
        """Time derivatives of the joint angles and the energy."""
        reached[0] = time
        calls[0] += 1
        if calls[0] > MAX_CALLS:
            raise _Stopped("the joint rates change faster and faster")
        at = model(state[:-1])
        thetadot = law(time, state[:-1], at)
        if isinstance(thetadot, Failure):
            raise _Stopped(thetadot.reason)
        return np.append(thetadot, thetadot @ at.mass @ thetadot)

    try:
        found = solve_ivp(
            derivative,
            (0.0, capture.duration),
            np.append(capture.start, 0.0),
            "DOP853",
            dense_output=True,
            rtol=TOLERANCE,
            atol=TOLERANCE,
            first_step=capture.duration / 100,
        )
    except _Stopped as error:
        return Failure(method, Cause.SINGULAR, f"singular at t = {reached[0]:.2f} s: {error}")
    if not found.success:
        return Failure(method, Cause.SINGULAR, f"no way on from t = {reached[0]:.2f} s: {found.message}")
    inner = np.arange(NODES_PER_STEP) / NODES_PER_STEP
    times = np.append((found.t[:-1, None] + np.diff(found.t)[:, None] * inner).ravel(), found.t[-1])
    position = found.sol(times)[:-1].T
    rates = []
    for time, q in zip(times, position, strict=True):
        rate = law(time, q, model(q))
        if isinstance(rate, Failure):
            return Failure(method, Cause.SINGULAR, f"singular at t = {time:.2f} s: {rate.reason}")
        rates.append(rate)
    energy = float(found.y[-1, -1])
    return checked_plan(method, robot, capture, limits, path, times, position, np.array(rates), energy, notes)
