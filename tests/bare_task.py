"""A task that no table of the project knows, with the least that a task can have."""

from dataclasses import dataclass
from functools import lru_cache

import mujoco

from space_envs import register
from space_envs.robots.models import SceneOptions, robot_spec
from space_envs.robots.robot import Robot
from space_envs.tasks.goals.poses import PoseGoals
from space_envs.tasks.single_arm import SingleArmTask


@dataclass(frozen=True)
class BareTask(SingleArmTask):
    """Goals of one size and two splits, and a drawn model without cameras."""

    difficulty: str = "near"
    horizon: int = 8

    version = 1
    difficulties = ("near",)
    split_sizes = {"train": 64, "test": 64}

    @property
    def render_model(self) -> mujoco.MjModel:
        """The usual one without its cameras."""
        return _without_cameras(self.robot, self.step_size)

    def goal_block(self, split: str, block: int) -> PoseGoals:
        """The easiest of the single arm."""
        return SingleArmTask(difficulty="easy").goal_block(split, block)


@lru_cache(maxsize=1)
def _without_cameras(robot: Robot, timestep: float) -> mujoco.MjModel:
    spec = robot_spec(robot, SceneOptions(timestep=timestep, visual=True))
    for camera in tuple(spec.cameras):
        spec.delete(camera)
    return spec.compile()


register("Tests/Bare-v0", BareTask)
