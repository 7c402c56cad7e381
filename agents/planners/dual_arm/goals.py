"""Final configurations of a capture: end-effectors at their goals, approach axes aligned."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from agents.planners.common.newton import damped_newton
from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.held_attitude import HeldAttitude
from agents.planners.dual_arm.problem import Capture
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

_SPREAD = (1.2, 2.5)  # rad, ranges of the searches' random starts around that of the capture, in turn
_ITERATIONS = 30
_DAMPING = 1e-3  # m^2
_LARGEST_STEP = 0.4  # rad, of a joint
_TOLERANCE = 1e-6  # m and rad


@dataclass(frozen=True, eq=False)
class EndGoals:
    """Goals of a capture at its end, for the functions of `HeldAttitude`.

    Attributes:
        position: (2 d,) m, from the system's centre of mass. velocity: (2 d,) m/s. across: (3, 4) unit
            vectors at right angles to the approach axes, two of each arm; zero if any axis is allowed.
    """

    position: Array
    velocity: Array
    across: Array

    @classmethod
    def of(cls, robot: FloatingRobot, model: HeldAttitude, capture: Capture) -> "EndGoals":
        """Return the goals of a capture."""
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
) -> Array | Failure:
    """Configurations (E, n) with the goals' positions and axes, ordered by the energy of the straight path.

    They are found by damped Newton iterations from the start and from random displacements of it, always the
    same ones, `searches` in all.
    """
    if (failure := _out_of_reach(robot, capture, method)) is not None:
        return failure
    n = robot.n_joints
    angles = limits.angles(n)
    random = np.random.default_rng(0).uniform(-1.0, 1.0, (searches, n))
    random *= np.resize(_SPREAD, searches)[:, None]
    random[0] = 0.0
    q, error = _searched(robot, model, capture, np.clip(capture.start + random, *angles.T), angles)
    reached = (error < _TOLERANCE) & _aligned(model, capture, q)
    if not reached.any():
        reason = (
            f"none of {searches} searches found a configuration within the joint limits that puts the "
            f"end-effectors at their goals; the nearest is off by {error.min():.3g} m or rad"
        )
        return Failure(method, Cause.OUT_OF_REACH, reason)
    found = q[reached]
    return found[np.argsort(_straight_energy(model, capture.start, found))]


def _out_of_reach(robot: FloatingRobot, capture: Capture, method: str) -> Failure | None:
    centre = robot.centre_of_mass(robot.kinematics(capture.start))
    for arm in range(2):
        distance, reach = float(np.linalg.norm(capture.position[arm] - centre)), robot.reach(arm)
        if distance > reach:
            reason = (
                f"the goal of arm {arm + 1} is {distance:.3f} m from the system's centre of mass, "
                f"the reach of the arm is {reach:.3f} m"
            )
            return Failure(method, Cause.OUT_OF_REACH, reason)
    return None


def _searched(
    robot: FloatingRobot, model: HeldAttitude, capture: Capture, q: Array, angles: Array
) -> tuple[Array, Array]:
    """Configurations (S, n) after damped Newton iterations from q, and their largest errors (S,), m or 1."""
    goals, n, d = EndGoals.of(robot, model, capture), robot.n_joints, model.dimensions
    # Positions and axes are the rows of `ending` that do not depend on rates.
    outputs, searches = model.ending.value.numel_out(0), len(q)
    tilts = range(outputs - model.tilts, outputs)
    rows = [*range(2 * d), *(tilts if capture.axis is not None else ())]
    required = np.zeros(len(rows))
    required[: 2 * d] = goals.position
    value, slope = (f.map(searches) for f in (model.ending.value, model.ending.slope))
    rest, across = np.zeros((n, searches)), np.tile(goals.across, searches)

    def error(q: Array) -> Array:
        return required - value(q.T, rest, across).full().T[:, rows]

    def jacobian(q: Array) -> Array:
        by_rows = slope(q.T, rest, across).full().reshape(outputs, searches, 2 * n)[rows, :, :n]
        return by_rows.swapaxes(0, 1)

    return damped_newton(
        error,
        jacobian,
        q,
        angles,
        iterations=_ITERATIONS,
        largest_step=_LARGEST_STEP,
        damping=(0.0, _DAMPING),
    )


def _aligned(model: HeldAttitude, capture: Capture, q: Array) -> NDArray[np.bool_]:
    """(S,) whether the approach axes have the right sense: the rows for axes vanish for opposite ones too."""
    if capture.axis is None:
        return np.ones(len(q), dtype=bool)
    axes = model.positions.map(len(q))(q.T)[1].full().T.reshape(-1, 2, 3)
    return ((axes * capture.axis).sum(axis=-1) > 0.0).all(axis=1)


def _straight_energy(model: HeldAttitude, start: Array, ends: Array) -> Array:
    """Integral (E,) over s in [0, 1] of eq. 12 along straight paths, which are not quite reactionless."""
    at = np.array([0.1, 0.5, 0.9])
    displacement = ends - start
    q = (start + at[:, None, None] * displacement).reshape(-1, len(start))
    value = model.energy.value.map(len(q))(q.T, np.tile(displacement, (len(at), 1)).T)
    return value.full().reshape(len(at), -1).mean(axis=0)


def spread(ends: Array, most: int) -> Array:
    """The first of the configurations (E, n), then, each time, the one farthest from those before."""
    chosen = [0]
    distance = np.linalg.norm(ends - ends[0], axis=1)
    while len(chosen) < min(most, len(ends)):
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(ends - ends[chosen[-1]], axis=1))
    return ends[chosen]
