"""Solutions of nonlinear programs from several initial guesses."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import TypeVar

import casadi as ca
import numpy as np

from agents.planners.common.plans import Cause, Failure
from space_envs.dynamics.rotations import Array


@dataclass(frozen=True, eq=False)
class Solution:
    """Solution of a program: its cost, and its variables in the shape that the solver gives them."""

    cost: float
    variables: Array


S = TypeVar("S", bound=Solution)


def solved(
    method: str,
    solver: ca.Function,
    bounds: tuple[Array, Array],
    tolerance: float,
    scale: Array | float = 1.0,
    **inputs: Array,
) -> Solution | Failure:
    """Solve a program; a result within the constraints counts, even if Ipopt would continue to improve it.

    Args:
        solver: of CasADi's `nlpsol`. bounds: of the constraints. tolerance: on their largest violation,
            divided by `scale`. inputs: of the solver: x0, p, lbx and ubx.

    Returns:
        The solution, or a failure whose reason is Ipopt's status.
    """
    low, high = bounds
    result = solver(lbg=low, ubg=high, **inputs)
    g = result["g"].full()[:, 0]
    violation = float(np.maximum(np.maximum(low - g, g - high) / scale, 0.0).max())
    status = solver.stats()["return_status"]
    if not violation < tolerance or status == "Infeasible_Problem_Detected":
        return Failure(method, Cause.SOLVER, status, violation)
    return Solution(float(result["f"]), result["x"].full()[:, 0])


def distinct(solved: Iterable[S | Failure], resolution: float) -> list[S]:
    """Solutions in the order of their costs, without failures and those that cost almost the same.

    Args:
        resolution: relative difference of costs below which two solutions count as one.
    """
    found: list[S] = []
    for solution in sorted((s for s in solved if not isinstance(s, Failure)), key=lambda s: s.cost):
        if not found or solution.cost > (1.0 + resolution) * found[-1].cost:
            found.append(solution)
    return found


def unsolved(method: str, failures: list[Failure]) -> Failure:
    """Failure of all starts of a solver, with the reason of the one nearest to a solution."""
    least = min(failures, key=lambda failure: failure.residual)
    reason = f"Ipopt ended with {least.reason} from {len(failures)} starts and left {least.residual:.2e}"
    return Failure(method, Cause.SOLVER, reason)
