"""Ways around keep-out spheres from the variance of ProMPs, as a policy."""

from dataclasses import replace

from agents.planners.common.plans import Failure
from agents.planners.single_arm.library import shipped_library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.weights.avoiding import AvoidingPlanner
from agents.policies.needs import POSE
from agents.policies.single_arm.optimal import OptimalPolicy
from space_envs.policy import PolicyContext


class PrompAvoiding(OptimalPolicy):
    """Samples of widened ProMPs, refined where they come least near to spheres; the attitude is free.

    Args:
        context, seed: as of every policy. All episodes share the samples' draws, which the seed fixes.
    """

    needs = replace(POSE, joints=7, obstacles=True)

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        self._planner = AvoidingPlanner(context.arm, self.limits, shipped_library(self.keep_attitude), seed)

    def plan(self, asked: list[Reach]) -> list[ReachPlan | Failure]:
        """Plans of all rows."""
        return [self._planner.plan(reach) for reach in asked]
