"""Ways around keep-out spheres from the variance of ProMPs, as a policy."""

from agents.optimal.avoiding import AvoidingPlanner
from agents.optimal.library import shipped_library
from agents.optimal.problem import Motion, Reach
from agents.optimal_policies import OptimalPolicy
from agents.planning import Failure
from space_envs.evaluation.policy import PolicyContext


class PrompAvoiding(OptimalPolicy):
    """Samples of widened ProMPs, refined where they come least near to spheres; the attitude is free.

    Args:
        context, seed: as of every policy. All episodes share the samples' draws, which the seed fixes.
    """

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        super().__init__(context, seed)
        self._planner = AvoidingPlanner(context.arm, self.limits, shipped_library(self.keep_attitude), seed)

    def plan(self, asked: list[Reach]) -> list[Motion | Failure]:
        """Plans of all rows."""
        return [self._planner.plan(reach) for reach in asked]
