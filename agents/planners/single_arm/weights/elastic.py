"""Quadratic program of a control step with soft bounds, so that it always has a solution."""

from collections.abc import Iterable, Sequence

import daqp
import numpy as np

from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.weights.bounds import Bounds
from agents.planners.single_arm.weights.quadratic import METHOD, ROUNDS
from space_envs.dynamics.rotations import Array

Active = frozenset[tuple[int, int]]
Rows = tuple[Array, Array, Array]  # (k, n m), with lowest and highest values (k,)

SHARE_PENALTY = 30.0  # on violating the bounds by their half width; far above any gain in cost
CLOSE = 0.02  # fraction of the half width within which a bound is a candidate in the next control step
SLACK = 5e-3  # fraction of the half width by which a bound may be violated without penalty


class ElasticProgram:
    """min d' B d / 2 + g' d + SHARE_PENALTY s, with s >= 0 the largest relative violation of a bound.

    A measured state need not be on the planned motion, and then no motion within all bounds may exist.

    Args:
        bounds: on the motion. active: rows and joints of those that are imposed from the first round on.
    """

    def __init__(self, bounds: Bounds, active: Iterable[tuple[int, int]] = ()) -> None:
        self._bounds = bounds
        self._active: set[tuple[int, int]] = set(active)

    def solve(self, hessian: Array, gradient: Array, y: Array, extra: Sequence[Rows] = ()) -> Array | Failure:
        """Step (n, m) from coordinates y (n, m).

        Args:
            hessian: (n m, n m), positive definite. gradient: (n m,). extra: rows on the step, also
                soft.
        """
        step: Array | Failure = Failure(METHOD, Cause.SOLVER, "no round was solved")
        for number in range(ROUNDS):
            found = self._solve(hessian, gradient, y, extra)
            if isinstance(found, Failure):
                return step if number else found
            step, share = found
            violated = self._bounds.excess(y + step) > share + SLACK
            added = {place for place in self._bounds.peaks(y + step) - self._active if violated[place]}
            if not added:
                break
            self._active |= added
        return step

    def close(self, y: Array) -> Active:
        """Rows and joints of the imposed bounds that are close to coordinates (n, m)."""
        near = self._bounds.excess(y) > -CLOSE
        return frozenset(place for place in self._active if near[place])

    def _solve(
        self, hessian: Array, gradient: Array, y: Array, extra: Sequence[Rows]
    ) -> tuple[Array, float] | Failure:
        """Step (n, m) and relative violation s."""
        size = y.size
        parts = [self._bounds.linear(y, self._active)] if self._active else []
        parts += [rows for rows in extra if len(rows[1])]
        if not parts:
            return np.linalg.solve(hessian, -gradient).reshape(y.shape), 0.0
        rows, low, high = (np.concatenate(column) for column in zip(*parts, strict=True))
        # Only the nearer side of a row can be active.
        sign = np.where(high < -low, 1.0, -1.0)
        matrix = np.concatenate([rows * sign[:, None], -np.ones((len(rows), 1))], axis=1)
        limit = np.where(sign > 0.0, high, -low)
        square = np.zeros((size + 1, size + 1))
        square[:size, :size], square[size, size] = hessian, SHARE_PENALTY
        linear = np.append(gradient, SHARE_PENALTY)
        slack = np.zeros((1, size + 1))
        slack[0, size] = 1.0
        high = np.append(limit, np.inf)
        low = np.append(np.full(len(limit), -np.inf), 0.0)
        kinds = np.zeros(len(high), dtype=np.int32)
        found, _, status, _ = daqp.solve(square, linear, np.concatenate([matrix, slack]), high, low, kinds)
        if status <= 0:
            return Failure(METHOD, Cause.SOLVER, f"the quadratic program ended with status {status}")
        return found[:size].reshape(y.shape), float(found[size])
