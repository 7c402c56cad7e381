"""Optimal control along prescribed end-effector paths: eq. 15 and 16 of shah2013 by Gauss collocation.

zeta has the least integral of thetadot' I_m thetadot over the motion; `collocation.program` describes it.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.goals import end_configurations, spread
from agents.planners.dual_arm.held_attitude import HeldAttitude
from agents.planners.dual_arm.prescribed_paths.check import has_single_zeta
from agents.planners.dual_arm.prescribed_paths.collocation.grid import CollocatedMotion
from agents.planners.dual_arm.prescribed_paths.collocation.program import (
    BOUNDED_NODES,
    METHOD,
    NODES,
    PrescribedPathProgram,
)
from agents.planners.dual_arm.prescribed_paths.guesses import Motion, initial_guesses, interpolated
from agents.planners.dual_arm.prescribed_paths.instantaneous import capture_path, plan_local, plan_zeta_zero
from agents.planners.dual_arm.prescribed_paths.integration import integrate
from agents.planners.dual_arm.prescribed_paths.model import Matrices, PathModel
from agents.planners.dual_arm.prescribed_paths.null_space import solutions
from agents.planners.dual_arm.prescribed_paths.passages import passages
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.checks import flag
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError

LIMIT_CAUSES = (Cause.INFEASIBLE, Cause.JOINT_LIMIT)  # of failures that tighter bounds may avoid
FRACTIONS = (0.999, 0.98, 0.95, 0.9)  # of the bounds, in turn: they are not imposed between the points
SPATIAL_NODES = 16  # in space, of solutions that are refined or led into bounds afterwards
SEARCHES, ENDS = 48, 3  # for final configurations with aligned axes, and starts that are drawn to them
PASSAGES = 3  # starts that lead past singularities
SAME = 1e-6  # relative difference of energies of solutions that count as one
FEEDBACK = 0.5  # 1/s, of the accurate motion to the collocated one


def plan_ocp(
    robot: FloatingRobot, capture: Capture, limits: Limits = Limits(), *, from_rest: bool = False
) -> CapturePlan | Failure:
    """Plan by method (c): polynomial paths, zeta for the least energy over the motion.

    Several initial guesses are used, the motions of (a) and (b) among them, and the best solution is returned
    after an accurate integration, so that the plan is never worse than either. Where all fail, the search of
    `passages` finds motions past singularities and within the joint limits to start from, if any axis is
    allowed. Approach axes of the capture are aligned at the end, which (a) and (b) do not do.

    Args:
        limits: joint angles, rates and accelerations are respected, at the Gauss points and between them;
            `control` bounds |zeta|. Torque limits are not: the path leaves too little freedom.
        from_rest: whether the motion starts from rest; as in the paper it may otherwise start with a jump of
            the rates. Without an acceleration limit the least energy is the same, and is not attained.

    Raises:
        ConfigurationError: for a malformed capture, limits of another robot, or a limit of control for a
            robot with other than two planar arms of three joints.
    """
    capture, limits, model = capture.checked(robot), limits.checked(robot), PathModel.of(robot)
    flag("from_rest", from_rest)
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
    reasons: list[str] = field(default_factory=list)  # of failures, extended

    def plan(self) -> CapturePlan | Failure:
        first = [plan(self.robot, self.capture, self.limits) for plan in (plan_zeta_zero, plan_local)]
        known = [plan for plan in first if isinstance(plan, CapturePlan)]
        guesses = initial_guesses(self.model, self.path, self.capture, known, self._ends())
        solutions = self._solutions(guesses)
        best = self._best(solutions)
        if self.capture.aligned:  # motions without regard to it are no use
            known = []
        elif best is None and not any(self._passable(each) for _, each in solutions):
            best = self._passed()
        for plan in known:
            if best is None or plan.energy < best.energy:
                note = f"collocation found nothing better than {plan.method}"
                best = replace(plan, method=METHOD, notes=note)
        return best if best is not None else _failure(first, self.reasons)

    def _ends(self) -> Array:
        """Final configurations (E, n) with aligned approach axes; none where any axis will do."""
        model = HeldAttitude.of(self.robot)
        if not self.capture.aligned:
            return np.zeros((0, self.robot.n_joints))
        found = end_configurations(self.robot, model, self.capture, self.limits, METHOD, SEARCHES)
        if isinstance(found, Failure):
            self.reasons.append(found.reason)
            return np.zeros((0, self.robot.n_joints))
        return spread(found, ENDS)

    def _solutions(self, guesses: Iterable[tuple[str, Motion]]) -> list[tuple[str, CollocatedMotion]]:
        """Solutions without bounds that differ, best first, with the names of their guesses."""
        program, found = self._program(self._screened), list[tuple[str, CollocatedMotion]]()
        for name, guess in guesses:
            solution = program.solve(self.path, self.capture, Limits(), guess(self._times(program)))
            if isinstance(solution, Failure):
                self.reasons.append(f"from {name}: {solution.reason}")
            else:
                found.append((name, solution))
        found.sort(key=lambda each: each[1].energy)
        before = [0.0, *(solution.energy for _, solution in found)]
        return [
            each for each, last in zip(found, before, strict=False) if each[1].energy > last * (1.0 + SAME)
        ]

    def _best(self, solutions: list[tuple[str, CollocatedMotion]]) -> CapturePlan | None:
        """The plan of the best solution without bounds that becomes one.

        Solutions without bounds take milliseconds; the best are led into the bounds afterwards, where a start
        from rest is one.
        """
        for name, solution in solutions:
            plan = self._first(name, self._attempts(solution, f"best start: {name}"))
            if plan is not None:
                return plan
        return None

    def _passed(self) -> CapturePlan | None:
        """The first plan that starts from a motion past singularities and within the joint limits."""
        motions = passages(self.robot, self.path, self.capture, self.limits, PASSAGES)
        if not motions:
            self.reasons.append("no zeta was found that leads past singularities within the joint limits")
            return None
        named = [(f"passage {k + 1}", interpolated(motion, self.capture)) for k, motion in enumerate(motions)]
        if (plan := self._best(self._solutions(named))) is not None:
            return plan
        attempts = ((name, self._within(motion, f"start: {name}")) for name, motion in named)
        return next((plan for each in attempts if (plan := self._first(*each)) is not None), None)

    def _passable(self, solution: CollocatedMotion) -> bool:
        """Whether a solution is a regular motion within the joint limits, whatever else it exceeds."""
        alone = replace(self, limits=Limits(position=self.limits.position))
        return isinstance(alone._followed(solution, ""), CapturePlan)

    def _first(self, name: str, attempts: Iterator[CapturePlan | Failure]) -> CapturePlan | None:
        """The first of some attempts that is a plan."""
        for plan in attempts:
            if isinstance(plan, CapturePlan):
                return plan
            self.reasons.append(f"from {name}: {plan.reason}")
        return None

    @property
    def _screened(self) -> int:
        """Number of nodes of solutions without bounds."""
        if self.model.dimensions == 3:
            return SPATIAL_NODES
        return BOUNDED_NODES if self.from_rest else NODES

    def _program(self, nodes: int, *bounds: bool) -> PrescribedPathProgram:
        return PrescribedPathProgram.of(self.robot, nodes, *bounds, aligned=self.capture.aligned)

    def _times(self, program: PrescribedPathProgram) -> Array:
        return program.times(self.capture.duration)

    def _attempts(self, solution: CollocatedMotion, note: str) -> Iterator[CapturePlan | Failure]:
        """Plans of a solution without bounds: as it is, then led into bounds that are tightened step by step.

        After a failure for another cause than the bounds there are no more.
        """
        if not self.from_rest:
            plan = self._refined(solution, note)
            yield plan
            if isinstance(plan, Failure) and plan.cause not in LIMIT_CAUSES:
                return
            if all(bound is None for bound in vars(self.limits).values()):
                return
        yield from self._within(solution.at, note)

    def _refined(self, solution: CollocatedMotion, note: str) -> CapturePlan | Failure:
        """The plan of a solution without bounds, on more nodes where it has few."""
        if self._screened == SPATIAL_NODES:
            program = self._program(BOUNDED_NODES)
            finer = program.solve(self.path, self.capture, Limits(), solution.at(self._times(program)))
            return finer if isinstance(finer, Failure) else self._followed(finer, note)
        return self._followed(solution, note)

    def _within(self, guess: Motion, note: str) -> Iterator[CapturePlan | Failure]:
        """Plans within bounds that are tightened step by step."""
        constraints = self.limits.acceleration is not None, self.limits.control is not None
        program = self._program(BOUNDED_NODES, self.from_rest, *constraints)
        start = guess(self._times(program))
        for fraction in FRACTIONS:
            bounded = program.solve(self.path, self.capture, self.limits, start, fraction)
            plan = bounded if isinstance(bounded, Failure) else self._followed(bounded, note)
            yield plan
            if isinstance(plan, Failure) and plan.cause not in LIMIT_CAUSES:
                return

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


def _failure(first: list[CapturePlan | Failure], reasons: list[str]) -> Failure:
    failures = [plan for plan in first if isinstance(plan, Failure)]
    singular = bool(failures) and all(failure.cause is Cause.SINGULAR for failure in failures)
    messages = [f"{failure.method}: {failure.reason}" for failure in failures]
    cause = Cause.SINGULAR if singular else Cause.INFEASIBLE
    return Failure(METHOD, cause, "; ".join(dict.fromkeys([*messages, *reasons])))
