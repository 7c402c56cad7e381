"""Chunks of an evaluation: episodes that are played together, in any process, always with the same result.

How an evaluation is divided does not depend on the machine nor on the number of processes: floating-point
sums over a batch may differ in their last digit from those over another.
"""

import contextlib
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from typing import Any, Protocol

import numpy as np
from threadpoolctl import threadpool_limits

from space_envs.evaluation.play.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.play.process.limits import TimeLimits
from space_envs.policy import Knowledge, Policy, PolicyContext
from space_envs.registration import find
from space_envs.robots.robot import Robot
from space_envs.system.digests import json_digest
from space_envs.system.threads import on_one_thread

CHUNK = 25  # episodes of a chunk


class PolicySource(Protocol):
    """A policy that can be built in any process; its attributes are plain values."""

    @property
    def name(self) -> str:
        """Name in tables."""
        ...

    @property
    def control_mode(self) -> str:
        """Control mode that it acts in."""
        ...

    @property
    def knowledge(self) -> Knowledge:
        """Knowledge that it is made of."""
        ...

    @property
    def foreign(self) -> bool:
        """Whether it is third-party code, which is called in a process of its own."""
        ...

    def build(self, context: PolicyContext, seed: int) -> Policy:
        """Build the policy."""
        ...


@dataclass(frozen=True)
class Chunk:
    """Episodes of one policy and seed.

    Attributes:
        policy: how it is built. task: what is asked. robot: of which the digest is the task's.
        seed: of goals, the policy and the environment. first: number of its first episode within the seed.
        indices: goals of the split. limits: of the policy's calls, if there are any.
        env: name of the environment that every process can make, with the module that registers it.
    """

    policy: PolicySource
    task: EvaluatedTask
    robot: Robot
    seed: int
    first: int
    indices: tuple[int, ...]
    limits: TimeLimits | None = None
    env: str = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "env", find(self.task.env_id).name)

    @property
    def entry(self) -> LeaderboardEntry:
        """Row of the leaderboard that it counts in."""
        return LeaderboardEntry(self.task, self.policy.name, self.policy.control_mode)

    @property
    def policy_seed(self) -> int:
        """Seed of the policy, so that what it draws differs from chunk to chunk."""
        return int(np.random.SeedSequence([self.seed, self.first]).generate_state(1)[0])

    @property
    def keywords(self) -> dict[str, Any]:
        """Keywords of the task."""
        return self.task.keywords(self.robot)

    @property
    def environment(self) -> dict[str, Any]:
        """Keywords of `CaptureVectorEnv`."""
        return {"env_id": self.env, "control_mode": self.policy.control_mode, **self.keywords}

    def description(self) -> dict[str, Any]:
        """Everything that decides the records, as plain JSON values."""
        return {
            **self.task.to_plain(),
            "policy": self.policy.name,
            "control_mode": self.policy.control_mode,
            "seed": self.seed,
            "first": self.first,
            "indices": list(self.indices),
            "limits": None if self.limits is None else asdict(self.limits),
        }

    @property
    def key(self) -> str:
        """Name of its file."""
        return json_digest(self.description(), 24)

    def build(self, context: PolicyContext) -> Policy:
        """Build the policy, with all that was loaded for it on one thread."""
        policy = self.policy.build(context, self.policy_seed)
        on_one_thread()
        return policy

    @contextlib.contextmanager
    def prepared(self) -> Iterator[None]:
        """Import the module that registers the id, and compute on one thread."""
        find(self.env)
        with threadpool_limits(1):
            yield
