"""From splines that are nearly reactionless to an exactly reactionless motion with an exact end.

The motion is thetadot = P(theta) u(t): u is the derivative of the splines, and P projects onto the reaction
null space. It is integrated in steps much shorter than the splines' intervals, and its terminal error is
removed by corrections of the splines.
"""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from agents.planners.dual_arm.free_paths.program import FIXED, FreePathProgram
from agents.planners.dual_arm.held_attitude import HeldAttitude
from space_envs.dynamics.rotations import Array

_SUBSTEPS = 20  # of the integration, in an interval of the splines
_ROUNDS = 8
_TOLERANCE = 1e-10  # m and m/s (rates times the duration), of the terminal error


@dataclass(frozen=True, eq=False)
class ReactionlessMotion:
    """A reactionless motion in the scaled time s = t / T; rates are per s.

    Attributes:
        s: (K,). position, rate, acceleration: (K, n). coefficients: (size, n) of the splines it came from.
        goal_error: largest component of the terminal error, m and m per s.
    """

    s: Array
    position: Array
    rate: Array
    acceleration: Array
    coefficients: Array
    goal_error: float


class ReactionlessRollout:
    """Roll-outs of the splines of one program."""

    def __init__(self, model: HeldAttitude, program: FreePathProgram) -> None:
        mesh, n = program.mesh, program.joints
        self._program, self._model = program, model
        spans = zip(mesh.breaks[:-1], mesh.breaks[1:], strict=True)
        self.s = np.concatenate([*(np.linspace(a, b, _SUBSTEPS, endpoint=False) for a, b in spans), [1.0]])
        middle = 0.5 * (self.s[:-1] + self.s[1:])
        self._rates = np.stack([mesh.basis(at, 1) for at in (self.s[:-1], middle, self.s[1:])], axis=1)
        self._change = mesh.basis(self.s, 2)
        self._steps = _steps(model, n, np.diff(self.s))
        self._accelerated = model.accelerated.map(len(self.s))
        # Weights of corrections that change the accelerations least.
        bending = mesh.basis(mesh.breaks, 2)[:, FIXED:]
        square = bending.T @ bending
        self._soft = np.kron(np.linalg.inv(square), np.eye(n))

    def run(self, coefficients: Array) -> ReactionlessMotion:
        """Integrate the motion of splines with coefficients (size, n)."""
        rates = (self._rates @ coefficients).reshape(len(self.s) - 1, -1)
        path = self._steps(coefficients[0], rates.T).full().T
        position = np.concatenate([coefficients[:1], path])
        at_nodes = np.concatenate([self._rates[:, 0], self._rates[-1:, 2]]) @ coefficients
        rate, acceleration = self._accelerated(position.T, at_nodes.T, (self._change @ coefficients).T)
        return ReactionlessMotion(
            self.s, position, rate.full().T, acceleration.full().T, coefficients, np.inf
        )

    def closed(self, coefficients: Array, parameters: Array) -> ReactionlessMotion:
        """Integrate and correct a motion until it ends at the goal in the program's parameters.

        A correction satisfies the linearised constraints of the program; as the splines are nearly
        reactionless the roll-out follows it to a per cent: each round removes two digits of the error.
        """
        program = self._program
        n, ends = program.joints, slice(program.collocated, program.collocated + program.ending)
        _, slope = program.slope(coefficients[FIXED:].ravel(), parameters)
        rows = slope[: ends.stop, :].full()
        spread = self._soft @ rows.T
        inverse = spread @ np.linalg.pinv(rows @ spread, hermitian=True)
        goal = parameters[n : n + program.goals]
        across = parameters[n + program.goals :].reshape(4, 3).T
        required = np.concatenate([goal, np.zeros(program.ending - len(goal))])

        def measured(splines: Array) -> tuple[ReactionlessMotion, Array]:
            motion = self.run(splines)
            reached = self._model.ending.value(motion.position[-1], motion.rate[-1], across).full()[:, 0]
            error = reached - required
            return replace(motion, goal_error=float(np.abs(error).max())), error

        best, error = measured(coefficients)
        for _ in range(_ROUNDS):
            if best.goal_error < _TOLERANCE:
                break
            corrected = best.coefficients.copy()
            corrected[FIXED:] -= (inverse[:, ends] @ error).reshape(-1, n)
            trial, error = measured(corrected)
            if not trial.goal_error < best.goal_error:
                break
            best = trial
        return best


def _steps(model: HeldAttitude, n: int, lengths: Array) -> ca.Function:
    """(Start (n), u at start, middle and end of each step (3 n, steps)) -> angles after each (n, steps)."""
    q, u, h = ca.MX.sym("q", n), ca.MX.sym("u", 3 * n), ca.MX.sym("h")
    first, middle, end = ca.vertsplit(u, n)

    def rate(at: ca.MX, required: ca.MX) -> ca.MX:
        return model.projected(at, required)

    one = rate(q, first)
    two = rate(q + 0.5 * h * one, middle)
    three = rate(q + 0.5 * h * two, middle)
    four = rate(q + h * three, end)
    step = ca.Function("step", [q, u, h], [q + h / 6.0 * (one + 2.0 * two + 2.0 * three + four)])
    start, required = ca.MX.sym("start", n), ca.MX.sym("required", 3 * n, len(lengths))
    path = step.mapaccum(len(lengths))(start, required, ca.DM(lengths).T)
    return ca.Function("steps", [start, required], [path])
