"""The quadratic program of one iteration: few equations, many bounds of which few are active."""

from typing import Any

import numpy as np
import piqp

from space_envs.dynamics.rotations import Array

ROUNDS = 8  # of adding bounds that a step would break
SLACK = 1e-4  # share of a bound by which it may be broken
_ACCURACY = 1e-7
_PRESSING = 1e-7  # multiplier above which a bound stays among the active ones


class Bounds:
    """Bounds on angles, rates and accelerations at sampling times, which are linear in the coordinates.

    Args:
        rows: (3, T, m) values of the free functions: of angle, rate, acceleration. fixed: (3, T, n) of the
            motion at coordinates zero.
        low, high: (3, n); infinite where there is no bound.
    """

    def __init__(self, rows: Array, fixed: Array, low: Array, high: Array) -> None:
        scale = np.where(np.isfinite(high - low), 0.5 * (high - low), 1.0)
        self._m = rows.shape[2]
        self._rows = rows.reshape(-1, self._m)
        self._scale = np.broadcast_to(scale[:, None], fixed.shape).reshape(len(self._rows), -1)
        self._low = (low[:, None] - fixed).reshape(self._scale.shape) / self._scale
        self._high = (high[:, None] - fixed).reshape(self._scale.shape) / self._scale
        self._block = rows.shape[1]
        self.any = bool(np.isfinite(self._low).any() or np.isfinite(self._high).any())

    def excess(self, y: Array) -> Array:
        """By how much coordinates (n, m) break each bound, as a share of its width (3 T, n)."""
        value = self._rows @ y.T / self._scale
        return np.maximum(self._low - value, value - self._high)

    def peaks(self, y: Array) -> set[tuple[int, int]]:
        """Rows and joints of the bounds that are broken more than at the times before and after."""
        excess = self.excess(y)
        if excess.max() <= SLACK:
            return set()
        excess = excess.reshape(3, self._block, -1)
        top = excess > SLACK
        top[:, 1:] &= excess[:, 1:] >= excess[:, :-1]
        top[:, :-1] &= excess[:, :-1] >= excess[:, 1:]
        kind, time, joint = np.nonzero(top)
        return set(zip((kind * self._block + time).tolist(), joint.tolist(), strict=True))

    def linear(self, y: Array, chosen: set[tuple[int, int]]) -> tuple[Array, Array, Array]:
        """Rows (k, n m) with bounds on a step from y (n, m) that make it keep chosen bounds."""
        row, joint = np.array(sorted(chosen)).T
        matrix = np.zeros((len(row), y.size))
        columns = joint[:, None] * self._m + np.arange(self._m)
        scale = self._scale[row, joint]
        matrix[np.arange(len(row))[:, None], columns] = self._rows[row] / scale[:, None]
        value = (self._rows[row] * y[joint]).sum(axis=1) / scale
        low, high = self._low[row, joint] - value, self._high[row, joint] - value
        return matrix, low, high


class QuadraticProgram:
    """min d' B d / 2 + g' d subject to A d = b, the bounds, and further rows."""

    def __init__(self, bounds: Bounds) -> None:
        self._bounds = bounds
        self._active: set[tuple[int, int]] = set()
        self._pressing = np.zeros(0)

    @property
    def pressing(self) -> set[tuple[int, int]]:
        """Rows and joints of the bounds that held the last step back; all looked at if it did not end."""
        if len(self._pressing) != len(self._active):
            return set(self._active)
        ordered = sorted(self._active)
        return {ordered[k] for k in np.flatnonzero(self._pressing > _PRESSING)}

    def solve(
        self,
        hessian: Array,
        gradient: Array,
        equations: Array,
        right: Array,
        y: Array,
        extra: tuple[Array, Array, Array] | None = None,
    ) -> tuple[Array, Array] | None:
        """Step (n m,) and multipliers of the equations, or None if there is no step.

        Args:
            hessian: positive definite. y: (n, m), where the step starts. extra: rows (k, n m), low and high.
        """
        self._active = self.pressing  # what the last program did not press on is left out
        for _ in range(ROUNDS):
            found = self._solve(hessian, gradient, equations, right, y, extra)
            if found is None or not self._bounds.any:
                return found
            broken = self._bounds.peaks(y + found[0].reshape(y.shape)) - self._active
            if not broken:
                return found
            self._active |= broken
        return found

    def _solve(
        self,
        hessian: Array,
        gradient: Array,
        equations: Array,
        right: Array,
        y: Array,
        extra: tuple[Array, Array, Array] | None,
    ) -> tuple[Array, Array] | None:
        size = len(gradient)
        parts = [self._bounds.linear(y, self._active)] if self._active else []
        parts += [] if extra is None or not len(extra[1]) else [extra]
        if not parts:
            matrix = np.zeros((size + len(right), size + len(right)))
            matrix[:size, :size], matrix[size:, :size], matrix[:size, size:] = hessian, equations, equations.T
            try:
                solution = np.linalg.solve(matrix, np.concatenate([-gradient, right]))
            except np.linalg.LinAlgError:
                return None
            return solution[:size], solution[size:]
        rows, low, high = (np.concatenate(column) for column in zip(*parts, strict=True))
        solver: Any = piqp.DenseSolver()  # its stubs want float64 where numpy's say floating
        solver.settings.eps_abs = solver.settings.eps_rel = _ACCURACY
        solver.setup(hessian, gradient, equations, right, rows, low, high, None, None)
        if solver.solve() != piqp.PIQP_SOLVED:
            return None
        pressing = solver.result.z_l + solver.result.z_u
        self._pressing = pressing[: len(self._active)]
        return solver.result.x.copy(), solver.result.y.copy()
