"""Reactionless motion with free paths (method d): only the ends are given, and the energy is minimised.

Beyond shah2013, whose end-effector paths are prescribed polynomials. Splines of the joint angles are
collocated for the reactionless constraint of eq. 4 and the least integral of eq. 15, from several initial
guesses, the motions of methods (a) to (c) among them, first without obstacles; where the best motion
collides, it is solved again with a cost on nearness. A roll-out then makes the motion exact. Where one of (a)
to (c) satisfies all requirements with less energy still, it is the plan.
"""

from agents.planners.common.plans import Failure, Limits
from agents.planners.dual_arm.free_paths.search import MORE_ENDS, FreePathSearch
from agents.planners.dual_arm.problem import Capture, CapturePlan
from agents.planners.dual_arm.surroundings import Surroundings
from space_envs.dynamics import FloatingRobot
from space_envs.errors import positive_integer

STARTS = 4


def plan_free(
    robot: FloatingRobot,
    capture: Capture,
    limits: Limits = Limits(),
    around: Surroundings | None = None,
    starts: int = STARTS,
) -> CapturePlan | Failure:
    """Plan the motion of least energy from rest to a capture, reactionless, within limits and clear.

    Args:
        limits: `control` does not apply. Torque limits are satisfied by lower accelerations where necessary.
        around: obstacles; None for none.
        starts: number of final configurations that are started from, besides the motions of methods (a) to
            (c).

    Raises:
        ConfigurationError: for a malformed capture, limits of another robot or an invalid number of starts.
    """
    positive_integer("starts", starts, MORE_ENDS)
    return FreePathSearch(robot, capture.checked(robot), limits.checked(robot), around, starts).plan()
