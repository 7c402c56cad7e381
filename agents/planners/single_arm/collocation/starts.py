"""Final configurations and initial guesses of the collocation program."""

import numpy as np

from agents.planners.common.newton import damped_newton
from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.collocation.model import SingleArm
from agents.planners.single_arm.problem import Reach
from space_envs.dynamics import FloatingRobot, attitude_cost, base_twist
from space_envs.dynamics.rotations import Array, from_matrix, to_matrix
from space_envs.tasks.goals.kinds import GOAL_ROWS, goal_angle

SEARCHES = 64
SPREAD = (0.0, 1.0, 2.0, 3.0)  # rad, ranges of the searches' random starts, in turn
LEAST_DISTANCE = 2.0  # rad, between two final configurations that count as different
DETOUR = 0.7  # rad, standard deviation of the displacement halfway along a random path
_ITERATIONS = 40
_TOLERANCE = 1e-6  # m and, as a sine, rad
_DAMPING, _LEAST_DAMPING = 0.03, 1e-9
_LARGEST_STEP = 0.5  # rad, of a joint


def end_configurations(
    model: SingleArm, robot: FloatingRobot, reach: Reach, limits: Limits, method: str, seed: int
) -> Array | Failure:
    """Configurations (E, n) with the end-effector at the goal if the base keeps its attitude, nearest first.

    By damped Newton iterations from the start and from random displacements of it.
    """
    n, start = robot.n_joints, reach.start
    com = model.com(start).full()[:, 0]
    far, longest = float(np.linalg.norm(reach.end.position - com)), robot.reach()
    if far > longest:
        reason = f"the goal is {far:.3f} m from the system's centre of mass, the reach is {longest:.3f} m"
        return Failure(method, Cause.OUT_OF_REACH, reason)
    angles = limits.angles(n)
    random = np.random.default_rng(seed).uniform(-1.0, 1.0, (SEARCHES, n))
    q = np.clip(start + random * np.resize(SPREAD, SEARCHES)[:, None], *angles.T)
    ending, rows = model.ending_of(reach.kind), GOAL_ROWS[reach.kind]
    value, slope = (f.map(SEARCHES) for f in (ending.value, ending.slope))
    given = [np.zeros((3, SEARCHES)), np.tile(com[:, None], SEARCHES)]
    given.append(np.tile(to_matrix(reach.end.quaternion), SEARCHES))
    required = np.concatenate([reach.end.position, np.zeros(rows - 3)])
    q, error = damped_newton(
        lambda q: required - value(q.T, *given).full().T,
        lambda q: slope(q.T, *given).full().reshape(rows, SEARCHES, n + 3)[:, :, :n].swapaxes(0, 1),
        q,
        angles,
        iterations=_ITERATIONS,
        largest_step=_LARGEST_STEP,
        damping=(_LEAST_DAMPING, _DAMPING),
    )
    # Sines vanish at half a revolution too.
    turned = from_matrix(robot.end_effector_pose(q)[1])
    aligned = goal_angle(reach.kind, turned, reach.end.quaternion) < 0.5 * np.pi
    found = q[(error < _TOLERANCE) & aligned]
    if not len(found):
        reason = (
            f"none of {SEARCHES} searches found a configuration within the joint limits that puts the "
            f"end-effector at its goal; the nearest is off by {error.min():.3g} m or rad"
        )
        return Failure(method, Cause.OUT_OF_REACH, reason)
    return found[np.argsort(np.linalg.norm(found - start, axis=1))]


def initial_paths(
    robot: FloatingRobot, reach: Reach, ends: Array, most: int, seed: int, at: Array
) -> list[Array]:
    """Paths (S, n) at values `at` (S,) of s: straight to different ends (E, n), alternating with detours.

    Ends are ordered by the cost of the straight paths to them by eq. 20.
    """
    straight = reach.start + at[:, None] * (ends - reach.start)[:, None, :]
    rate = np.broadcast_to((ends - reach.start)[:, None, :], straight.shape)
    cost = attitude_cost(base_twist(robot, straight, rate), 1.0, reach.c)
    ordered = ends[np.argsort(cost)]
    chosen = [ordered[0]]
    for end in ordered:
        if min(float(np.linalg.norm(end - other)) for other in chosen) > LEAST_DISTANCE:
            chosen.append(end)
    random = np.random.default_rng(seed)
    paths, detours = [], 0
    for number in range(most):
        if number % 2 == 0 and number // 2 < len(chosen):
            paths.append(reach.start + at[:, None] * (chosen[number // 2] - reach.start))
        else:
            aside = np.sin(np.pi * at)[:, None] * random.normal(0.0, DETOUR, robot.n_joints)
            paths.append(reach.start + at[:, None] * (chosen[detours % len(chosen)] - reach.start) + aside)
            detours += 1
    return paths
