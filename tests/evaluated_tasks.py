"""Tasks of an evaluation, with their robots."""

from typing import Any

from space_envs.evaluation.play.entry import EvaluatedTask
from space_envs.registration import make_task
from space_envs.robots.robot import Robot


def evaluated(
    env_id: str, difficulty: str = "medium", split: str = "test", **keywords: Any
) -> tuple[EvaluatedTask, Robot]:
    """Set of goals of an id, and the robot that is played."""
    task = make_task(env_id, {"difficulty": difficulty, "split": split, **keywords})
    return EvaluatedTask.of(env_id, task), task.robot
