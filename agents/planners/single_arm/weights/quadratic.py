"""Quadratic program of one iteration: few equations, and many bounds of which few are active."""

import daqp
import numpy as np

from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.weights.bounds import Bounds
from space_envs.dynamics.rotations import Array

METHOD = "quadratic program"
ROUNDS = 8  # of adding violated bounds
_EQUATION = 5  # kind of a row for the solver
_LEAST_MULTIPLIER = 1e-9  # of an active bound


class QuadraticProgram:
    """min d' B d / 2 + g' d subject to A d = b, the bounds, and further rows."""

    def __init__(self, bounds: Bounds) -> None:
        self._bounds = bounds
        self._candidates: set[tuple[int, int]] = set()
        self._multipliers = np.zeros(0)

    @property
    def active(self) -> set[tuple[int, int]]:
        """Rows and joints of the bounds that limited the last step; all candidates if it failed."""
        if len(self._multipliers) != len(self._candidates):
            return set(self._candidates)
        ordered = sorted(self._candidates)
        return {ordered[k] for k in np.flatnonzero(self._multipliers > _LEAST_MULTIPLIER)}

    def solve(
        self,
        hessian: Array,
        gradient: Array,
        equations: Array,
        right: Array,
        y: Array,
        extra: tuple[Array, Array, Array] | None = None,
    ) -> tuple[Array, Array] | Failure:
        """Return the step (n m,) and the multipliers of the equations.

        Args:
            hessian: positive definite. y: (n, m), where the step starts. extra: rows (k, n m), low and high.
        """
        self._candidates = self.active  # bounds that did not limit the last step are dropped
        for _ in range(ROUNDS):
            found = self._solve(hessian, gradient, equations, right, y, extra)
            if isinstance(found, Failure) or not self._bounds.any:
                return found
            violated = self._bounds.peaks(y + found[0].reshape(y.shape)) - self._candidates
            if not violated:
                return found
            self._candidates |= violated
        return found

    def _solve(
        self,
        hessian: Array,
        gradient: Array,
        equations: Array,
        right: Array,
        y: Array,
        extra: tuple[Array, Array, Array] | None,
    ) -> tuple[Array, Array] | Failure:
        parts = [(equations, right, right)]
        parts += [self._bounds.linear(y, self._candidates)] if self._candidates else []
        parts += [] if extra is None or not len(extra[1]) else [extra]
        rows, low, high = (np.concatenate(column) for column in zip(*parts, strict=True))
        kinds, count = np.zeros(len(low), dtype=np.int32), len(right)
        kinds[:count] = _EQUATION
        step, _, status, information = daqp.solve(hessian, gradient, rows, high, low, kinds)
        if status <= 0:
            return Failure(METHOD, Cause.INFEASIBLE, f"the quadratic program ended with status {status}")
        multipliers = information["lam"]
        self._multipliers = np.abs(multipliers[count : count + len(self._candidates)])
        return step, multipliers[:count]
