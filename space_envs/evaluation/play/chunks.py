"""Units of an evaluation: episodes that are played together, in any process, always with the same result.

How an evaluation is divided does not depend on the machine nor on the number of processes: floating-point
sums over a batch may differ in their last digit from those over another.
"""

import contextlib
import json
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field, fields
from functools import partial
from hashlib import sha256
from pathlib import Path
from time import perf_counter
from typing import Any, Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.policy_process import TimeLimits
from space_envs.evaluation.play.rollout import PolicyTime, Rollout, roll_out, time_policy
from space_envs.evaluation.records.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.making import episode_records
from space_envs.evaluation.records.timing import UNTIMED
from space_envs.policy import Policy, PolicyContext
from space_envs.registration import find, make_task
from space_envs.system.files import atomic_write
from space_envs.system.reading import parse_json, read_arrays
from space_envs.system.threads import on_one_thread

CHUNK = 25  # episodes of a unit
_ENDS = ("outcome", "cause", "reason")
_ARRAYS = [f.name for f in fields(Rollout) if f.name not in ("goals", *_ENDS)]


class Player(Protocol):
    """A policy that can be built in any process; its attributes are plain values."""

    @property
    def name(self) -> str:
        """In tables."""
        ...

    @property
    def control_mode(self) -> str:
        """That it acts in."""
        ...

    @property
    def foreign(self) -> bool:
        """Whether it is code of a stranger, which is called in a process of its own."""
        ...

    def build(self, context: PolicyContext, seed: int) -> Policy:
        """The policy."""
        ...


@dataclass(frozen=True)
class Unit:
    """Episodes of one policy and seed.

    Attributes:
        player: the policy. task: what is asked. variant: of the model, or None for the usual one.
        seed: of goals, the policy and the environment. first: number of its first episode within the seed.
        indices: goals of the split. limits: of the policy's calls, if there are any.
        env: name of the environment that every process can make, with the module that registers it.
    """

    player: Player
    task: EvaluatedTask
    variant: str | None
    seed: int
    first: int
    indices: tuple[int, ...]
    limits: TimeLimits | None = None
    env: str = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "env", find(self.task.env_id).name)

    @property
    def entry(self) -> LeaderboardEntry:
        """The row of the leaderboard that it counts in."""
        return LeaderboardEntry(self.task, self.player.name, self.player.control_mode)

    @property
    def policy_seed(self) -> int:
        """Of the policy, so that what it draws differs from unit to unit."""
        return int(np.random.SeedSequence([self.seed, self.first]).generate_state(1)[0])

    @property
    def keywords(self) -> dict[str, Any]:
        """Of the task."""
        return task_keywords(self.task, self.variant)

    @property
    def environment(self) -> dict[str, Any]:
        """Keywords of `CaptureVectorEnv`."""
        return {"env_id": self.env, "control_mode": self.player.control_mode, **self.keywords}

    def description(self) -> dict[str, Any]:
        """What decides the records, as plain JSON values."""
        return {
            **asdict(self.task),
            "policy": self.player.name,
            "control_mode": self.player.control_mode,
            "variant": self.variant,
            "seed": self.seed,
            "first": self.first,
            "indices": list(self.indices),
            "limits": None if self.limits is None else asdict(self.limits),
        }

    @property
    def key(self) -> str:
        """Name of its file."""
        return sha256(json.dumps(self.description(), sort_keys=True).encode()).hexdigest()[:24]


@dataclass(frozen=True)
class Part:
    """What a unit gave: records without timing, in the order of the rollout's rows, and wall seconds."""

    records: tuple[EpisodeRecord, ...]
    rollout: Rollout
    seconds: float

    def save(self, path: Path) -> None:
        """Write an npz without pickles, whole or not at all."""
        arrays = {name: getattr(self.rollout, name) for name in _ARRAYS}
        told = {
            "records": [record.to_json() for record in self.records],
            **{name: getattr(self.rollout, name) for name in _ENDS},
            "seconds": self.seconds,
        }
        with atomic_write(path) as temporary, temporary.open("wb") as file:
            np.savez(file, told=np.frombuffer(json.dumps(told).encode(), dtype=np.uint8), **arrays)

    @classmethod
    def load(cls, path: Path, unit: Unit) -> "Part":
        """Read what `save` wrote.

        Raises:
            ConfigurationError: if the file is damaged, or of other episodes.
        """
        try:
            found = read_arrays(path)
            told = parse_json(found["told"].tobytes())
            arrays: dict[str, Any] = {name: found[name] for name in _ARRAYS}
            records = tuple(map(EpisodeRecord.from_json, told["records"]))
            ends: dict[str, Any] = {name: told[name] for name in _ENDS}
            seconds = float(told["seconds"])
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise ConfigurationError(f"{path} is damaged: {error}") from None
        if tuple(arrays["index"].tolist()) != unit.indices:
            raise ConfigurationError(f"{path} holds other episodes")
        goals = make_task(unit.task.env_id, unit.keywords).goals(unit.task.split, arrays["index"])
        return cls(records, Rollout(goals=goals, **ends, **arrays), seconds)


def task_keywords(task: EvaluatedTask, variant: str | None) -> dict[str, Any]:
    """Keywords of the environment that a task is played in."""
    usual = {"difficulty": task.difficulty, "split": task.split}
    return usual if variant is None else {**usual, "variant": variant}


def play(unit: Unit, apart: bool = False) -> Part:
    """Play a unit's episodes on one thread; `apart` as in `roll_out`, which changes no record."""
    with prepared(unit):
        before = perf_counter()
        rollout = roll_out(
            partial(built, unit),
            unit.environment,
            unit.task.split,
            np.array(unit.indices),
            unit.seed,
            unit.limits,
            apart or unit.player.foreign,
        )
        task = make_task(unit.task.env_id, unit.keywords)
        records = episode_records(rollout, task, unit.entry, unit.seed, unit.first, UNTIMED)
        return Part(tuple(records), rollout, perf_counter() - before)


def time_unit(unit: Unit) -> PolicyTime:
    """Time the policy on a unit's episodes; errors as in `time_policy`."""
    with prepared(unit):
        return time_policy(
            partial(built, unit),
            unit.environment,
            unit.task.split,
            np.array(unit.indices),
            unit.limits,
            apart=unit.player.foreign,
        )


@contextlib.contextmanager
def prepared(unit: Unit) -> Iterator[None]:
    """Import the module that registers a unit's id, and compute on one thread."""
    find(unit.env)
    with threadpool_limits(1):
        yield


def built(unit: Unit, context: PolicyContext) -> Policy:
    """A unit's policy, with all that was loaded to build it on one thread."""
    policy = unit.player.build(context, unit.policy_seed)
    on_one_thread()
    return policy
