"""Everything that a report is made from."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from space_envs.evaluation.play.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.play.episodes import EpisodeBatch
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.metrics import Described
from space_envs.evaluation.records.names import joined_file_name
from space_envs.evaluation.replay.replay import Replay
from space_envs.evaluation.replay.stills import Still
from space_envs.perturbations.amounts import NOMINAL

EPISODES = "episodes"  # folder of the files of episodes


@dataclass(frozen=True)
class EvaluationResult:
    """All that `write_report` needs, for one run of `evaluate.py`.

    `provenance` is shown in the report as it is: `command`, `versions`, `machine`, `commit`, ... What a clock
    or the machine's load decides goes under its key `timing`, so that the rest repeats byte for byte.
    `pictures` holds stills of a capture for each entry, in order of time; where it is empty,
    `pictures_note` says why in one sentence. `episodes` holds all recorded ones of each entry, `replays` the
    best, the median and the worst of them. `experts` are the names of policies among which the best has the
    normalised score 1. `described` holds metrics of tasks that this process may not know.
    """

    records: Sequence[EpisodeRecord]
    episodes: Mapping[LeaderboardEntry, EpisodeBatch] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    pictures: Mapping[LeaderboardEntry, Sequence[Still]] = field(default_factory=dict)
    pictures_note: str = ""
    replays: Mapping[LeaderboardEntry, Sequence[Replay]] = field(default_factory=dict)
    experts: Collection[str] = ()
    described: Described = field(default_factory=dict)


def entry_stem(entry: LeaderboardEntry) -> str:
    """Stem of the files that belong to an entry, which no other entry shares."""
    return joined_file_name(*_words(entry.task), entry.policy, entry.control_mode)


def task_stem(task: EvaluatedTask) -> str:
    """Stem of the files that belong to a task, which no other task shares."""
    return joined_file_name(*_words(task))


def _words(task: EvaluatedTask) -> tuple[str, ...]:
    own = () if task.goal == "pose" else (task.goal,)
    own += () if task.perturbation == NOMINAL else (task.perturbation,)
    return task.env_id, task.robot, task.robot_digest, task.difficulty, task.split, *own
