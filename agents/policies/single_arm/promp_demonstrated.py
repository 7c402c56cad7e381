"""The paper's ProMP with optimal demonstrations, conditioned on the goal in task space, as policies."""

from dataclasses import replace

from agents.planners.common.plans import Failure
from agents.planners.single_arm.library import shipped_library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.weights.demonstrated import DemonstratedPlanner
from agents.policies.needs import POSE
from agents.policies.single_arm.optimal import OptimalPolicy
from space_envs.policy import PolicyContext


class PrompDemonstrated(OptimalPolicy):
    """Best of the samples of ProMPs fitted to optimal motions by eq. 20; the attitude is free.

    Args:
        context, seed: as of every policy. All episodes share the samples' draws, which the seed fixes.
    """

    needs = replace(POSE, joints=7, obstacles=False)

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        library = shipped_library(self.keep_attitude)
        self._planner = DemonstratedPlanner(context.arm, self.limits, library, seed=seed)

    def plan(self, asked: list[Reach]) -> list[ReachPlan | Failure]:
        """Plans of all rows."""
        return [self._planner.plan(reach) for reach in asked]
