"""Goals to plan for: those of the test split, and one of the validation split in place of the paper's.

The paper's own goal pose stands in a picture only. Nothing of this project was tuned on the test split.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np

from agents.planners.common.plans import Limits
from agents.planners.single_arm.problem import Reach
from agents.policies.clearance import link_radii
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.policy import PolicyContext
from space_envs.tasks.single_arm import SPLIT_SIZE, SingleArmTask

ENV_ID = "SpaceCapture/SingleArm-v0"
DIFFICULTY = "medium"
MOST = SPLIT_SIZE["test"]
OWN_GOAL = 0  # of the validation split


@dataclass(frozen=True, eq=False)
class GoalCase:
    """The robot at rest at home, and where its end-effector should rest after 10 s.

    Attributes:
        index: of the goal in the test split; -1 for the page's own one, of the validation split.
        start: (7,) rad. position: (3,) m and quaternion: (4,), the goal pose in the inertial frame, which is
            the base frame at the start.
    """

    index: int
    start: Array
    position: Array
    quaternion: Array

    def reach(self, keep_attitude: bool = False, spheres: Array | None = None) -> Reach:
        """Planning problem for the optimal planners."""
        return Reach(
            self.start,
            Grapple.at_rest(self.position, self.quaternion),
            keep_attitude=keep_attitude,
            spheres=spheres,
            link_radius=link_radii(context().robot),
            c=C,
        )

    @property
    def observation(self) -> Array:
        """Observation (1, size) at the start, with the fields that planners read."""
        layout = context().layout
        observation = np.zeros((1, layout.size))
        for name, value in (
            ("joint_position", self.start),
            ("base_quaternion", [1.0, 0.0, 0.0, 0.0]),
            ("goal_position", self.position),
            ("goal_quaternion", self.quaternion),
        ):
            observation[0, layout.slices[name]] = value
        return observation


C = 1.0  # m/rad, of eq. 20


def goal(index: int) -> GoalCase:
    """Case of goal `index` of the test split; -1 is the page's own, of the validation split."""
    split, number = ("validation", OWN_GOAL) if index == -1 else ("test", index)
    goals = SingleArmTask(difficulty=DIFFICULTY).goals(split, np.array([number]))
    return GoalCase(index, context().arm.home, goals.position[0], goals.quaternion[0])


def check_count(count: int) -> None:
    """Refuse more cases than there are.

    Raises:
        ConfigurationError: naming both.
    """
    if count > MOST:
        raise ConfigurationError(f"cases must be at most {MOST}, the goals of the test split, got {count}")


@cache
def context() -> PolicyContext:
    """The context that planners are built with."""
    return PolicyContext.from_env(CaptureVectorEnv(ENV_ID, difficulty=DIFFICULTY))


@cache
def limits() -> Limits:
    """Limits of the model: joint range, rates, accelerations and torques."""
    at = context()
    return Limits(
        position=at.joint_limits,
        rate=at.rate_limit,
        acceleration=at.acceleration_limit,
        torque=at.model.actuator_forcerange[:, 1],
    )
