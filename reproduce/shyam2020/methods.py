"""The planners that are compared: the paper's, what it is measured against, and what goes beyond it."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache

from agents.planners.common.inverse_kinematics import JointMotion
from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.collocation.ocp import STARTS, plan_ocp
from agents.planners.single_arm.library import shipped_library
from agents.planners.single_arm.problem import ReachPlan
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.policies.single_arm.joint_goals import JointGoalPolicy
from agents.policies.single_arm.minimum_jerk import MinimumJerk
from agents.policies.single_arm.mpc import ModelPredictive
from agents.policies.single_arm.promp import ConditionalMean, ProMPPolicy
from reproduce.shyam2020.cases import Case, context, limits
from space_envs.evaluation.report.figures import BLUE, GREEN, ORANGE, PURPLE, SKY, VERMILION

OLIVE, PLUM = "#7f8f1f", "#7a5ea8"

Found = JointMotion | ReachPlan | Failure


@dataclass(frozen=True)
class Method:
    """A planner: its name and what it is on the page, and how it plans with a seed for its draws."""

    key: str
    name: str
    what: str
    colour: str
    plan: Callable[[Case, int], Found]


@cache
def _policy(kind: type[JointGoalPolicy], seed: int) -> JointGoalPolicy:
    return kind(context(), seed)


def _planned(kind: type[JointGoalPolicy]) -> Callable[[Case, int], Found]:
    """Plan as the policy of the suite does."""

    def plan(case: Case, seed: int) -> Found:
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
    """The weight-space planner with the library that is shipped."""
    return OptimalPlanner(context().arm, limits(), shipped_library(keep_attitude))


def optimal_control(case: Case, keep_attitude: bool = False, starts: int = STARTS) -> ReachPlan | Failure:
    """Optimal control with the limits of the drives."""
    return plan_ocp(context().model, context().arm, case.reach(keep_attitude), limits(), starts=starts)


METHODS = {
    method.key: method
    for method in (
        Method(
            "minimum_jerk",
            "minimum jerk",
            "quintic joint motion to the joint goal that inverse kinematics finds",
            BLUE,
            _planned(MinimumJerk),
        ),
        Method(
            "mpc",
            "linear-quadratic",
            "the paper's controller (eq. 12) that its demonstrations come from",
            SKY,
            _planned(ModelPredictive),
        ),
        Method(
            "promp_mean",
            "ProMP, mean",
            "the mean of the ProMP conditioned on start and goal (eq. 18)",
            ORANGE,
            _planned(ConditionalMean),
        ),
        Method(
            "promp",
            "ProMP, best of 100",
            "the paper's algorithm (V-D): of 100 samples of the conditioned ProMP the one of least eq. 20",
            VERMILION,
            _planned(ProMPPolicy),
        ),
        Method(
            "ocp",
            "optimal control",
            "least eq. 20 to the inertial goal pose, posture free, by collocation from several starts",
            GREEN,
            lambda case, seed: optimal_control(case),
        ),
        Method(
            "ocp_kept",
            "optimal control, attitude kept",
            "the same with the base's first attitude again at the end",
            OLIVE,
            lambda case, seed: optimal_control(case, keep_attitude=True),
        ),
        Method(
            "promp_optimal",
            "ProMP weights, optimal",
            "least eq. 20 in the weights of the same ten basis functions, from stored optimal motions",
            PURPLE,
            lambda case, seed: planner(False).plan(case.reach()),
        ),
        Method(
            "promp_optimal_kept",
            "ProMP weights, attitude kept",
            "the same with the base's first attitude again at the end",
            PLUM,
            lambda case, seed: planner(True).plan(case.reach(keep_attitude=True)),
        ),
    )
}
