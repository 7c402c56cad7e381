"""Policies that plan in the weights of a ProMP, from stored optimal motions."""

from dataclasses import replace
from typing import ClassVar

from agents.planners.single_arm.library import shipped_library
from agents.planners.single_arm.promp.avoiding import AvoidingPlanner
from agents.planners.single_arm.promp.demonstrated import DemonstratedPlanner
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.policies.needs import POSE
from agents.policies.single_arm.optimal import OptimalPolicy
from space_envs.policy import PolicyContext


class PrompOptimal(OptimalPolicy):
    """Minimum base disturbance (eq. 20) in the weights of a ProMP; the final attitude is unconstrained."""

    needs = replace(POSE, joints=7)

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        self.planner = OptimalPlanner(context.arm, self.limits, shipped_library(self.keep_attitude))


class PrompOptimalKept(PrompOptimal):
    """The same with the final attitude constrained to the initial one."""

    keep_attitude = True


class PrompDemonstrated(OptimalPolicy):
    """Best of the samples of ProMPs fitted to optimal motions, conditioned on the goal in task space.

    All episodes share the samples' draws, which the seed fixes. The final attitude is unconstrained.
    """

    needs = replace(POSE, joints=7, obstacles=False)
    planner_type: ClassVar[type[DemonstratedPlanner | AvoidingPlanner]] = DemonstratedPlanner

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        library = shipped_library(self.keep_attitude)
        self.planner = self.planner_type(context.arm, self.limits, library, seed=seed)


class PrompAvoiding(PrompDemonstrated):
    """Samples of ProMPs with a larger variance, refined where they come least near to keep-out spheres."""

    needs = replace(POSE, joints=7, obstacles=True)
    planner_type = AvoidingPlanner
