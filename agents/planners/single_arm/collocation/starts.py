"""Where the joints may be at the end, and motions to start from."""

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.collocation.model import SingleArm
from agents.planners.single_arm.problem import Reach
from space_envs.dynamics import FloatingRobot, attitude_cost, base_twist
from space_envs.dynamics.rotations import Array, to_matrix

SEARCHES = 64
SPREAD = (0.0, 1.0, 2.0, 3.0)  # rad, by which the searches' starts lie apart, in turn
APART = 2.0  # rad, between two ends that count as different
AWAY = 0.7  # rad, standard deviation of what a random way goes aside
_ITERATIONS = 40
_REACHED = 1e-6  # m and, as a sine, rad
_DAMPING, _LEAST = 0.03, 1e-9
_LARGEST = 0.5  # rad, of a joint in one iteration


def end_configurations(
    model: SingleArm, robot: FloatingRobot, reach: Reach, limits: Limits, method: str, seed: int
) -> Array | Failure:
    """Configurations (E, n) that would have the end-effector at the goal were the base's attitude kept.

    Damped Newton iterations from the start and from random displacements of it. The nearest comes first.
    """
    n, start = robot.n_joints, reach.start
    com = model.com(start).full()[:, 0]
    far, longest = float(np.linalg.norm(reach.position - com)), robot.reach()
    if far > longest:
        reason = f"the goal is {far:.3f} m from the system's centre of mass, the reach is {longest:.3f} m"
        return Failure(method, Cause.OUT_OF_REACH, reason)
    low, high = (
        limits.position.T if limits.position is not None else (np.full(n, -np.inf), np.full(n, np.inf))
    )
    random = np.random.default_rng(seed).uniform(-1.0, 1.0, (SEARCHES, n))
    q = np.clip(start + random * np.resize(SPREAD, SEARCHES)[:, None], low, high)
    value, slope = (f.map(SEARCHES) for f in (model.ending.value, model.ending.slope))
    given = [np.zeros((3, SEARCHES)), np.tile(com[:, None], SEARCHES)]
    given.append(np.tile(to_matrix(reach.quaternion), SEARCHES))
    wanted = np.concatenate([reach.position, np.zeros(3)])
    for _ in range(_ITERATIONS):
        left = wanted - value(q.T, *given).full().T
        jacobian = slope(q.T, *given).full().reshape(6, SEARCHES, n + 3)[:, :, :n].swapaxes(0, 1)
        damping = np.clip(np.abs(left).max(axis=1), _LEAST, _DAMPING)[:, None, None] * np.eye(6)
        inner = np.linalg.solve(jacobian @ jacobian.swapaxes(1, 2) + damping, left[..., None])
        step = (jacobian.swapaxes(1, 2) @ inner)[..., 0]
        step *= np.minimum(_LARGEST / np.maximum(np.abs(step).max(axis=1), 1e-300), 1.0)[:, None]
        q = np.clip(q + step, low, high)
    error = np.abs(wanted - value(q.T, *given).full().T).max(axis=1)
    # Sines vanish at half a turn too.
    axes = robot.end_effector_pose(q)[1]
    aligned = np.trace(to_matrix(reach.quaternion).T @ axes, axis1=1, axis2=2) > 1.0
    found = q[(error < _REACHED) & aligned]
    if not len(found):
        reason = (
            f"none of {SEARCHES} searches found a configuration within the joint limits that puts the "
            f"end-effector at its goal; the nearest is off by {error.min():.3g} m or rad"
        )
        return Failure(method, Cause.OUT_OF_REACH, reason)
    return found[np.argsort(np.linalg.norm(found - start, axis=1))]


def starting_paths(
    robot: FloatingRobot, reach: Reach, ends: Array, most: int, seed: int, at: Array
) -> list[Array]:
    """Paths (S, n) at the values `at` (S,) of s, to different ends and, from the second on, by random ways.

    Ends (E, n) come in the order of what the straight ways to them cost by eq. 20.
    """
    straight = reach.start + at[:, None] * (ends - reach.start)[:, None, :]
    rate = np.broadcast_to((ends - reach.start)[:, None, :], straight.shape)
    cost = attitude_cost(base_twist(robot, straight, rate), 1.0, reach.c)
    cheapest = ends[np.argsort(cost)]
    chosen = [cheapest[0]]
    for end in cheapest:
        if min(float(np.linalg.norm(end - other)) for other in chosen) > APART:
            chosen.append(end)
    random = np.random.default_rng(seed)
    paths, spare = [], 0
    for number in range(most):
        if number % 2 == 0 and number // 2 < len(chosen):
            paths.append(reach.start + at[:, None] * (chosen[number // 2] - reach.start))
        else:
            aside = np.sin(np.pi * at)[:, None] * random.normal(0.0, AWAY, robot.n_joints)
            paths.append(reach.start + at[:, None] * (chosen[spare % len(chosen)] - reach.start) + aside)
            spare = (spare + 1) % len(chosen)
    return paths
