"""Policies that plan in the weights of a ProMP, from stored optimal motions."""

from dataclasses import replace
from typing import ClassVar

from agents.planners.single_arm.library import find_library, library_command, library_of
from agents.planners.single_arm.promp.avoiding import AvoidingPlanner
from agents.planners.single_arm.promp.demonstrated import DemonstratedPlanner
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.policies.needs import POSE
from agents.policies.single_arm.optimal import OptimalPolicy, further_rows
from space_envs.policy import PolicyContext


def missing_library(context: PolicyContext) -> str | None:
    """Reason why a policy without a library of its robot cannot plan; None where there is one."""
    if find_library(context.robot, keep_attitude=False) is not None:
        return None
    command = library_command(context.robot, keep_attitude=False)
    return f"it needs a library of optimal motions of the robot {context.robot.name!r}: `{command}` makes it"


class PrompOptimal(OptimalPolicy):
    """Minimum base disturbance (eq. 20) in the weights of a ProMP; the final attitude is unconstrained.

    Starts from the robot's library of optimal motions, or from rest where none was made. Moving grapples are
    met at their own velocity, at the time of least cost.
    """

    needs = replace(POSE, goals=None)

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        library = find_library(context.robot, self.keep_attitude)
        reserve = find_library(context.robot, self.keep_attitude, limited=False)
        further = further_rows(context)
        self.planner = OptimalPlanner(context.arm, self.limits, library, further=further, reserve=reserve)


class PrompOptimalKept(PrompOptimal):
    """The same with the final attitude constrained to the initial one."""

    keep_attitude = True


class PrompDemonstrated(OptimalPolicy):
    """Best of the samples of ProMPs fitted to optimal motions, conditioned on the goal in task space.

    All episodes share the samples' draws, which the seed fixes. The final attitude is unconstrained.
    """

    needs = replace(POSE, obstacles=False, other=missing_library)
    planner_type: ClassVar[type[DemonstratedPlanner | AvoidingPlanner]] = DemonstratedPlanner

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        library = library_of(context.robot, self.keep_attitude)
        self.planner = self.planner_type(context.arm, self.limits, library, seed=seed)


class PrompAvoiding(PrompDemonstrated):
    """Samples of ProMPs with a larger variance, refined where they come least near to keep-out spheres."""

    needs = replace(POSE, obstacles=True, other=missing_library)
    planner_type = AvoidingPlanner
