"""Choice of the time at which a planner intercepts a grapple, within the window of a problem."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from agents.planners.common.damped_search import Rows
from agents.planners.common.inverse_kinematics import JointMotion, floating_inverse_kinematics
from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.problem import Reach, ReachPlan
from space_envs.dynamics import FloatingRobot, roll_out_base, trajectory_cost
from space_envs.dynamics.grapples import PoseTwist
from space_envs.dynamics.rotations import Array, conjugate, rotate

METHOD = "interception"
GRID = 15  # times in a window for which a motion is predicted
NODES = 21  # of a predicted motion
PLANNED = 3  # plans at the most promising times, of which the best is refined
DAMPING = 1e-3  # of the inverse of the generalised Jacobian, squared, in the units of J J'
EXCESS_WEIGHT = 10.0  # on the share by which a predicted motion is beyond the limits, relative to its cost
NO_ROTATION = np.array([1.0, 0.0, 0.0, 0.0])
_PHASE = np.linspace(0.0, 1.0, NODES)[:, None]


@dataclass(frozen=True, eq=False)
class Predictions:
    """Predicted motions that intercept a grapple at K times.

    Attributes:
        time: (K,) s. end, end_rate: (K, n) rad and rad/s, joints at that time.
        cost: (K,) eq. 20 times dt, m^2/s.
        excess: (K,) largest rate or acceleration relative to its limit, minus 1, at least 0.
    """

    time: Array
    end: Array
    end_rate: Array
    cost: Array
    excess: Array

    @property
    def ranked(self) -> Array:
        """The times (K,) from the most to the least promising."""
        return self.time[np.argsort(self.cost * (1.0 + EXCESS_WEIGHT * self.excess), kind="stable")]


def predictions(robot: FloatingRobot, limits: Limits, reach: Reach, times: Array) -> Predictions:
    """Predicted motions of a checked problem, without the times (K,) at which no configuration is found.

    A prediction is a quintic joint motion with the grapple's pose and, nearly, its twist at the end.
    """
    goal, k = reach.goal.at(times), len(times)
    start = np.tile(reach.start, (k, 1))
    first = np.zeros_like(start) if reach.rate is None else times[:, None] * reach.rate

    def motion(end: Array, rows: Rows) -> JointMotion:
        path, slope, _ = _quintic(start[rows], first[rows], end, 0.0 * end)
        return JointMotion(path, slope, 1.0 / (NODES - 1))

    base = np.zeros((k, 3)), np.tile(NO_ROTATION, (k, 1))
    angles = limits.angles(robot.n_joints)
    pose = goal.position, goal.quaternion
    ends = floating_inverse_kinematics(robot, *pose, motion, *base, start, angles, kind=reach.kind)
    found = np.flatnonzero(ends.converged)
    time, end = times[found], ends.position[found]
    end_rate = _end_rates(robot, PoseTwist(*(each[found] for each in goal)), motion(end, found))
    path, slope, curve = _quintic(start[found], first[found], end, time[:, None] * end_rate)
    cost = trajectory_cost(robot, path, slope, 1.0 / (NODES - 1), reach.c) / time
    excess = np.zeros(len(found))
    for value, limit in (
        (slope / time[:, None, None], limits.rate),
        (curve / time[:, None, None] ** 2, limits.acceleration),
    ):
        if limit is not None:
            excess = np.maximum(excess, (np.abs(value) / limit).max(axis=(1, 2)) - 1.0)
    return Predictions(time, end, end_rate, cost, excess)


def at_best_time(
    plan: Callable[[Reach], ReachPlan | Failure], robot: FloatingRobot, limits: Limits, reach: Reach
) -> ReachPlan | Failure:
    """Plan of least cost over the window of a checked problem.

    It is planned at the most promising times, until `PLANNED` plans are found, and half a step of the grid
    before and after the best of them.

    Args:
        plan: planner of problems with a given duration.
    """
    if reach.window is None:
        return plan(reach)
    times = np.linspace(*reach.window, GRID)
    ranked = predictions(robot, limits, reach, times).ranked
    if not len(ranked):
        reason = f"the grapple is out of reach from {times[0]:.1f} to {times[-1]:.1f} s"
        return Failure(METHOD, Cause.OUT_OF_REACH, reason)
    tried = _tried(plan, reach, ranked)
    plans = [each for each in tried if isinstance(each, ReachPlan)]
    if not plans:
        return min((each for each in tried if isinstance(each, Failure)), key=lambda each: each.residual)
    best, half = _cheapest(plans), 0.5 * (times[1] - times[0])
    near = np.clip([best.time[-1] - half, best.time[-1] + half], *reach.window)
    return _cheapest([best, *(each for each in _tried(plan, reach, near) if isinstance(each, ReachPlan))])


def _tried(
    plan: Callable[[Reach], ReachPlan | Failure], reach: Reach, times: Array
) -> list[ReachPlan | Failure]:
    """Results of a planner at times (K,) s in their order, until `PLANNED` plans are found."""
    tried: list[ReachPlan | Failure] = []
    left = PLANNED
    for time in times.tolist():
        tried.append(plan(replace(reach, duration=time, window=None)))
        left -= isinstance(tried[-1], ReachPlan)
        if not left:
            break
    return tried


def _cheapest(plans: list[ReachPlan]) -> ReachPlan:
    return min(plans, key=lambda plan: plan.cost)


def _end_rates(robot: FloatingRobot, goal: PoseTwist, motion: JointMotion) -> Array:
    """Joint rates (K, n), rad/s, with which the end-effector follows a goal at the ends of motions."""
    _, attitude = roll_out_base(robot, motion.position, motion.velocity, motion.dt)
    back = conjugate(attitude[:, -1])
    twist = [rotate(back, goal.linear_velocity), rotate(back, goal.angular_velocity)]
    jacobian = robot.generalized_jacobian(motion.position[:, -1])
    transpose = jacobian.swapaxes(1, 2)
    square = jacobian @ transpose + DAMPING * np.eye(6)
    return (transpose @ np.linalg.solve(square, np.concatenate(twist, axis=1)[..., None]))[..., 0]


def _quintic(start: Array, first: Array, end: Array, last: Array) -> tuple[Array, Array, Array]:
    """Values, slopes and curvatures (K, T, n) over phase of quintics without curvature at their ends.

    Args:
        start, end: (K, n) values. first, last: (K, n) slopes.
    """
    s = _PHASE
    out, back = s - 6.0 * s**3 + 8.0 * s**4 - 3.0 * s**5, -4.0 * s**3 + 7.0 * s**4 - 3.0 * s**5
    across = s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
    slopes = (
        1.0 - 18.0 * s**2 + 32.0 * s**3 - 15.0 * s**4,
        -12.0 * s**2 + 28.0 * s**3 - 15.0 * s**4,
        30.0 * s**2 * (1.0 - s) ** 2,
    )
    curves = (
        -36.0 * s + 96.0 * s**2 - 60.0 * s**3,
        -24.0 * s + 84.0 * s**2 - 60.0 * s**3,
        60.0 * s * (1.0 - s) * (1.0 - 2.0 * s),
    )
    start, first, end, last = (each[:, None, :] for each in (start, first, end, last))
    value = start + out * first + back * last + across * (end - start)
    slope, curve = (a * first + b * last + c * (end - start) for a, b, c in (slopes, curves))
    return value, slope, curve
