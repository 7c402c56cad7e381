"""Optimal control along prescribed end-effector paths: eq. 15 and 16 of shah2013 by Gauss collocation.

zeta has the least integral of thetadot' I_m thetadot over the motion; `program.py` describes the collocation.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.prescribed_paths.check import has_single_zeta
from agents.planners.dual_arm.prescribed_paths.grid import CollocatedMotion
from agents.planners.dual_arm.prescribed_paths.guesses import initial_guesses
from agents.planners.dual_arm.prescribed_paths.instantaneous import capture_path, plan_local, plan_zeta_zero
from agents.planners.dual_arm.prescribed_paths.integration import integrate
from agents.planners.dual_arm.prescribed_paths.model import Matrices, PathModel
from agents.planners.dual_arm.prescribed_paths.null_space import solutions
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.prescribed_paths.program import (
    BOUNDED_NODES,
    METHOD,
    NODES,
    PrescribedPathProgram,
)
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.checks import flag
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError

LIMIT_CAUSES = (Cause.INFEASIBLE, Cause.JOINT_LIMIT)  # of failures that tighter bounds may avoid
FRACTIONS = (0.999, 0.98, 0.95, 0.9)  # of the bounds, in turn: they are not imposed between the points
FEEDBACK = 0.5  # 1/s, of the accurate motion to the collocated one


def plan_ocp(
    robot: FloatingRobot, capture: Capture, limits: Limits = Limits(), *, from_rest: bool = False
) -> CapturePlan | Failure:
    """Plan by method (c): polynomial paths, zeta for the least energy over the motion.

    Several initial guesses are used, the motions of (a) and (b) among them, and the best solution is returned
    after an accurate integration, so that the plan is never worse than either.

    Args:
        limits: joint angles, rates and accelerations are respected, at the Gauss points and between them;
            `control` bounds |zeta|. Torque limits are not: the path leaves too little freedom.
        from_rest: whether the motion starts from rest; as in the paper it may otherwise start with a jump of
            the rates. Without an acceleration limit the least energy is the same, and is not attained.

    Raises:
        ConfigurationError: for a malformed capture, a robot that is not planar, or a limit of control for
            one with other than three joints an arm.
    """
    capture, limits, model = capture.checked(robot), limits.checked(robot), PathModel.of(robot)
    flag("from_rest", from_rest)
    if model.dimensions != 2:
        raise ConfigurationError(
            "reactionless_ocp plans for the planar robot; use reactionless_free in space"
        )
    if limits.control is not None and not has_single_zeta(robot):
        raise ConfigurationError(
            f"a limit of control needs two planar arms of three joints, the robot has {robot.n_joints} joints"
        )
    path = capture_path(METHOD, robot, capture)
    if isinstance(path, Failure):
        return path
    return _Problem(robot, model, path, capture, limits, from_rest).plan()


@dataclass(frozen=True, eq=False)
class _Problem:
    """A checked capture along its path."""

    robot: FloatingRobot
    model: PathModel
    path: PolynomialPath
    capture: Capture
    limits: Limits
    from_rest: bool

    def plan(self) -> CapturePlan | Failure:
        first = [plan(self.robot, self.capture, self.limits) for plan in (plan_zeta_zero, plan_local)]
        found, reasons = self._unbounded(first)
        best: CapturePlan | None = None
        for name, solution in found:
            for plan in self._attempts(solution, f"best start: {name}"):
                if isinstance(plan, CapturePlan):
                    best = plan
                    break
                reasons.append(f"from {name}: {plan.reason}")
            if best is not None:
                break
        for plan in first:
            if isinstance(plan, CapturePlan) and (best is None or plan.energy < best.energy):
                note = f"collocation found nothing better than {plan.method}"
                best = replace(plan, method=METHOD, notes=note)
        return best if best is not None else _failure(first, bool(found), reasons)

    def _unbounded(
        self, first: list[CapturePlan | Failure]
    ) -> tuple[list[tuple[str, CollocatedMotion]], list[str]]:
        """Solutions without bounds from all initial guesses, best first, with names; reasons of failures.

        They take milliseconds; the best are led into the bounds afterwards, where a start from rest is one.
        """
        program = PrescribedPathProgram.of(self.robot, BOUNDED_NODES if self.from_rest else NODES)
        found: list[tuple[str, CollocatedMotion]] = []
        reasons = []
        times = program.times(self.capture.duration)
        for name, guess in initial_guesses(self.model, self.path, self.capture, first, times):
            solution = program.solve(self.path, self.capture, Limits(), guess)
            if isinstance(solution, Failure):
                reasons.append(f"from {name}: {solution.reason}")
            else:
                found.append((name, solution))
        return sorted(found, key=lambda each: each[1].energy), reasons

    def _attempts(self, solution: CollocatedMotion, note: str) -> Iterator[CapturePlan | Failure]:
        """Plans of a solution without bounds: as it is, then led into bounds that are tightened step by step.

        After a failure for another cause than the bounds there are no more.
        """
        if not self.from_rest:
            plan = self._followed(solution, note)
            yield plan
            if isinstance(plan, Failure) and plan.cause not in LIMIT_CAUSES:
                return
            if all(bound is None for bound in vars(self.limits).values()):
                return
        for fraction in FRACTIONS:
            bounded = self._bounded(solution, fraction)
            if isinstance(bounded, Failure):
                yield bounded
                return
            plan = self._followed(bounded, note)
            yield plan
            if isinstance(plan, Failure) and plan.cause not in LIMIT_CAUSES:
                return

    def _bounded(self, solution: CollocatedMotion, fraction: float) -> CollocatedMotion | Failure:
        """Solve within a fraction of the bounds, from a solution without bounds."""
        constraints = self.limits.acceleration is not None, self.limits.control is not None
        program = PrescribedPathProgram.of(self.robot, BOUNDED_NODES, self.from_rest, *constraints)
        curve = solution.curve()
        guess = np.array([curve(time)[0] for time in program.times(self.capture.duration)])
        return program.solve(self.path, self.capture, self.limits, guess, fraction)

    def _followed(self, solution: CollocatedMotion, note: str) -> CapturePlan | Failure:
        """Follow a collocated motion accurately: exactly on the paths, and exactly reactionless."""
        curve = solution.curve()

        def law(time: float, q: Array, at: Matrices) -> Array | Failure:
            found = solutions(at, self.path.velocity(time))
            if isinstance(found, Failure):
                return found
            particular, null = found
            position, velocity = curve(time)
            desired = velocity + FEEDBACK * (position - q)
            return particular + null @ (null.T @ (desired - particular))

        return integrate(METHOD, self.robot, self.capture, self.limits, self.path, law, note)


def _failure(first: list[CapturePlan | Failure], converged: bool, reasons: list[str]) -> Failure:
    failures = [plan for plan in first if isinstance(plan, Failure)]
    singular = all(failure.cause is Cause.SINGULAR for failure in failures)
    cause = Cause.SINGULAR if singular else Cause.INFEASIBLE if converged else Cause.SOLVER
    messages = [f"{failure.method}: {failure.reason}" for failure in failures]
    return Failure(METHOD, cause, "; ".join(dict.fromkeys([*messages, *reasons])))
