"""The quadratic program of a control step: bounds give way, at a price, rather than leave no motion."""

from collections.abc import Iterable, Sequence

import numpy as np
import piqp

from agents.planners.single_arm.weights.quadratic import ROUNDS, Bounds
from space_envs.dynamics.rotations import Array

Active = frozenset[tuple[int, int]]
Rows = tuple[Array, Array, Array]  # (k, n m), with lowest and highest values (k,)

PRICE = 30.0  # of breaking the bounds by their half width; far above what a limit is worth
NEAR = 0.02  # share of a bound's half width, within which it is looked at in the next control step
SLACK = 5e-3  # share of the half width, by which a bound may be broken besides
_ACCURACY = 1e-7


class ElasticProgram:
    """min d' B d / 2 + g' d + PRICE s, where s >= 0 is the largest share by which a bound is broken.

    A state that was measured need not be on the way that was planned, and then a motion within all bounds may
    not exist.

    Args:
        bounds: of the motion. active: rows and joints of those that are looked at from the first round on.
    """

    def __init__(self, bounds: Bounds, active: Iterable[tuple[int, int]] = ()) -> None:
        self._bounds = bounds
        self._active: set[tuple[int, int]] = set(active)

    def solve(self, hessian: Array, gradient: Array, y: Array, extra: Sequence[Rows] = ()) -> Array | None:
        """Step (n, m) from coordinates y (n, m), or None if the solver fails.

        Args:
            hessian: (n m, n m), positive definite. gradient: (n m,). extra: rows on the step, which
                give way likewise.
        """
        step, share = None, 0.0
        for _ in range(ROUNDS):
            if (found := self._solve(hessian, gradient, y, extra)) is None:
                return step
            step, share = found
            much = self._bounds.excess(y + step) > share + SLACK
            broken = {place for place in self._bounds.peaks(y + step) - self._active if much[place]}
            if not broken:
                break
            self._active |= broken
        return step

    def touched(self, y: Array) -> Active:
        """Rows and joints of the bounds looked at that coordinates (n, m) come near."""
        near = self._bounds.excess(y) > -NEAR
        return frozenset(place for place in self._active if near[place])

    def _solve(
        self, hessian: Array, gradient: Array, y: Array, extra: Sequence[Rows]
    ) -> tuple[Array, float] | None:
        """Step (n, m) and the share s."""
        size = y.size
        parts = [self._bounds.linear(y, self._active)] if self._active else []
        parts += [rows for rows in extra if len(rows[1])]
        if not parts:
            return np.linalg.solve(hessian, -gradient).reshape(y.shape), 0.0
        rows, low, high = (np.concatenate(column) for column in zip(*parts, strict=True))
        # Only the nearer side can matter at a row; the other is far.
        sign = np.where(high < -low, 1.0, -1.0)
        matrix = np.concatenate([rows * sign[:, None], -np.ones((len(rows), 1))], axis=1)
        limit = np.where(sign > 0.0, high, -low)
        square = np.zeros((size + 1, size + 1))
        square[:size, :size], square[size, size] = hessian, PRICE
        linear = np.append(gradient, PRICE)
        lowest = np.full(size + 1, -np.inf)
        lowest[size] = 0.0
        solver = piqp.DenseSolver()
        solver.settings.eps_abs = solver.settings.eps_rel = _ACCURACY
        none = np.full(len(limit), -np.inf)
        solver.setup(square, linear, None, None, matrix, none, limit, lowest, None)
        if solver.solve() != piqp.PIQP_SOLVED:
            return None
        return solver.result.x[:size].reshape(y.shape), float(solver.result.x[size])
