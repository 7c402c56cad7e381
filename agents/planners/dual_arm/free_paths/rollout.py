"""From splines that are nearly reactionless to a motion that is, exactly, and that ends where it has to.

The motion is thetadot = P(theta) u(t): u is the derivative of the splines, P removes what would turn the
base. It is integrated in steps much shorter than the splines' intervals, and what it misses at the end is put
right by changing the splines.
"""

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from agents.planners.dual_arm.free_paths.model import HeldAttitude
from agents.planners.dual_arm.free_paths.program import FIXED, FreePathProgram
from space_envs.dynamics.rotations import Array

_SUBSTEPS = 20  # of the integration, in an interval of the splines
_ROUNDS = 8
_CLOSE = 1e-10  # m and m/s (rates times the duration), of what is left at the end


@dataclass(frozen=True, eq=False)
class ReactionlessMotion:
    """A reactionless motion in the scaled time s = t / T; rates are per s.

    Attributes:
        s: (K,). position, rate, acceleration: (K, n). coefficients: (size, n) of the splines it came from.
        miss: largest component of what it misses at the end, m and m per s.
    """

    s: Array
    position: Array
    rate: Array
    acceleration: Array
    coefficients: Array
    miss: float


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
        self._still = model.still.map(len(self.s))
        # Corrections that change the accelerations least.
        bending = mesh.basis(mesh.breaks, 2)[:, FIXED:]
        square = bending.T @ bending
        self._soft = np.kron(np.linalg.inv(square), np.eye(n))

    def run(self, coefficients: Array) -> ReactionlessMotion:
        """The motion that the splines with coefficients (size, n) ask for."""
        wanted = (self._rates @ coefficients).reshape(len(self.s) - 1, -1)
        path = self._steps(coefficients[0], wanted.T).full().T
        position = np.concatenate([coefficients[:1], path])
        at_nodes = np.concatenate([self._rates[:, 0], self._rates[-1:, 2]]) @ coefficients
        rate, acceleration = self._still(position.T, at_nodes.T, (self._change @ coefficients).T)
        return ReactionlessMotion(
            self.s, position, rate.full().T, acceleration.full().T, coefficients, np.inf
        )

    def closed(self, coefficients: Array, parameters: Array) -> ReactionlessMotion:
        """The motion after corrections that make it end where the program's parameters say.

        A correction fulfils the linearised constraints of the program; as the splines are all but
        reactionless the roll-out follows it to a per cent: each round takes two digits of the miss away.
        """
        program = self._program
        n, ends = program.joints, slice(program.collocated, program.collocated + program.ending)
        _, slope = program.slope(coefficients[FIXED:].ravel(), parameters)
        rows = slope[: ends.stop, :].full()
        spread = self._soft @ rows.T
        inverse = spread @ np.linalg.pinv(rows @ spread, hermitian=True)
        goal = parameters[n : n + program.shown]
        across = parameters[n + program.shown :].reshape(4, 3).T
        wanted = np.concatenate([goal, np.zeros(program.ending - len(goal))])

        def measured(splines: Array) -> tuple[ReactionlessMotion, Array]:
            motion = self.run(splines)
            reached = self._model.ending.value(motion.position[-1], motion.rate[-1], across).full()[:, 0]
            left = reached - wanted
            return replace(motion, miss=float(np.abs(left).max())), left

        best, left = measured(coefficients)
        for _ in range(_ROUNDS):
            if best.miss < _CLOSE:
                break
            corrected = best.coefficients.copy()
            corrected[FIXED:] -= (inverse[:, ends] @ left).reshape(-1, n)
            now, left = measured(corrected)
            if not now.miss < best.miss:
                break
            best = now
        return best


def _steps(model: HeldAttitude, n: int, lengths: Array) -> ca.Function:
    """(start (n), u at begin, middle and end of each step (3 n, steps)) -> angles after each (n, steps)."""
    q, u, h = ca.MX.sym("q", n), ca.MX.sym("u", 3 * n), ca.MX.sym("h")
    begin, middle, end = ca.vertsplit(u, n)

    def rate(at: ca.MX, wanted: ca.MX) -> ca.MX:
        return model.projected(at, wanted)

    one = rate(q, begin)
    two = rate(q + 0.5 * h * one, middle)
    three = rate(q + 0.5 * h * two, middle)
    four = rate(q + h * three, end)
    step = ca.Function("step", [q, u, h], [q + h / 6.0 * (one + 2.0 * two + 2.0 * three + four)])
    start, wanted = ca.MX.sym("start", n), ca.MX.sym("wanted", 3 * n, len(lengths))
    path = step.mapaccum(len(lengths))(start, wanted, ca.DM(lengths).T)
    return ca.Function("steps", [start, wanted], [path])
