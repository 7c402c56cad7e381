"""Inverse kinematics of a floating arm, batched: joint goals whose motions end at inertial poses.

Where the base is at the end depends on the motion that brings the joints there. So the pose is solved in the
base frame that is predicted for the end of the very motion that will be executed.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics import FloatingRobot, roll_out_base
from space_envs.dynamics.rotations import Array, conjugate, from_matrix, logarithm, multiply, rotate

Rows = NDArray[np.int64]

POSITION_TOLERANCE = 2e-5  # m
ORIENTATION_TOLERANCE = 2e-5  # rad
SETTLED = 2e-3  # rad, largest step along the redundancy at which it counts as settled
ITERATIONS = 40
DAMPING = 1e-8  # least damping of the normal equations, in squared units of the Jacobian
# Share of the way towards the preferred configuration that a step takes in what the pose leaves free. Where
# both pull at each other for long, that share decays and the pose wins.
BIAS_RATE = 0.7
PATIENCE = 12  # iterations before the share decays
DECAY = 0.75  # of the share, an iteration
LARGEST_STEP = 0.5  # rad a joint
# Other starts for the rows that fail from the first one: offsets in rad, spread evenly by a fixed seed.
RETRIES = 6
RETRY_RADIUS = 0.9


@dataclass(frozen=True, eq=False)
class JointMotion:
    """Joint angles and rates along motions, sampled from 0 s in steps of dt.

    Attributes:
        position, velocity: (..., T, n) rad and rad/s.
        dt: s.
    """

    position: Array
    velocity: Array
    dt: float


@dataclass(frozen=True, eq=False)
class JointGoals:
    """What inverse kinematics found, row by row; a row that did not converge holds the best there was.

    Attributes:
        position: (N, n) rad.
        converged: (N,) bool, both residuals are within tolerance.
        position_residual: (N,) m. orientation_residual: (N,) rad.
    """

    position: Array
    converged: NDArray[np.bool_]
    position_residual: Array
    orientation_residual: Array

    def take(self, rows: NDArray[Any]) -> "JointGoals":
        """The goals of rows, by number or mask."""
        return JointGoals(**{name: value[rows] for name, value in vars(self).items()})

    def given_up(self, rows: Rows, rest: Array) -> "JointGoals":
        """The same with the goals of rows (k,) given up for joint angles `rest` (k, n) rad."""
        position, converged = self.position.copy(), self.converged.copy()
        position[rows], converged[rows] = rest, False
        return replace(self, position=position, converged=converged)


MotionModel = Callable[[Array, Rows], JointMotion]  # from joint goals (k, n) of rows (k,)


def inverse_kinematics(
    arm: FloatingRobot,
    position: Array,
    quaternion: Array,
    start: Array,
    limits: Array,
    preferred: Array | None = None,
) -> JointGoals:
    """Joint angles that put the end-effector at poses in the BASE frame.

    Args:
        position: (N, 3) m. quaternion: (N, 4), end-effector to base.
        start: (N, n) rad, where the search begins.
        limits: (n, 2) rad; no angle outside is returned.
        preferred: (N, n) rad that the redundancy draws the solution to; None is `start`.
    """

    def error(q: Array, rows: Rows) -> Array:
        return pose_error(arm, q, position[rows], quaternion[rows])

    def jacobian(q: Array) -> Array:
        return arm.end_effector_jacobians(q)[1]

    return _search(error, jacobian, start, limits, start if preferred is None else preferred)


def floating_inverse_kinematics(
    arm: FloatingRobot,
    goal_position: Array,
    goal_quaternion: Array,
    motion: MotionModel,
    base_position: Array,
    base_quaternion: Array,
    start: Array,
    limits: Array,
    preferred: Array | None = None,
) -> JointGoals:
    """Joint goals whose motion brings the end-effector to poses in the INERTIAL frame.

    Args:
        goal_position: (N, 3) m. goal_quaternion: (N, 4), end-effector to inertial.
        motion: for joint goals (k, n) of the rows (k,), the motions (k, T, n) that will be executed; each
            ends at its goal, or so near that their difference can be searched away. Total momentum is taken
            as zero.
        base_position, base_quaternion: (N, 3) m and (N, 4), of the base where the motion begins.
        start, limits, preferred: as in `inverse_kinematics`.
    """

    def error(q: Array, rows: Rows) -> Array:
        path = motion(q, rows)
        positions, quaternions = roll_out_base(
            arm, path.position, path.velocity, path.dt, base_position[rows], base_quaternion[rows]
        )
        back = conjugate(quaternions[:, -1])
        place = rotate(back, goal_position[rows] - positions[:, -1])
        return pose_error(arm, path.position[:, -1], place, multiply(back, goal_quaternion[rows]))

    # The generalised Jacobian says how the end moves if the base's final pose depended on the joint goal
    # alone. What the path adds is second order in the motion; the iteration takes care of it.
    return _search(error, arm.generalized_jacobian, start, limits, start if preferred is None else preferred)


def pose_error(arm: FloatingRobot, q: Array, position: Array, quaternion: Array) -> Array:
    """Error (..., 6) [m; rad] from the end-effector's pose to one given in the base frame, base axes."""
    at, rotation = arm.end_effector_pose(q)
    turn = logarithm(multiply(quaternion, conjugate(from_matrix(rotation))))
    return np.concatenate([position - at, turn], axis=-1)


Error = Callable[[Array, Rows], Array]  # from angles (k, n) of rows (k,) to pose errors (k, 6), base axes


def _search(
    error: Error,
    jacobian: Callable[[Array], Array],
    start: Array,
    limits: Array,
    preferred: Array,
) -> JointGoals:
    """Levenberg-Marquardt from `start`, and from other starts for the rows that fail."""
    rows = np.arange(len(start))
    q, residual = _descend(error, jacobian, start, limits, preferred, rows)
    failed = rows[~_within(residual)]
    if failed.size:
        offsets = np.random.default_rng(0).uniform(-RETRY_RADIUS, RETRY_RADIUS, (RETRIES, start.shape[1]))
        again = np.repeat(failed, RETRIES)
        others = (start[failed, None] + offsets).reshape(-1, start.shape[1])
        others, left = _descend(error, jacobian, others, limits, preferred[again], again)
        # Among the starts that reach the pose the one that stays nearest to what is preferred.
        distance = np.linalg.norm(others - preferred[again], axis=1)
        score = np.where(_within(left), distance, 1e3 + left.sum(axis=1)).reshape(-1, RETRIES)
        best = np.arange(failed.size) * RETRIES + score.argmin(axis=1)
        better = left[best].sum(axis=1) < residual[failed].sum(axis=1)
        q[failed[better]], residual[failed[better]] = others[best[better]], left[best[better]]
    return JointGoals(q, _within(residual), residual[:, 0], residual[:, 1])


def _within(residual: Array) -> NDArray[np.bool_]:
    return (residual[:, 0] < POSITION_TOLERANCE) & (residual[:, 1] < ORIENTATION_TOLERANCE)


def _descend(
    error: Error,
    jacobian: Callable[[Array], Array],
    start: Array,
    limits: Array,
    preferred: Array,
    rows: Rows,
) -> tuple[Array, Array]:
    """Best angles (k, n) and their residuals (k, 2) m and rad from starts (k, n) of the tasks `rows` (k,).

    Every row goes its own way: its result does not depend on the rows beside it.
    """
    q = np.clip(start, limits[:, 0], limits[:, 1])
    best, best_residual = q.copy(), np.full((len(q), 2), np.inf)
    active, step = np.arange(len(q)), np.full_like(q, np.inf)
    for iteration in range(ITERATIONS):
        missed = error(q[active], rows[active])
        square = missed * missed
        residual = np.sqrt(np.stack([square[:, :3].sum(axis=1), square[:, 3:].sum(axis=1)], axis=1))
        within = _within(residual)
        # Once inside the tolerance, later steps only settle the redundancy.
        better = within | (residual.sum(axis=1) < best_residual[active].sum(axis=1))
        best[active[better]], best_residual[active[better]] = q[active[better]], residual[better]
        done = within & (np.abs(step[active]).max(axis=1) < SETTLED)
        active, missed = active[~done], missed[~done]
        if active.size == 0:
            break
        wish = BIAS_RATE * DECAY ** max(0, iteration - PATIENCE) * (preferred[active] - q[active])
        step[active] = _step(jacobian(q[active]), missed, wish, q[active], limits)
        q[active] = np.clip(q[active] + step[active], limits[:, 0], limits[:, 1])
    return best, best_residual


def _step(jacobian: Array, error: Array, wish: Array, q: Array, limits: Array) -> Array:
    """Damped step (k, n) from q that takes away the error (k, 6) and is `wish` (k, n) in what is free."""
    step = _damped(jacobian, error, wish)
    # Joints that would leave their range stay where they are, and the others do their work.
    stuck = ((q <= limits[:, 0]) & (step < 0.0)) | ((q >= limits[:, 1]) & (step > 0.0))
    if stuck.any():
        again = stuck.any(axis=1)
        free = ~stuck[again]
        step[again] = _damped(jacobian[again] * free[:, None, :], error[again], wish[again] * free)
    return step / np.maximum(np.abs(step).max(axis=1, keepdims=True) / LARGEST_STEP, 1.0)


def _damped(jacobian: Array, error: Array, wish: Array) -> Array:
    """Minimum of |step - wish|^2 + |J step - error|^2 / damping.

    The damping grows with the squared error (Sugihara 2011): cautious far away, Newton's method at the end.
    """
    transpose = jacobian.swapaxes(1, 2)
    damping = DAMPING + 0.02 * (error * error).sum(axis=1)
    square = jacobian @ transpose + damping[:, None, None] * np.eye(6)
    missing = error - (jacobian @ wish[..., None])[..., 0]
    return wish + (transpose @ np.linalg.solve(square, missing[..., None]))[..., 0]
