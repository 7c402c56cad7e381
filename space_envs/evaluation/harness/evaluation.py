"""Evaluations: policies on tasks, goals and seeds, divided into chunks."""

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

from space_envs.evaluation.play.chunks import CHUNK, Chunk, PolicySource
from space_envs.evaluation.play.entry import EvaluatedTask
from space_envs.evaluation.play.episodes import EpisodeBatch
from space_envs.evaluation.play.playing import split_indices
from space_envs.evaluation.play.process.limits import TimeLimits
from space_envs.evaluation.records.episode import SCHEMA_VERSION, EpisodeRecord
from space_envs.registration import make_task
from space_envs.robots.robot import Robot
from space_envs.system.provenance import commit, versions


@dataclass(frozen=True)
class Evaluation:
    """Policies on tasks, and the episodes that they play.

    Attributes:
        entries: pairs of a task and a policy, in the order of the records.
        episodes: different goals of each split. seeds: of goals, policies and environments; each is a
            stratum of the intervals. robots: by task. limits: of the policies' calls, if any.
    """

    entries: tuple[tuple[EvaluatedTask, PolicySource], ...]
    episodes: int
    seeds: tuple[int, ...]
    robots: Mapping[EvaluatedTask, Robot]
    limits: TimeLimits | None = None

    def chunks(self) -> list[Chunk]:
        """All chunks, in the order of the records.

        Raises:
            ConfigurationError: if a split has fewer goals, or a task cannot be made.
        """
        goals: dict[tuple[EvaluatedTask, int], list[int]] = {}
        for task in dict.fromkeys(task for task, _ in self.entries):
            made = make_task(task.env_id, task.keywords(self.robots[task]))
            for seed in self.seeds:
                goals[task, seed] = split_indices(made, task.split, self.episodes, seed).tolist()
        return [
            Chunk(
                policy,
                task,
                self.robots[task],
                seed,
                first,
                tuple(goals[task, seed][first : first + CHUNK]),
                self.limits,
            )
            for task, policy in self.entries
            for seed in self.seeds
            for first in range(0, self.episodes, CHUNK)
        ]

    def plan(self) -> dict[str, Any]:
        """Everything that decides the records, as plain JSON values."""
        return {
            "schema": SCHEMA_VERSION,
            "entries": [
                [*task.to_plain().values(), policy.name, policy.control_mode] for task, policy in self.entries
            ],
            "episodes": self.episodes,
            "seeds": list(self.seeds),
            "limits": None if self.limits is None else asdict(self.limits),
            "commit": commit(),
            "versions": versions(),
        }


@dataclass(frozen=True, eq=False)
class Evaluated:
    """All episodes of a policy on a task, rows and records in one order: by seed, then by episode.

    Attributes:
        records: one for each episode. episodes: as they are stored. pace: s an episode, of each chunk.
    """

    records: tuple[EpisodeRecord, ...]
    episodes: EpisodeBatch
    pace: tuple[float, ...]
