"""Results of chunks: records and episodes, in one file per chunk until an evaluation is complete."""

import json
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter
from typing import Self

import numpy as np

from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.chunks import Chunk
from space_envs.evaluation.play.episode_file import compact, from_arrays, to_arrays
from space_envs.evaluation.play.episodes import EpisodeBatch
from space_envs.evaluation.play.playing import roll_out
from space_envs.evaluation.play.timing import PolicyTime, time_policy
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.making import episode_records
from space_envs.evaluation.records.timing import UNTIMED
from space_envs.registration import make_task
from space_envs.system.files import write_arrays
from space_envs.system.reading import parse_json, read_arrays


@dataclass(frozen=True, eq=False)
class ChunkResult:
    """Records (without timing) and episodes of a chunk, in the same order, and its wall time in s."""

    records: tuple[EpisodeRecord, ...]
    episodes: EpisodeBatch
    seconds: float

    def save(self, path: Path) -> None:
        """Write a file of episodes that has records too, whole or not at all."""
        records = {"records": [record.to_json() for record in self.records], "seconds": self.seconds}
        write_arrays(path, {"records": np.array(json.dumps(records)), **to_arrays(self.episodes)})

    @classmethod
    def load(cls, path: Path, chunk: Chunk) -> Self:
        """Read what `save` wrote.

        Raises:
            ConfigurationError: if the file is damaged, or of other episodes.
        """
        try:
            arrays = read_arrays(path)
            read = parse_json(str(arrays.pop("records")))
            records, seconds = tuple(map(EpisodeRecord.from_json, read["records"])), float(read["seconds"])
            episodes = from_arrays(arrays)
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise ConfigurationError(f"{path} is damaged: {error}") from None
        if episodes.entry != chunk.entry or tuple(episodes.index.tolist()) != chunk.indices:
            raise ConfigurationError(f"{path} holds other episodes")
        return cls(records, episodes, seconds)


def evaluate_chunk(chunk: Chunk, apart: bool = False) -> ChunkResult:
    """Play a chunk's episodes on one thread; `apart` as in `roll_out`, which changes no record."""
    with chunk.prepared():
        before = perf_counter()
        rollout = roll_out(
            chunk.build,
            chunk.environment,
            chunk.task.split,
            np.array(chunk.indices),
            chunk.seed,
            chunk.limits,
            apart or chunk.policy.foreign,
            policy=chunk.policy.name,
            first=chunk.first,
        )
        task = make_task(chunk.task.env_id, chunk.keywords)
        knowledge = chunk.policy.knowledge
        records = episode_records(rollout, task, chunk.entry, chunk.seed, chunk.first, UNTIMED, knowledge)
        return ChunkResult(tuple(records), compact(rollout), perf_counter() - before)


def time_chunk(chunk: Chunk) -> PolicyTime:
    """Time the policy on a chunk's episodes; errors as in `time_policy`."""
    with chunk.prepared():
        return time_policy(
            chunk.build,
            chunk.environment,
            chunk.task.split,
            np.array(chunk.indices),
            chunk.limits,
            apart=chunk.policy.foreign,
        )
