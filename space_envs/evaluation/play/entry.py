"""Rows of the leaderboard: a policy on a task."""

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, order=True)
class EvaluatedTask:
    """Set of goals of an id: records of different ones never share a row or a table."""

    env_id: str
    difficulty: str
    split: str

    def keywords(self, variant: str | None = None) -> dict[str, Any]:
        """Keywords of the environment that it is played in; `variant` of the model, None for the usual."""
        usual = {"difficulty": self.difficulty, "split": self.split}
        return usual if variant is None else {**usual, "variant": variant}

    def __str__(self) -> str:
        return f"{self.env_id}, {self.difficulty}, {self.split} split"


@dataclass(frozen=True, order=True)
class LeaderboardEntry:
    """Policy in a control mode on a task."""

    task: EvaluatedTask
    policy: str
    control_mode: str
