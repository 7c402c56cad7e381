"""The planners that are compared: the paper's, those it is measured against, and extensions of it."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

from agents.planners.common.inverse_kinematics import JointMotion
from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.collocation.ocp import STARTS, plan_ocp
from agents.planners.single_arm.library import find_reactionless_library, library_of
from agents.planners.single_arm.problem import ReachPlan
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.planners.single_arm.reactionless.planner import ReactionlessPlanner
from agents.policies.single_arm.joint_goals import JointGoalPolicy
from agents.policies.single_arm.minimum_jerk import MinimumJerk
from agents.policies.single_arm.mpc import ModelPredictive
from agents.policies.single_arm.promp import ConditionalMean, ProMPPolicy
from agents.policies.single_arm.reactionless.problem import latest_arrival, path_limits
from reproduce.shyam2020.cases import GoalCase, context, limits
from space_envs.evaluation.report.drawing.look import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION

OLIVE, PLUM, BROWN = "#7f8f1f", "#7a5ea8", "#8a5a2b"

Found = JointMotion | ReachPlan | Failure


@dataclass(frozen=True)
class SingleArmMethod:
    """A planner: its name on the page, and how it plans with a seed for its draws."""

    key: str
    name: str
    color: str
    plan: Callable[[GoalCase, int], Found]


@cache
def _policy(kind: type[JointGoalPolicy], seed: int) -> JointGoalPolicy:
    return kind(context(), seed)


def _planned(kind: type[JointGoalPolicy]) -> Callable[[GoalCase, int], Found]:
    """Plan as the policy of the suite does."""

    def plan(case: GoalCase, seed: int) -> Found:
        motion, goals = _policy(kind, seed).plan(case.observation)
        if not goals.converged[0]:
            reason = (
                f"inverse kinematics left {1000 * goals.position_residual[0]:.2f} mm and "
                f"{goals.orientation_residual[0]:.2e} rad"
            )
            return Failure(kind.__name__, Cause.OUT_OF_REACH, reason)
        return JointMotion(motion.position[0], motion.velocity[0], motion.dt)

    return plan


@cache
def planner(keep_attitude: bool) -> OptimalPlanner:
    """Planner in the weights of a ProMP, with the shipped library of initial guesses."""
    return OptimalPlanner(context().arm, limits(), library_of(context().robot, keep_attitude))


@cache
def reactionless_planner() -> ReactionlessPlanner:
    """Planner of paths in the reaction null space, as the suite's policy has it."""
    return ReactionlessPlanner(
        context().arm, path_limits(context()), find_reactionless_library(context().robot)
    )


def optimal_control(case: GoalCase, keep_attitude: bool = False, starts: int = STARTS) -> ReachPlan | Failure:
    """Optimal control with the limits of the drives."""
    at, library = context(), library_of(context().robot, keep_attitude)
    reach = case.reach(keep_attitude)
    return plan_ocp(at.model, at.arm, reach, limits(), library=library, starts=starts)


METHODS = {
    method.key: method
    for method in (
        SingleArmMethod(
            "minimum_jerk",
            "minimum jerk",
            BLUE,
            _planned(MinimumJerk),
        ),
        SingleArmMethod(
            "mpc",
            "linear-quadratic",
            SKY,
            _planned(ModelPredictive),
        ),
        SingleArmMethod(
            "promp_mean",
            "ProMP, mean",
            ORANGE,
            _planned(ConditionalMean),
        ),
        SingleArmMethod(
            "promp",
            "ProMP, best of 100",
            VERMILION,
            _planned(ProMPPolicy),
        ),
        SingleArmMethod(
            "ocp",
            "optimal control",
            GREEN,
            lambda case, seed: optimal_control(case),
        ),
        SingleArmMethod(
            "ocp_kept",
            "optimal control, attitude constrained",
            OLIVE,
            lambda case, seed: optimal_control(case, keep_attitude=True),
        ),
        SingleArmMethod(
            "promp_optimal",
            "ProMP weights, optimal",
            PURPLE,
            lambda case, seed: planner(False).plan(case.reach()),
        ),
        SingleArmMethod(
            "promp_optimal_kept",
            "ProMP weights, attitude constrained",
            PLUM,
            lambda case, seed: planner(True).plan(case.reach(keep_attitude=True)),
        ),
        SingleArmMethod(
            "promp_reactionless",
            "reactionless path",
            BROWN,
            lambda case, seed: reactionless_planner().plan(
                replace(case.reach(keep_attitude=True), duration=latest_arrival(context()))
            ),
        ),
    )
}
