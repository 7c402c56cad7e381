"""Quadratic program of one step: the goal's equations, and rows whose largest violation is paid for."""

from typing import NamedTuple

import daqp
import numpy as np

from space_envs.dynamics.rotations import Array

VIOLATION = 1000.0  # price of the largest violation, in the unit of the objective
_CURVED = 1e-2  # of it, second derivative of that price, which makes the program strictly convex
_EQUATION = 5  # kind of a row for the solver
_NONE = 1e30  # stands for no limit


class ProgramStep(NamedTuple):
    """Minimum: step (m,), multipliers (r,) of the equations, and the largest violation that remains."""

    step: Array
    multiplier: Array
    violation: float


class StepProgram:
    """min d' B d / 2 + g' d + VIOLATION s subject to A d = -miss, G d + excess <= s, s >= 0.

    Args:
        hessian: (m, m), positive definite. gradient: (m,). equations: (r, m). rows: (k, m).
    """

    def __init__(self, hessian: Array, gradient: Array, equations: Array, rows: Array) -> None:
        size, count = len(gradient), len(equations)
        self._square = np.zeros((size + 1, size + 1))
        self._square[:size, :size], self._square[size, size] = hessian, _CURVED * VIOLATION
        self._linear = np.append(gradient, VIOLATION)
        self._matrix = np.zeros((count + len(rows) + 1, size + 1))
        self._matrix[:count, :size], self._matrix[count:-1, :size] = equations, rows
        self._matrix[count:-1, size], self._matrix[-1, size] = -1.0, 1.0
        self._kinds = np.zeros(len(self._matrix), dtype=np.int32)
        self._kinds[:count] = _EQUATION

    def solve(self, miss: Array, excess: Array) -> ProgramStep | None:
        """The step that takes a miss (r,) away, from rows with an excess (k,); None if the solver fails."""
        high = np.concatenate([-miss, -excess, [_NONE]])
        low = np.concatenate([-miss, np.full(len(excess), -_NONE), [0.0]])
        found, _, status, information = daqp.solve(
            self._square, self._linear, self._matrix, high, low, self._kinds
        )
        if status <= 0:
            return None
        return ProgramStep(found[:-1], information["lam"][: len(miss)], float(found[-1]))
