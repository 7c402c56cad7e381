"""Reactionless motion along given end-effector paths: zeta = 0 and the least energy at each instant.

The joint rates solve [J_lin; Ibm~] thetadot = [v; 0] (eq. 4 and 5 of shah2013 together). What is left open is
the motion in the null space, the zeta of eq. 9: `plan_zeta_zero` makes the dependent angular velocities
smallest (coordinate partitioning with the pseudo-inverse, zeta = 0), `plan_local` the kinetic energy
(eq. 12 to 14, in closed form). J_g is never inverted, so that only true singularities matter.
"""

from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp
from scipy.linalg import get_lapack_funcs

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.prescribed_paths.check import checked_plan
from agents.planners.dual_arm.prescribed_paths.model import Matrices, PathModel
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

TOLERANCE = 1e-9  # of the integration, relative and absolute
SMALLEST = 1e-4  # m, or none: independent part of a constraint below which a configuration is singular
FASTEST = 10.0  # rad/s; joint rates above it are those of a singularity
MOST_CALLS = 4000  # of the law of joint rates; a regular motion takes a tenth of that
NODES_A_STEP = 6  # of a plan, in each step of the integration, which is shorter where more happens

Choice = Callable[[Matrices, Array, Array], Array]
Law = Callable[[float, Array, Matrices], Array]
"""Joint rates (n,) at a time, joint angles (n,) and the matrices there."""
# LAPACK itself, for `solutions` is called some thousand times a plan: what numpy does around it takes longer.
_geqrf, _orgqr, _trtrs = get_lapack_funcs(("geqrf", "orgqr", "trtrs"), dtype=np.float64)


class Singular(Exception):
    """The constraints have lost rank, or the choice among their solutions is not unique."""


def solutions(at: Matrices, velocity: Array) -> tuple[Array, Array]:
    """A reactionless joint rate (n,) with given end-effector velocities (2 d,), and a basis (n, m) of what
    can be added.

    Raises:
        Singular: if the constraints have lost rank.
    """
    rows, n = at.task.shape
    square = np.zeros((n, n), order="F")
    factors, tau, _, _ = _geqrf(at.task.T)
    if np.abs(np.diagonal(factors)).min() < SMALLEST:
        raise Singular("the end-effector velocities and the reactionless constraint depend on each other")
    square[:, :rows] = factors
    q, _, _ = _orgqr(square, tau, overwrite_a=True)
    wanted = np.zeros(rows)
    wanted[: len(velocity)] = velocity
    along, _ = _trtrs(factors[:rows], wanted, trans=1)
    return q[:, :rows] @ along, q[:, rows:]


def zeta_zero(at: Matrices, particular: Array, null: Array) -> Array:
    """The share of the null space (m,) for which the dependent angular velocities are smallest (zeta = 0)."""
    turning = at.angular @ null
    square = turning.T @ turning
    if square.trace() < SMALLEST**2:
        raise Singular("the dependent angular velocities do not tell the motions of the null space apart")
    return -np.linalg.solve(square, turning.T @ (at.angular @ particular))


def least_energy(at: Matrices, particular: Array, null: Array) -> Array:
    """The share of the null space (m,) for which thetadot' I_m thetadot is smallest."""
    return -np.linalg.solve(null.T @ at.mass @ null, null.T @ at.mass @ particular)


def plan_zeta_zero(
    robot: FloatingRobot, capture: Capture, limits: Limits = Limits()
) -> CapturePlan | Failure:
    """Method (a): polynomial paths, zeta = 0.

    Args:
        limits: joint angles alone are looked at: the path leaves nothing to respect the others with.

    Raises:
        ConfigurationError: for a malformed capture, or limits of another robot.
    """
    return _plan("reactionless", robot, capture, limits, zeta_zero)


def plan_local(robot: FloatingRobot, capture: Capture, limits: Limits = Limits()) -> CapturePlan | Failure:
    """Method (b): polynomial paths, least kinetic energy at each instant; arguments as `plan_zeta_zero`."""
    return _plan("reactionless_local", robot, capture, limits, least_energy)


def capture_path(robot: FloatingRobot, model: PathModel, capture: Capture) -> PolynomialPath | str:
    """The polynomial path of a checked capture, or why its end is out of reach."""
    d = model.dimensions
    start = model(capture.start).tips
    origin = _centre(robot, capture.start)
    end = (capture.position - origin)[:, :d].ravel()
    for arm in range(2):
        away, most = float(np.linalg.norm(end[d * arm : d * (arm + 1)])), robot.reach(arm)
        if away > most:
            return (
                f"grapple point {arm + 1} is {away:.3f} m from the system's centre of mass, the reach of its "
                f"arm is {most:.3f} m"
            )
    still = np.zeros(2 * d)
    return PolynomialPath(start, end, still, capture.velocity[:, :d].ravel(), capture.duration)


def _centre(robot: FloatingRobot, q: Array) -> Array:
    centres = robot.kinematics(q).com
    return (robot.mass[1:] @ centres + robot.mass[0] * robot.com[0]) / robot.mass.sum()


def _plan(
    method: str, robot: FloatingRobot, capture: Capture, limits: Limits, choice: Choice
) -> CapturePlan | Failure:
    capture, limits = capture.checked(robot), limits.checked(robot)
    path = capture_path(robot, PathModel.of(robot), capture)
    if isinstance(path, str):
        return Failure(method, Cause.OUT_OF_REACH, path)

    def rate(time: float, q: Array, at: Matrices) -> Array:
        particular, null = solutions(at, path.velocity(time))
        found = particular + null @ choice(at, particular, null)
        if np.abs(found).max() > FASTEST:
            raise Singular(f"a joint would have to turn at {np.abs(found).max():.3g} rad/s")
        return found

    return integrate(method, robot, capture, limits, path, rate)


def integrate(
    method: str,
    robot: FloatingRobot,
    capture: Capture,
    limits: Limits,
    path: PolynomialPath,
    rate: Law,
    notes: str = "",
) -> CapturePlan | Failure:
    """Follow a law of joint rates from the start of a capture to its end, and check what came of it."""
    model = PathModel.of(robot)
    reached, calls = [0.0], [0]

    def law(time: float, state: Array) -> Array:
        reached[0] = time
        calls[0] += 1
        if calls[0] > MOST_CALLS:
            raise Singular("the joint rates change faster and faster")
        at = model(state[:-1])
        slope = np.empty(len(state))
        slope[:-1] = thetadot = rate(time, state[:-1], at)
        slope[-1] = thetadot @ at.mass @ thetadot
        return slope

    begin = np.append(capture.start, 0.0)
    try:
        found = solve_ivp(
            law,
            (0.0, capture.duration),
            begin,
            "DOP853",
            dense_output=True,
            rtol=TOLERANCE,
            atol=TOLERANCE,
            first_step=capture.duration / 100,
        )
    except Singular as error:
        return Failure(method, Cause.SINGULAR, f"singular at t = {reached[0]:.2f} s: {error}")
    except np.linalg.LinAlgError as error:
        return Failure(method, Cause.SINGULAR, f"singular at t = {reached[0]:.2f} s: {error}")
    if not found.success:
        return Failure(method, Cause.SINGULAR, f"no way on from t = {reached[0]:.2f} s: {found.message}")
    inner = np.arange(NODES_A_STEP) / NODES_A_STEP
    times = np.append((found.t[:-1, None] + np.diff(found.t)[:, None] * inner).ravel(), found.t[-1])
    position = found.sol(times)[:-1].T
    rates = np.array([rate(time, q, model(q)) for time, q in zip(times, position, strict=True)])
    return checked_plan(
        method, robot, capture, limits, path, times, position, rates, float(found.y[-1, -1]), notes
    )
