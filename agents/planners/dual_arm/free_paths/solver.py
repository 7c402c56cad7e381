"""Solutions of the free-path programs of one capture, and the exact motions that they become."""

import numpy as np

from agents.planners.common.plans import Failure, JointPath, Limits
from agents.planners.common.solutions import Solution, solved
from agents.planners.common.splines import Mesh
from agents.planners.dual_arm.check import check
from agents.planners.dual_arm.free_paths.nearness import PARAMETERS, Nearness
from agents.planners.dual_arm.free_paths.program import FIXED, FreePathProgram, build
from agents.planners.dual_arm.free_paths.rollout import ReactionlessRollout
from agents.planners.dual_arm.goals import EndGoals
from agents.planners.dual_arm.held_attitude import HeldAttitude
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

METHOD = "reactionless_free"
# Lengths of the splines' intervals in a motion of 20 s: 0.17 s at the ends and 1.1 s in the middle.
INTERVALS, GROWTH, STEPS = 24, 1.6, 4
MESH = Mesh.graded(INTERVALS, GROWTH, STEPS)
ANGLE_MARGIN = 1e-3  # rad, of the splines to the joint limits
TOLERANCE = 0.05  # on the violation of a program's constraints, in their units, that the roll-out can correct

_IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-5, "max_iter": 100}
# Nearness has kinks where the nearest points jump: iterations end when the objective has settled.
_IPOPT_CLEAR = _IPOPT | {
    "max_iter": 60,
    "acceptable_iter": 4,
    "acceptable_tol": 1e6,
    "acceptable_dual_inf_tol": 1e6,
    "acceptable_constr_viol_tol": 1e-4,
    "acceptable_obj_change_tol": 1e-3,
}


@built_once
def free_program(robot: FloatingRobot) -> FreePathProgram:
    """Program without obstacles of a robot, built at the first use and kept."""
    model = HeldAttitude.of(robot)
    options = {"print_time": False, "ipopt": _IPOPT}
    return build(model, model.energy, robot.n_joints, MESH, options)


@built_once
def clear_program(robot: FloatingRobot) -> FreePathProgram:
    """Program with a cost on nearness of a robot, built at the first use and kept."""
    model, n = HeldAttitude.of(robot), robot.n_joints
    cost = Nearness.of(robot, model.dimensions == 2).added_to(model.energy, n)
    options = {"print_time": False, "ipopt": _IPOPT_CLEAR}
    return build(model, cost, n, MESH, options, PARAMETERS)


@built_once
def _rollout(robot: FloatingRobot) -> ReactionlessRollout:
    return ReactionlessRollout(HeldAttitude.of(robot), free_program(robot))


class FreePathSolver:
    """Programs of one capture.

    Attributes:
        times: s, of the programs' nodes, of the end and of the roll-out; nodes, end, dense: their indices.
    """

    def __init__(self, robot: FloatingRobot, capture: Capture, limits: Limits) -> None:
        self._robot, self._capture, self._limits = robot, capture, limits
        self._rollout = _rollout(robot)
        duration = capture.duration
        goals = EndGoals.of(robot, HeldAttitude.of(robot), capture)
        self._parameters = np.concatenate(
            [capture.start, goals.position, duration * goals.velocity, goals.across.T.ravel()]
        )
        self.times = np.concatenate([MESH.nodes, [1.0], self._rollout.s]) * duration
        count = len(MESH.nodes)
        self.nodes, self.end = np.arange(count), count
        self.dense = np.arange(count + 1, len(self.times))

    def straight(self, end: Array) -> Array:
        """Coefficients (size, n) of the straight path to a final configuration (n,)."""
        phase = MESH.greville[:, None]
        phase[:FIXED] = 0.0
        return self._capture.start + phase * (end - self._capture.start)

    def fitted(self, path: JointPath) -> Array:
        """Coefficients (size, n) of the splines from rest that are nearest to a joint motion."""
        start, value = self._capture.start, MESH.basis(MESH.nodes)
        angles, _, _ = path.sample(MESH.nodes * self._capture.duration)
        free = np.linalg.lstsq(value[:, FIXED:], angles - value[:, :FIXED].sum(axis=1)[:, None] * start)[0]
        return np.concatenate([np.tile(start, (FIXED, 1)), free])

    def solve(
        self,
        guess: Array,
        rate: Array | float | None,
        acceleration: Array | float | None,
        nearness: Array | None = None,
    ) -> Solution | Failure:
        """Solve from coefficients (size, n) of the splines, which are the variables of the solution too.

        Args:
            rate, acceleration: limits, rad/s and rad/s^2, () or (n,); None for none.
            nearness: (K, 28) parameters of nearness at the nodes; None for the program without.
        """
        program = free_program(self._robot) if nearness is None else clear_program(self._robot)
        high = self._constraint_bounds(program, rate, acceleration)
        angles = self._limits.angles(program.joints) + ANGLE_MARGIN * np.array([1.0, -1.0])
        low_angle, high_angle = (np.tile(side, MESH.size - FIXED) for side in angles.T)
        extra = np.zeros(0) if nearness is None else nearness.ravel()
        found = solved(
            METHOD,
            program.solver,
            (-high, high),
            TOLERANCE,
            x0=guess[FIXED:].ravel(),
            p=np.concatenate([self._parameters, extra]),
            lbx=low_angle,
            ubx=high_angle,
        )
        if isinstance(found, Failure):
            return found
        free = found.variables.reshape(-1, program.joints)
        coefficients = np.concatenate([np.tile(self._capture.start, (FIXED, 1)), free])
        return Solution(found.cost / self._capture.duration, coefficients)

    def motion(self, solution: Solution) -> CapturePlan:
        """The exact motion with its energy and violations as measured independently."""
        motion, t = self._rollout.closed(solution.variables, self._parameters), self._capture.duration
        path = motion.s * t, motion.position, motion.rate / t, motion.acceleration / t**2
        unchecked = CapturePlan(METHOD, *path, solution.cost)
        checked = check(self._robot, self._capture, self._limits, unchecked)
        return CapturePlan(METHOD, *path, checked.energy, violation=checked.violation)

    def _constraint_bounds(
        self, program: FreePathProgram, rate: Array | float | None, acceleration: Array | float | None
    ) -> Array:
        n, duration = program.joints, self._capture.duration
        fastest = np.inf if rate is None else rate * duration
        hardest = np.inf if acceleration is None else acceleration * duration**2
        return np.concatenate(
            [
                np.zeros(program.collocated + program.ending),
                np.broadcast_to(fastest, (MESH.size - FIXED, n)).ravel(),
                np.broadcast_to(hardest, (len(MESH.breaks) - 1, n)).ravel(),
            ]
        )
