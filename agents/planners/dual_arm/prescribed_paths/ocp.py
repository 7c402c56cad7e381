"""Optimal control along given end-effector paths: eq. 15 and 16 of shah2013 by Gauss collocation.

zeta is chosen for the least integral of thetadot' I_m thetadot over the motion; `collocation.py` says how.
"""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.prescribed_paths.instantaneous import (
    Singular,
    capture_path,
    integrate,
    least_energy,
    plan_local,
    plan_zeta_zero,
    solutions,
    zeta_zero,
)
from agents.planners.dual_arm.prescribed_paths.model import Matrices, PathModel
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.prescribed_paths.program import (
    BOUNDED_NODES,
    NODES,
    CollocatedMotion,
    PrescribedPathProgram,
)
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.checks import flag
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError

METHOD = "reactionless_ocp"
PERTURBATIONS = (0.4, -0.4)  # of further starts: (a) plus a share of itself in the null space
BOUNDS = (Cause.INFEASIBLE, Cause.JOINT_LIMIT)  # of failures that tighter bounds may mend
SHARES = (0.999, 0.98, 0.95, 0.9)  # of the bounds, in turn: they are not imposed between the points
COARSE = 120  # steps of the integration that makes a start
FEEDBACK = 0.5  # 1/s, with which the accurate motion follows the collocated one


def plan_ocp(
    robot: FloatingRobot, capture: Capture, limits: Limits = Limits(), *, from_rest: bool = False
) -> CapturePlan | Failure:
    """Method (c): polynomial paths, zeta for the least energy over the motion.

    Several starts are tried, (a) and (b) among them, and the best is returned after an accurate integration,
    so that the plan is never worse than either.

    Args:
        limits: joint angles, rates and accelerations are respected, at the Gauss points and between them;
            `control` bounds |zeta|. Torque limits are not: the path leaves too little to meet them with.
        from_rest: whether the motion starts from rest; as in the paper it otherwise may start with a jump of
            the rates. Without an acceleration limit the least energy is the same, and is not attained.

    Raises:
        ConfigurationError: for a malformed capture, or a robot that is not planar.
    """
    capture, limits, model = capture.checked(robot), limits.checked(robot), PathModel.of(robot)
    flag("from_rest", from_rest)
    if model.dimensions != 2:
        raise ConfigurationError(
            "reactionless_ocp plans for the planar robot; use reactionless_free in space"
        )
    path = capture_path(robot, model, capture)
    if isinstance(path, str):
        return Failure(METHOD, Cause.OUT_OF_REACH, path)
    first = [plan(robot, capture, limits) for plan in (plan_zeta_zero, plan_local)]
    # Without bounds first, from every start: that takes milliseconds. The best are then led into the bounds,
    # where a start from rest is one.
    found: list[tuple[float, str, CollocatedMotion]] = []
    reasons = []
    free = PrescribedPathProgram.of(robot, BOUNDED_NODES if from_rest else NODES)
    for name, guess in _starts(model, path, capture, first, free.times(capture.duration)):
        solution = free.solve(path, capture, Limits(), guess)
        if isinstance(solution, str):
            reasons.append(f"from {name}: {solution}")
        else:
            found.append((solution.energy, name, solution))
    found.sort(key=lambda each: each[0])
    best: CapturePlan | None = None
    for _, name, solution in found:
        for plan in _attempts(
            robot, model, path, capture, limits, solution, from_rest, f"best start: {name}"
        ):
            if isinstance(plan, CapturePlan):
                best = plan
                break
            reasons.append(f"from {name}: {plan if isinstance(plan, str) else plan.reason}")
        if best is not None:
            break
    for plan in first:
        if isinstance(plan, CapturePlan) and (best is None or plan.energy < best.energy):
            best = replace(plan, method=METHOD, notes=f"collocation found nothing better than {plan.method}")
    if best is not None:
        return best
    causes = [plan.cause for plan in first if isinstance(plan, Failure)]
    singular = all(cause is Cause.SINGULAR for cause in causes)
    cause = Cause.SINGULAR if singular else Cause.INFEASIBLE if found else Cause.SOLVER
    told = [f"{plan.method}: {plan.reason}" for plan in first if isinstance(plan, Failure)]
    return Failure(METHOD, cause, "; ".join(dict.fromkeys([*told, *reasons])))


def _attempts(
    robot: FloatingRobot,
    model: PathModel,
    path: PolynomialPath,
    capture: Capture,
    limits: Limits,
    solution: CollocatedMotion,
    from_rest: bool,
    note: str,
) -> Iterator[CapturePlan | Failure | str]:
    """What comes of a solution without bounds: as it is, then led into bounds that are drawn in step by step.

    What fails for another reason than the bounds is not tried again.
    """
    if not from_rest:
        plan = _followed(robot, model, path, capture, limits, solution, note)
        yield plan
        if isinstance(plan, Failure) and plan.cause not in BOUNDS:
            return
    if not from_rest and all(bound is None for bound in vars(limits).values()):
        return
    for share in SHARES:
        led = _led(robot, model, path, capture, limits, solution, from_rest, share)
        if isinstance(led, str):
            yield led
            return
        plan = _followed(robot, model, path, capture, limits, led, note)
        yield plan
        if isinstance(plan, Failure) and plan.cause not in BOUNDS:
            return


def _led(
    robot: FloatingRobot,
    model: PathModel,
    path: PolynomialPath,
    capture: Capture,
    limits: Limits,
    solution: CollocatedMotion,
    from_rest: bool,
    share: float,
) -> CollocatedMotion | str:
    """Lead a solution without bounds into them."""
    bounded = limits.acceleration is not None, limits.control is not None
    programme = PrescribedPathProgram.of(robot, BOUNDED_NODES, from_rest, *bounded)
    curve = solution.curve()
    guess = np.array([curve(time)[0] for time in programme.times(capture.duration)])
    return programme.solve(path, capture, limits, guess, share)


def _followed(
    robot: FloatingRobot,
    model: PathModel,
    path: PolynomialPath,
    capture: Capture,
    limits: Limits,
    solution: CollocatedMotion,
    note: str,
) -> CapturePlan | Failure:
    """Follow a collocated motion accurately: exactly on the paths, and exactly reactionless."""
    curve = solution.curve()

    def rate(time: float, q: Array, at: Matrices) -> Array:
        particular, null = solutions(at, path.velocity(time))
        position, velocity = curve(time)
        wanted = velocity + FEEDBACK * (position - q)
        return particular + null @ (null.T @ (wanted - particular))

    return integrate(METHOD, robot, capture, limits, path, rate, note)


def _starts(
    model: PathModel,
    path: PolynomialPath,
    capture: Capture,
    first: list[CapturePlan | Failure],
    times: Array,
) -> Iterator[tuple[str, Array]]:
    """Names and joint angles (N, n) at some times (N,) to start from."""
    for plan in first:
        if isinstance(plan, CapturePlan):
            yield plan.method, plan.sample(times)[0]
    for share in PERTURBATIONS:
        guess = _perturbed(model, path, capture, share)
        if guess is not None:
            yield f"perturbed by {share:+.1f}", guess(times)


def _perturbed(
    model: PathModel, path: PolynomialPath, capture: Capture, share: float
) -> Callable[[Array], Array] | None:
    """A motion beside (a), integrated coarsely: its rates are (a)'s plus a share of their size in the null
    space."""
    reference = np.ones(len(capture.start))

    def rate(time: float, q: Array) -> Array:
        at = model(q)
        particular, null = solutions(at, path.velocity(time))
        try:
            chosen = zeta_zero(at, particular, null)
        except Singular:
            chosen = least_energy(at, particular, null)
        base = particular + null @ chosen
        way = null @ (null.T @ reference)
        size = np.sqrt(way @ way)
        return base + share * np.sqrt(base @ base) * way / max(size, 1e-9)

    h, q = capture.duration / COARSE, capture.start
    states = [q]
    try:
        for step in range(COARSE):
            middle = q + 0.5 * h * rate(step * h, q)
            q = q + h * rate((step + 0.5) * h, middle)
            states.append(q)
    except (Singular, np.linalg.LinAlgError):
        return None
    table, times = np.array(states), h * np.arange(COARSE + 1)
    return lambda at: np.stack([np.interp(at, times, column) for column in table.T], axis=1)
