"""Initial guesses of the optimal control along prescribed paths."""

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from agents.planners.common.plans import Failure
from agents.planners.dual_arm.prescribed_paths.model import PathModel
from agents.planners.dual_arm.prescribed_paths.null_space import least_energy, solutions, zeta_zero
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.dynamics.rotations import Array

PERTURBATIONS = (0.4, -0.4)  # of further guesses: fraction of the length of (a)'s rates in the null space
STEPS = 120  # of the integration of a guess


Motion = Callable[[Array], Array]
"""Joint angles (K, n) rad at times (K,) s."""


def initial_guesses(
    model: PathModel, path: PolynomialPath, capture: Capture, known: list[CapturePlan], ends: Array
) -> Iterator[tuple[str, Motion]]:
    """Initial guesses with their names.

    Args:
        known: motions of (a) and (b). ends: (E, n) final configurations, rad.
    """
    for plan in known:
        yield plan.method, partial(_positions, plan)
    motions = {f"perturbed by {x:+.1f}": _perturbed(model, path, capture, x) for x in PERTURBATIONS}
    motions |= {f"drawn to end {k + 1}": _drawn(model, path, capture, end) for k, end in enumerate(ends)}
    for name, motion in motions.items():
        if not isinstance(motion, Failure):
            yield name, motion


def interpolated(angles: Array, capture: Capture) -> Motion:
    """Motion through joint angles (K, n) at equal times from the start of a capture to its end."""
    times = np.linspace(0.0, capture.duration, len(angles))
    return lambda at: np.stack([np.interp(at, times, column) for column in angles.T], axis=1)


def _positions(plan: CapturePlan, times: Array) -> Array:
    return plan.sample(times)[0]


def _perturbed(model: PathModel, path: PolynomialPath, capture: Capture, fraction: float) -> Motion | Failure:
    """Perturbed motion of (a): its rates have a fraction of their length added in the null space."""
    reference = np.ones(len(capture.start))

    def rate(time: float, q: Array) -> Array | Failure:
        at = model(q)
        found = solutions(at, path.velocity(time))
        if isinstance(found, Failure):
            return found
        particular, null = found
        chosen = zeta_zero(at, particular, null)
        if isinstance(chosen, Failure):
            chosen = least_energy(at, particular, null)
        if isinstance(chosen, Failure):
            return chosen
        base = particular + null @ chosen
        direction = null @ (null.T @ reference)
        length = np.sqrt(direction @ direction)
        return base + fraction * np.sqrt(base @ base) * direction / max(length, 1e-9)

    return _integrated(rate, capture)


def _drawn(model: PathModel, path: PolynomialPath, capture: Capture, end: Array) -> Motion | Failure:
    """Motion along the paths that the null space draws to a final configuration (n,)."""

    def rate(time: float, q: Array) -> Array | Failure:
        at = model(q)
        found = solutions(at, path.velocity(time))
        if isinstance(found, Failure):
            return found
        particular, null = found
        s = time / capture.duration
        # The remaining distance falls as 1 - (10 s^3 - 15 s^4 + 6 s^5) = (1 - s)^3 (1 + 3 s + 6 s^2).
        pull = 30.0 * s**2 / ((1.0 + 3.0 * s + 6.0 * s**2) * max(1.0 - s, 1.0 / STEPS) * capture.duration)
        return particular + null @ (null.T @ (pull * (end - q) - particular))

    return _integrated(rate, capture)


def _integrated(rate: Callable[[float, Array], Array | Failure], capture: Capture) -> Motion | Failure:
    """Motion of a law of joint rates, by the midpoint rule."""
    h, q = capture.duration / STEPS, capture.start
    states = [q]
    for step in range(STEPS):
        first = rate(step * h, q)
        if isinstance(first, Failure):
            return first
        second = rate((step + 0.5) * h, q + 0.5 * h * first)
        if isinstance(second, Failure):
            return second
        q = q + h * second
        states.append(q)
    return interpolated(np.array(states), capture)
