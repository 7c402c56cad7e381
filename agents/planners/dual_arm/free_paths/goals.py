"""Configurations that a capture can end in: the end-effectors at their goals, approach axes aligned."""

from dataclasses import dataclass

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.free_paths.model import HeldAttitude
from agents.planners.dual_arm.problem import Capture
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

_SPREAD = (1.2, 2.5)  # rad, largest displacement of a search's start from that of the capture, by turns
_ITERATIONS = 30
_DAMPING = 1e-3  # m^2
_LARGEST = 0.4  # rad, of a step
_REACHED = 1e-6  # m and rad


@dataclass(frozen=True, eq=False)
class EndGoals:
    """What a capture asks of the end, for the functions of `HeldAttitude`.

    Attributes:
        place: (2 d,) m, from the system's centre of mass. velocity: (2 d,) m/s. across: (3, 4) unit vectors
            at right angles to the approach axes, two of each arm; zero where any axis will do.
    """

    place: Array
    velocity: Array
    across: Array

    @classmethod
    def of(cls, robot: FloatingRobot, model: HeldAttitude, capture: Capture) -> "EndGoals":
        """Of a capture."""
        d = model.dimensions
        centre = robot.centre_of_mass(robot.kinematics(capture.start))
        across = np.zeros((3, 4))
        if capture.axis is not None:
            for arm, axis in enumerate(capture.axis):
                least = np.eye(3)[np.abs(axis).argmin()]
                first = np.cross(axis, least)
                first /= np.linalg.norm(first)
                across[:, 2 * arm], across[:, 2 * arm + 1] = first, np.cross(axis, first)
        return cls((capture.position - centre)[:, :d].ravel(), capture.velocity[:, :d].ravel(), across)


def end_configurations(
    robot: FloatingRobot,
    model: HeldAttitude,
    capture: Capture,
    limits: Limits,
    method: str,
    searches: int,
    room: float = 0.0,
) -> Array | Failure:
    """Configurations (E, n) that fulfil the end's places and axes, `room` rad inside the joint limits, the
    nearest to the start first in the sense of eq. 12 of shah2013 (energy of the straight way there).

    Damped Newton iterations from the start and from random displacements of it, always the same ones; as many
    `searches` in all.
    """
    goals, n, d = EndGoals.of(robot, model, capture), robot.n_joints, model.dimensions
    centre = robot.centre_of_mass(robot.kinematics(capture.start))
    for arm in range(2):
        far, reach = float(np.linalg.norm(capture.position[arm] - centre)), robot.reach(arm)
        if far > reach:
            reason = (
                f"the goal of arm {arm + 1} is {far:.3f} m from the system's centre of mass, "
                f"the reach of the arm is {reach:.3f} m"
            )
            return Failure(method, Cause.OUT_OF_REACH, reason)
    low, high = (
        limits.position.T if limits.position is not None else (np.full(n, -np.inf), np.full(n, np.inf))
    )
    random = np.random.default_rng(0).uniform(-1.0, 1.0, (searches, n))
    random *= np.resize(_SPREAD, searches)[:, None]
    random[0] = 0.0
    q = np.clip(capture.start + random, low, high)
    # Places and axes are the rows of `ending` that no rate enters.
    outputs = model.ending.value.numel_out(0)
    tilts = range(outputs - model.tilts, outputs)
    rows = [*range(2 * d), *(tilts if capture.axis is not None else ())]
    wanted = np.zeros(len(rows))
    wanted[: 2 * d] = goals.place
    value, slope = (f.map(searches) for f in (model.ending.value, model.ending.slope))
    rest, across = np.zeros((n, searches)), np.tile(goals.across, searches)
    for _ in range(_ITERATIONS):
        left = wanted - value(q.T, rest, across).full().T[:, rows]
        jacobian = slope(q.T, rest, across).full().reshape(outputs, searches, 2 * n)[rows, :, :n]
        jacobian = jacobian.swapaxes(0, 1)
        error = np.abs(left).max(axis=1)
        damping = np.minimum(_DAMPING, error)[:, None, None] * np.eye(len(rows))
        inner = np.linalg.solve(jacobian @ jacobian.swapaxes(1, 2) + damping, left[..., None])
        step = (jacobian.swapaxes(1, 2) @ inner)[..., 0]
        step *= np.minimum(_LARGEST / np.maximum(np.abs(step).max(axis=1), 1e-300), 1.0)[:, None]
        q = np.clip(q + step, low, high)
    error = np.abs(wanted - value(q.T, rest, across).full().T[:, rows]).max(axis=1)
    reached = error < _REACHED
    if capture.axis is not None:
        # The rows for the axes vanish as well where an axis points the wrong way.
        axes = model.places.map(searches)(q.T)[1].full().T.reshape(-1, 2, 3)
        reached &= ((axes * capture.axis).sum(axis=-1) > 0.0).all(axis=1)
    if not reached.any():
        reason = (
            f"none of {searches} searches found a configuration within the joint limits that puts the "
            f"end-effectors at their goals; the nearest is off by {error.min():.3g} m or rad"
        )
        return Failure(method, Cause.OUT_OF_REACH, reason)
    found = q[reached]
    return found[np.argsort(_straight_energy(model, capture.start, found))]


def _straight_energy(model: HeldAttitude, start: Array, ends: Array) -> Array:
    """Integral (E,) over s in [0, 1] of eq. 12 along straight ways, which are not quite reactionless."""
    at = np.array([0.1, 0.5, 0.9])
    way = ends - start
    q = (start + at[:, None, None] * way).reshape(-1, len(start))
    value = model.energy.value.map(len(q))(q.T, np.tile(way, (len(at), 1)).T)
    return value.full().reshape(len(at), -1).mean(axis=0)


def spread(ends: Array, most: int) -> Array:
    """The first of the configurations (E, n), then, each time, the one farthest from those before."""
    chosen = [0]
    distance = np.linalg.norm(ends - ends[0], axis=1)
    while len(chosen) < min(most, len(ends)):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(ends - ends[chosen[-1]], axis=1))
    return ends[chosen]
