"""Initial guesses of the optimal control along prescribed paths."""

from collections.abc import Callable, Iterator

import numpy as np

from agents.planners.common.plans import Failure
from agents.planners.dual_arm.prescribed_paths.model import PathModel
from agents.planners.dual_arm.prescribed_paths.null_space import least_energy, solutions, zeta_zero
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.dynamics.rotations import Array

PERTURBATIONS = (0.4, -0.4)  # of further guesses: fraction of the length of (a)'s rates in the null space
STEPS = 120  # of the integration of a guess


def initial_guesses(
    model: PathModel,
    path: PolynomialPath,
    capture: Capture,
    first: list[CapturePlan | Failure],
    times: Array,
) -> Iterator[tuple[str, Array]]:
    """Initial guesses: names and joint angles (N, n) at times (N,) s."""
    for plan in first:
        if isinstance(plan, CapturePlan):
            yield plan.method, plan.sample(times)[0]
    for fraction in PERTURBATIONS:
        guess = _perturbed(model, path, capture, fraction)
        if not isinstance(guess, Failure):
            yield f"perturbed by {fraction:+.1f}", guess(times)


def _perturbed(
    model: PathModel, path: PolynomialPath, capture: Capture, fraction: float
) -> Callable[[Array], Array] | Failure:
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
    table, times = np.array(states), h * np.arange(STEPS + 1)
    return lambda at: np.stack([np.interp(at, times, column) for column in table.T], axis=1)
