"""Tasks of a stranger: the single arm captures a grapple on a free body, which circles or tumbles."""

from dataclasses import dataclass, fields
from functools import lru_cache
from typing import ClassVar

import numpy as np

from space_envs.dynamics.grapples import Grapple, PoseTwist
from space_envs.dynamics.rotations import rotate
from space_envs.robots.models import MovingTarget
from space_envs.tasks.goals.poses import MovingPoseGoals
from space_envs.tasks.single_arm import SingleArmTask

RATE = np.deg2rad(5.0)
RADIUS = 0.25  # m, of the grapple from the centre of mass, along its approach axis
REACHED = 10.0  # s, at which the grapple has the pose of a goal of SingleArm
INERTIA = (10.0, 16.0, 22.0)


@dataclass(frozen=True)
class CirclingTask(SingleArmTask):
    """The grapple circles about a principal axis of its body."""

    moving_target = MovingTarget(INERTIA, centre=(0.0, 0.0, RADIUS))
    axis: ClassVar[tuple[float, float, float]] = (1.0, 0.0, 0.0)  # of rotation at that time, grapple's axes

    def goal_block(self, split: str, block: int) -> MovingPoseGoals:
        """Motions whose grapple has the poses of SingleArm when it is reached."""
        return _moving(type(self), self.difficulty, split, block)


@dataclass(frozen=True)
class TumblingTask(CirclingTask):
    """The body rotates about its unstable axis, nearly."""

    axis = (-0.3, 0.9, 0.3)


@lru_cache(maxsize=8)
def _moving(task: type[CirclingTask], difficulty: str, split: str, block: int) -> MovingPoseGoals:
    pose = SingleArmTask(difficulty=difficulty).goal_block(split, block)
    turn = pose.quaternion
    spin = rotate(turn, RATE * np.array(task.axis) / np.linalg.norm(task.axis))
    centre = pose.position + rotate(turn, np.array([0.0, 0.0, RADIUS]))
    body = PoseTwist(centre, turn, np.zeros_like(centre), spin)
    start = Grapple.on_body(body, np.array(INERTIA), pose.position, turn).at(-REACHED)
    common = {field.name: getattr(pose, field.name) for field in fields(pose)}
    return MovingPoseGoals(**{**common, **start._asdict()})
