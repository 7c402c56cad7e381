"""Rows of the leaderboard: a policy on a task."""

from dataclasses import asdict, dataclass
from typing import Any, Self

from space_envs.perturbations.amounts import NOMINAL
from space_envs.robots.robot import Robot
from space_envs.tasks.base import CaptureTask

DIGITS = 12  # of a robot's digest, as of a configuration's hash


@dataclass(frozen=True, order=True)
class EvaluatedTask:
    """Set of goals of an id for a robot: records of different ones never share a row or a table.

    Attributes:
        robot: its name, with the variant where it has several. robot_digest: first digits of its digest.
        goal: kind of the goals, where the task has the choice.
        perturbation: of the simulated robot and of the observations, as the text of a `Perturbation`.
    """

    env_id: str
    robot: str
    robot_digest: str
    difficulty: str
    split: str
    goal: str = "pose"
    perturbation: str = NOMINAL

    @classmethod
    def of(cls, env_id: str, task: CaptureTask) -> Self:
        """The set of goals that a task draws from by default."""
        robot = task.robot
        goals = task.difficulty, task.split, task.goal
        return cls(env_id, robot.title, robot.digest[:DIGITS], *goals, task.perturbation.text)

    def keywords(self, robot: Robot) -> dict[str, Any]:
        """Keywords of the environment that it is played in, with its robot."""
        goal = {} if self.goal == "pose" else {"goal": self.goal}
        perturbation = {} if self.perturbation == NOMINAL else {"perturbation": self.perturbation}
        return {"difficulty": self.difficulty, "split": self.split, "robot": robot, **goal, **perturbation}

    def __str__(self) -> str:
        goal = "" if self.goal == "pose" else f", goal {self.goal}"
        perturbation = "" if self.perturbation == NOMINAL else f", perturbation {self.perturbation}"
        return f"{self.env_id}, {self.robot}, {self.difficulty}, {self.split} split{goal}{perturbation}"

    def to_plain(self) -> dict[str, str]:
        """Fields as plain values, the perturbation only if there is one."""
        plain = asdict(self)
        if self.perturbation == NOMINAL:
            del plain["perturbation"]
        return plain


@dataclass(frozen=True, order=True)
class LeaderboardEntry:
    """Policy in a control mode on a task."""

    task: EvaluatedTask
    policy: str
    control_mode: str
