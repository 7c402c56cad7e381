"""The methods that are compared: the paper's three, and the one with free paths."""

from collections.abc import Callable
from dataclasses import dataclass

from agents.planners.common.plans import Failure, Limits
from agents.planners.dual_arm.free_paths.planner import plan_free
from agents.planners.dual_arm.prescribed_paths.instantaneous import plan_local, plan_zeta_zero
from agents.planners.dual_arm.prescribed_paths.ocp import plan_ocp
from agents.planners.dual_arm.problem import CapturePlan
from reproduce.shah2013.cases import ROBOT, CaptureCase, planar_robot
from space_envs.evaluation.report.drawing.look import BLUE, GREEN, ORANGE, PURPLE, VERMILION

ACCELERATION = 0.1  # rad/s^2, of the methods that start from rest by an optimisation


@dataclass(frozen=True)
class DualArmMethod:
    """A method: `letter` and `name` on the page, and how it plans.

    `within` names a method that may do all that this one may: where that finds no plan, this is not tried.
    """

    key: str
    letter: str
    name: str
    color: str
    plan: Callable[[CaptureCase], CapturePlan | Failure]
    within: str | None = None

    @property
    def title(self) -> str:
        """Letter and name."""
        return f"({self.letter}) {self.name}"


# The paper bounds joint angles and controls and names no figures; these are the joints' own limits.
_PATHS = Limits(position=ROBOT.joint_range)
_REST = Limits(position=ROBOT.joint_range, acceleration=ACCELERATION)
_DRIVES = Limits(
    position=ROBOT.joint_range,
    rate=ROBOT.rate_limit,
    acceleration=ACCELERATION,
    torque=ROBOT.torque_limit,
)


METHODS = {
    method.key: method
    for method in (
        DualArmMethod(
            "zeta_zero",
            "a",
            "ζ = 0",
            BLUE,
            lambda case: plan_zeta_zero(planar_robot(), case.capture, _PATHS),
        ),
        DualArmMethod(
            "local",
            "b",
            "local optimisation",
            VERMILION,
            lambda case: plan_local(planar_robot(), case.capture, _PATHS),
        ),
        DualArmMethod(
            "ocp",
            "c",
            "optimal control",
            GREEN,
            lambda case: plan_ocp(planar_robot(), case.capture, _PATHS),
        ),
        DualArmMethod(
            "ocp_rest",
            "c′",
            "optimal control from rest",
            ORANGE,
            lambda case: plan_ocp(planar_robot(), case.capture, _REST, from_rest=True),
            within="ocp",
        ),
        DualArmMethod(
            "free",
            "d",
            "free paths",
            PURPLE,
            lambda case: plan_free(planar_robot(), case.capture, _DRIVES),
        ),
    )
}
