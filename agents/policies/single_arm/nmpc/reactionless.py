"""Nonlinear model predictive control that hardly rotates the satellite at any time, as a policy."""

from dataclasses import replace

from agents.planners.common.plans import Failure
from agents.planners.single_arm.library import find_reactionless_library
from agents.planners.single_arm.nmpc.first import FirstPlans
from agents.planners.single_arm.nmpc.problem import Weights
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.reactionless.planner import ReactionlessPlanner
from agents.planners.single_arm.weights.legendre import LegendreBasis
from agents.policies.single_arm.nmpc.policy import NMPC
from agents.policies.single_arm.reactionless.policy import PrompReactionless
from agents.policies.single_arm.reactionless.problem import latest_arrival, path_limits
from space_envs.policy import PolicyContext

SLOWER = 1.1  # times as much time for a path, which is then traversed faster and improved within the limits
ATTITUDE = 1e3  # 1/(rad^2 s), on the squared attitude error at all times


class NMPCReactionless(NMPC):
    """The same, with the attitude weighted at all times, from a path in the reaction null space.

    Such a path takes nearly the whole episode.
    """

    needs = replace(PrompReactionless.needs, goals="static", obstacles=False)
    basis = LegendreBasis(12)

    def __init__(self, context: PolicyContext, seed: int = 0) -> None:
        arrival = latest_arrival(context)
        self.weights = replace(Weights(), duration=arrival, latest=arrival, attitude=ATTITUDE)
        super().__init__(context, seed)

    def first_plans(self, guarded: bool) -> FirstPlans:
        """First motions of the controller, by `promp_reactionless`'s planner."""
        context = self.context
        library = find_reactionless_library(context.robot)
        planner = ReactionlessPlanner(context.arm, path_limits(context), library)

        def plan(reach: Reach) -> ReachPlan | Failure:
            found = planner.plan(reach)
            if not isinstance(found, Failure):
                return found
            slower = planner.plan(replace(reach, duration=SLOWER * reach.duration))
            return found if isinstance(slower, Failure) else slower

        return FirstPlans(self.controller, plan, guarded=guarded)
