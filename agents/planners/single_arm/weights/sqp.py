"""Damped Gauss-Newton in the weights of a ProMP: the least eq. 20 for a goal, within limits."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from agents.planners.single_arm.weights.quadratic import Bounds, QuadraticProgram
from agents.planners.single_arm.weights.weight_space import Disturbance, WeightSpace
from space_envs.dynamics.rotations import Array

ITERATIONS = 60
# Relative gain of an iteration below which it is the last. On 60 validation goals with the attitude kept,
# 1e-3 leaves 0.6 % of the cost in one goal of ten and 9 % at most, 1e-4 leaves 0.03 % and 0.8 % for a fifth
# more iterations.
ENOUGH = 1e-4
MISS = 1e-5  # m and rad, left at the end
FAR = 0.3  # m or rad, of which an iteration takes away at most so much of the miss
DAMPING = 1e-3  # at first, m^2/rad^2 per unit of the integral of qdot' qdot
LEAST_DAMPING, MOST_DAMPING = 1e-6, 1e2


class Rows(Protocol):
    """Inequalities that are not linear, as rows at one motion."""

    def violation(self, y: Array) -> float:
        """Sum of what they are broken by at coordinates (n, m)."""
        ...

    def linear(self, y: Array, at: Disturbance, part: float) -> tuple[Array, Array, Array]:
        """Rows (k, n m) on a step from y, with lowest and highest values.

        A step shall make good at least `part` of what is broken.
        """
        ...


@dataclass(frozen=True, eq=False)
class SqpResult:
    """Coordinates (n, m) with their cost, m^2/s, largest miss, m or rad, what is broken of the inequalities
    that are not linear, in sum, and why iterations ended."""

    y: Array
    cost: float
    miss: float
    broken: float
    iterations: int
    status: str


def minimise(
    space: WeightSpace,
    bounds: Bounds,
    begin: Array,
    keep_attitude: bool,
    rows: tuple[Rows, ...] = (),
    enough: float = ENOUGH,
    iterations: int = ITERATIONS,
) -> SqpResult:
    """Improve coordinates (n, m) until an iteration gains less than `enough` of the cost.

    Each iteration minimises the linearised residual, damped, on the linearised goal and within the bounds. A
    step that the exact penalty function does not like is first corrected to second order, then shortened by
    damping. `status` is converged, iterations, infeasible (no step keeps the bounds) or stuck.
    """
    asked = 9 if keep_attitude else 6
    program = QuadraticProgram(bounds)
    unit = np.eye(space.size)
    damping, share, price = DAMPING, 1.0, 1e-4
    inside = program.solve(unit, np.zeros(space.size), np.zeros((0, space.size)), np.zeros(0), begin)
    if inside is None:
        return SqpResult(begin, np.inf, np.inf, np.inf, 0, "infeasible")
    y = begin + inside[0].reshape(begin.shape)  # the nearest within the bounds
    at = space.disturbance(y[None])
    broken = float(sum(row.violation(y) for row in rows))
    for number in range(1, iterations + 1):
        jacobian, miss, equations = at.residual_slope[0], at.miss[0, :asked], at.miss_slope[0, :asked]
        gradient, square = 2.0 * at.residual[0] @ jacobian, 2.0 * jacobian.T @ jacobian
        largest = float(np.abs(miss).max())
        part = min(share, FAR / max(largest, 1e-12))
        while True:
            extra = _together([row.linear(y, at, part) for row in rows])
            found = program.solve(square + damping * unit, gradient, equations, -part * miss, y, extra)
            if found is not None or part < 0.05:
                break
            part *= 0.5
        if found is None:
            return _solution(y, at, asked, broken, number, "infeasible")
        step, multipliers = found
        price = max(price, 1.5 * float(np.abs(multipliers).max()))
        here = float(at.cost[0]) + price * (np.abs(miss).sum() + broken)
        left = at.residual[0] + jacobian @ step
        hoped = here - (float(left @ left) + price * (1.0 - part) * np.abs(miss).sum())
        there, after, value = _tried(space, rows, y + step.reshape(y.shape), asked, price)
        if here - value < 0.3 * hoped:
            curved = equations @ step - after  # what the step's own curvature adds
            second = program.solve(square + damping * unit, gradient, equations, curved, y, extra)
            if second is not None:
                other = _tried(space, rows, y + second[0].reshape(y.shape), asked, price)
                if other[2] < value:
                    there, after, value = other
        gain = (here - value) / max(hoped, 1e-300)
        if gain > 0.05:
            before = float(at.cost[0])
            y, at = there, space.disturbance(there[None])
            broken = float(sum(row.violation(y) for row in rows))
            share = min(2.0 * share, 1.0)
            if gain > 0.6:
                damping = max(0.25 * damping, LEAST_DAMPING)
            elif gain < 0.25:
                damping *= 4.0
            done = np.abs(at.miss[0, :asked]).max() < MISS and broken < MISS
            if done and part == 1.0 and abs(before - float(at.cost[0])) < enough * before:
                return _solution(y, at, asked, broken, number, "converged")
        else:
            damping, share = 8.0 * damping, 0.5 * share
            if damping > MOST_DAMPING:
                return _solution(y, at, asked, broken, number, "stuck")
    return _solution(y, at, asked, broken, iterations, "iterations")


def _solution(y: Array, at: Disturbance, asked: int, broken: float, number: int, status: str) -> SqpResult:
    return SqpResult(y, float(at.cost[0]), float(np.abs(at.miss[0, :asked]).max()), broken, number, status)


def _tried(
    space: WeightSpace, rows: tuple[Rows, ...], y: Array, asked: int, price: float
) -> tuple[Array, Array, float]:
    cost, miss = space.values(y[None])
    broken = float(sum(row.violation(y) for row in rows))
    return y, miss[0, :asked], float(cost[0]) + price * (np.abs(miss[0, :asked]).sum() + broken)


def _together(parts: list[tuple[Array, Array, Array]]) -> tuple[Array, Array, Array] | None:
    if not parts:
        return None
    rows, low, high = (np.concatenate(column) for column in zip(*parts, strict=True))
    return rows, low, high
