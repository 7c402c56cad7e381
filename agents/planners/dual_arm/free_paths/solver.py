"""Solutions of the free-path programs of one robot, and the exact motions that they become."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from agents.planners.common.plans import JointPath, Limits
from agents.planners.common.smooth import Smooth
from agents.planners.common.splines import Mesh
from agents.planners.dual_arm.free_paths.check import check
from agents.planners.dual_arm.free_paths.goals import EndGoals
from agents.planners.dual_arm.free_paths.model import HeldAttitude
from agents.planners.dual_arm.free_paths.nearness import EACH, Nearness
from agents.planners.dual_arm.free_paths.program import FIXED, FreePathProgram, build
from agents.planners.dual_arm.free_paths.rollout import ReactionlessRollout
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.codegen.once import built_once
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array

METHOD = "reactionless_free"
INTERVALS, GROWTH, STEPS = 24, 1.6, 4  # of the splines: of 20 s, 0.17 s at the ends and 1.1 s in the middle
ANGLE_ROOM = 1e-3  # rad, that the splines keep from the joint limits
LEFT = 0.05  # largest violation of a program's constraint, in its units, that the roll-out can put right

_IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-5, "max_iter": 100}
# Nearness has kinks where the nearest points jump: iterations end when the objective has come to rest.
_IPOPT_CLEAR = _IPOPT | {
    "max_iter": 60,
    "acceptable_iter": 4,
    "acceptable_tol": 1e6,
    "acceptable_dual_inf_tol": 1e6,
    "acceptable_constr_viol_tol": 1e-4,
    "acceptable_obj_change_tol": 1e-3,
}


class FreePathPrograms:
    """Programs and roll-outs of one robot, made at first use and kept."""

    def __init__(self, robot: FloatingRobot) -> None:
        self.robot, self.model = robot, HeldAttitude.of(robot)
        self.mesh = Mesh.graded(INTERVALS, GROWTH, STEPS)
        self.free = self._build(self.model.energy, _IPOPT, 0)
        self.rollout = ReactionlessRollout(self.model, self.free)

    @classmethod
    def of(cls, robot: FloatingRobot) -> "FreePathPrograms":
        """Those of a robot.

        Warns:
            NoCompiledCodeWarning: if they have to run in CasADi's virtual machine, twenty times slower.
        """
        return _programs(robot)

    def _build(self, cost: Smooth, ipopt: dict[str, Any], each: int) -> FreePathProgram:
        options = {"print_time": False, "ipopt": ipopt}
        return build(self.model, cost, self.robot.n_joints, self.mesh, options, each)

    @cached_property
    def nearness(self) -> Nearness:
        """What is missing to wanted distances."""
        return Nearness.of(self.robot, self.model.dimensions == 2)

    @cached_property
    def clear(self) -> FreePathProgram:
        """The program with a cost on nearness."""
        return self._build(self.nearness.added_to(self.model.energy, self.robot.n_joints), _IPOPT_CLEAR, EACH)


@built_once
def _programs(robot: FloatingRobot) -> FreePathPrograms:
    return FreePathPrograms(robot)


@dataclass(frozen=True, eq=False)
class SplineSolution:
    """Splines that fulfil a program: C in J s, with the cost of nearness if there is one; coefficients
    (size, n)."""

    cost: float
    coefficients: Array


@dataclass(frozen=True)
class FreePathUnsolved:
    """Ipopt's status, and the largest violation of a constraint that it left."""

    status: str
    left: float


class FreePathSolver:
    """The programs of one capture.

    Attributes:
        times: s, of the programs' nodes, of the end and of the roll-out; nodes, end, dense: their places.
    """

    def __init__(self, robot: FloatingRobot, capture: Capture, limits: Limits) -> None:
        self.programs = FreePathPrograms.of(robot)
        self._robot, self._capture, self._limits = robot, capture, limits
        mesh, duration = self.programs.mesh, capture.duration
        goals = EndGoals.of(robot, self.programs.model, capture)
        self._parameters = np.concatenate(
            [capture.start, goals.place, duration * goals.velocity, goals.across.T.ravel()]
        )
        self.times = np.concatenate([mesh.nodes, [1.0], self.programs.rollout.s]) * duration
        count = len(mesh.nodes)
        self.nodes, self.end = np.arange(count), count
        self.dense = np.arange(count + 1, len(self.times))

    def straight(self, end: Array) -> Array:
        """Coefficients (size, n) of the straight way to an end configuration (n,)."""
        share = self.programs.mesh.greville[:, None]
        share[:FIXED] = 0.0
        return self._capture.start + share * (end - self._capture.start)

    def fitted(self, path: JointPath) -> Array:
        """Coefficients (size, n) of the splines from rest that come nearest to a joint motion."""
        mesh, start = self.programs.mesh, self._capture.start
        value = mesh.basis(mesh.nodes)
        angles, _, _ = path.sample(mesh.nodes * self._capture.duration)
        free = np.linalg.lstsq(value[:, FIXED:], angles - value[:, :FIXED].sum(axis=1)[:, None] * start)[0]
        return np.concatenate([np.tile(start, (FIXED, 1)), free])

    def solve(
        self,
        begin: Array,
        rate: float | None,
        acceleration: float | None,
        nearness: Array | None = None,
    ) -> SplineSolution | FreePathUnsolved:
        """Solve from coefficients (size, n), within limits that are None where there are none.

        Args:
            nearness: (K, 24) parameters of nearness at the nodes; None for the program without.
        """
        program = self.programs.free if nearness is None else self.programs.clear
        mesh, n, duration = program.mesh, program.joints, self._capture.duration
        equal = np.zeros(program.collocated + program.ending)
        fastest = np.inf if rate is None else rate * duration
        hardest = np.inf if acceleration is None else acceleration * duration**2
        high = np.concatenate(
            [
                equal,
                np.full((mesh.size - FIXED) * n, fastest),
                np.full((len(mesh.breaks) - 1) * n, hardest),
            ]
        )
        low_angle, high_angle = -np.inf, np.inf
        if self._limits.position is not None:
            room = self._limits.position + ANGLE_ROOM * np.array([1.0, -1.0])
            low_angle, high_angle = (np.tile(side, mesh.size - FIXED) for side in room.T)
        extra = np.zeros(0) if nearness is None else nearness.ravel()
        result = program.solver(
            x0=begin[FIXED:].ravel(),
            p=np.concatenate([self._parameters, extra]),
            lbg=-high,
            ubg=high,
            lbx=low_angle,
            ubx=high_angle,
        )
        g = result["g"].full()[:, 0]
        left = float(np.maximum(np.abs(g) - high, 0.0).max())
        status = program.solver.stats()["return_status"]
        # A motion that fulfils the constraints is one, even if Ipopt would go on to improve it.
        if not left < LEFT or status == "Infeasible_Problem_Detected":
            return FreePathUnsolved(status, left)
        free = result["x"].full().reshape(-1, n)
        coefficients = np.concatenate([np.tile(self._capture.start, (FIXED, 1)), free])
        return SplineSolution(float(result["f"]) / duration, coefficients)

    def motion(self, solution: SplineSolution) -> CapturePlan:
        """The exact motion, with what an independent check measured."""
        motion = self.programs.rollout.closed(solution.coefficients, self._parameters)
        t = self._capture.duration
        bare = CapturePlan(
            METHOD, motion.s * t, motion.position, motion.rate / t, motion.acceleration / t**2, solution.cost
        )
        checked = check(self._robot, self._capture, self._limits, bare)
        return CapturePlan(
            METHOD,
            bare.time,
            bare.position,
            bare.rate,
            bare.acceleration,
            checked.energy,
            violation=checked.violation,
        )
