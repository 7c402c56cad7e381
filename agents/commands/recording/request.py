"""Requests for datasets, and the folders in which they are written."""

import os
import re
import shlex
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from agents.policies.resolve import ResolvedPolicy
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.evaluation.datasets.card import CARD, read_card
from space_envs.evaluation.datasets.minari import DATA
from space_envs.evaluation.play.chunks import CHUNK, Chunk
from space_envs.evaluation.play.entry import EvaluatedTask
from space_envs.evaluation.play.playing import split_indices
from space_envs.perturbations.amounts import NOMINAL
from space_envs.registration import find
from space_envs.robots.robot import Robot
from space_envs.system.digests import file_digest

NAMESPACE, VERSION = "space-capture", "v0"


@dataclass(frozen=True)
class DatasetRequest:
    """Request for a dataset: a policy, a task, the number of episodes, and the formats.

    Attributes:
        episodes: number of episodes. seed: of the goals, their order and the policy.
        captured_only: whether only captures are written. formats: npz, minari.
        control_mode: given by the user; None for the policy's default. robot: keywords of the task that
            choose it, as the user gave them. model: the robot.
    """

    task: EvaluatedTask
    model: Robot
    policy: ResolvedPolicy
    episodes: int
    seed: int
    captured_only: bool
    formats: tuple[str, ...]
    control_mode: str | None = None
    robot: Mapping[str, str] = field(default_factory=dict)

    @property
    def id(self) -> str:
        """Name of the dataset as Minari requires, with parts of letters, digits, - and _."""
        name = re.sub(r"[^\w-]+", "-", self.policy.name, flags=re.ASCII).strip("-") or "policy"
        env = self.task.env_id.removeprefix("SpaceCapture/").replace("/", "-").replace(".", "-")
        given = [re.sub(r"[^\w-]+", "-", Path(word).stem, flags=re.ASCII) for word in self.robot.values()]
        goal = None if self.task.goal == "pose" else self.task.goal
        perturbed = None if self.task.perturbation == NOMINAL else self.task.perturbation
        perturbed = perturbed and re.sub(r"[^\w-]+", "-", perturbed, flags=re.ASCII)
        words = [name, self.control_mode, *given, self.task.difficulty, goal, self.task.split, perturbed]
        words.append(VERSION)
        return f"{NAMESPACE}/{env}/{'-'.join(filter(None, words))}"

    @property
    def keywords(self) -> dict[str, Any]:
        """Keywords of `gym.make`, without the id."""
        return {"control_mode": self.policy.control_mode, **self.task.keywords(self.model)}

    @property
    def plain_keywords(self) -> dict[str, Any]:
        """Keywords of `gym.make` as plain values, the robot as the user named it."""
        return {**{name: value for name, value in self.keywords.items() if name != "robot"}, **self.robot}

    def make_env(self) -> CaptureVectorEnv:
        """An environment of one episode."""
        return CaptureVectorEnv(self.task.env_id, 1, **self.keywords)

    def chunks(self) -> list[Chunk]:
        """Chunks of all episodes.

        Raises:
            ConfigurationError: if the split has fewer goals.
        """
        task = self.make_env().task
        indices = split_indices(task, self.task.split, self.episodes, self.seed).tolist()
        return [
            Chunk(
                self.policy,
                self.task,
                self.model,
                self.seed,
                first,
                tuple(indices[first : first + CHUNK]),
            )
            for first in range(0, self.episodes, CHUNK)
        ]

    def to_json(self) -> dict[str, Any]:
        """Values that determine the dataset, as plain JSON values."""
        source = self.policy.source
        return {
            "id": self.id,
            "env_id": self.task.env_id,
            "policy": self.policy.name,
            "source": source.name if isinstance(source, Path) else source,
            "source_checksum": file_digest(source) if isinstance(source, Path) else None,
            "control_mode": self.policy.control_mode,
            "robot": self.task.robot,
            "robot_digest": self.task.robot_digest,
            "difficulty": self.task.difficulty,
            "split": self.task.split,
            "goal": self.task.goal,
            **({} if self.task.perturbation == NOMINAL else {"perturbation": self.task.perturbation}),
            "episodes": self.episodes,
            "seed": self.seed,
            "captured_only": self.captured_only,
            "formats": list(self.formats),
        }

    def command(self) -> str:
        """Command line that makes only this dataset."""
        source = self.policy.source.name if isinstance(self.policy.source, Path) else self.policy.source
        words = ["evaluate.py", "dataset", "--env", find(self.task.env_id).name, "--policy", source]
        words += ["--difficulty", self.task.difficulty, "--split", self.task.split]
        words += [] if self.task.goal == "pose" else ["--goal", self.task.goal]
        perturbation = self.task.perturbation
        words += [] if perturbation == NOMINAL else ["--perturb", *perturbation.split()]
        words += ["--episodes", str(self.episodes), "--seed", str(self.seed), "--format", *self.formats]
        words += [] if self.control_mode is None else ["--control-mode", self.control_mode]
        words += [word for name, value in self.robot.items() for word in (f"--{name}", Path(value).name)]
        return shlex.join([*words, "--captured-only"] if self.captured_only else words)


@dataclass(frozen=True)
class DatasetFolders:
    """Folder of the datasets, and Minari's folder."""

    output: Path
    minari: Path

    def prepare(self) -> None:
        """Make both folders.

        Raises:
            ConfigurationError: if they cannot be written.
        """
        for path in (self.output, self.minari):
            try:
                path.mkdir(parents=True, exist_ok=True)
            except OSError as error:
                raise ConfigurationError(f"cannot write to {path}: {error.strerror}") from None
            if not os.access(path, os.W_OK):
                raise ConfigurationError(f"cannot write to {path}: it is read-only")

    def folder(self, request: DatasetRequest) -> Path:
        """Folder of a dataset."""
        return self.output / request.id

    def data(self, request: DatasetRequest) -> Path:
        """Minari's part of a dataset."""
        return self.minari / request.id / DATA


def complete(request: DatasetRequest, folders: DatasetFolders) -> bool:
    """Whether a dataset exists already.

    Raises:
        ConfigurationError: if its folder holds something else.
    """
    folder, data = folders.folder(request), folders.data(request)
    card, requested = read_card(folder), request.to_json()
    if card is None:
        if (
            "minari" in request.formats
            and data.exists()
            and folders.minari.resolve() != folders.output.resolve()
        ):
            raise ConfigurationError(
                f"{data} exists already, but {folder} has no card of it; remove it, or choose other folders"
            )
        return False
    if card["request"] != requested:
        names = [name for name in requested if card["request"].get(name) != requested[name]]
        changes = "; ".join(f"{name} was {card['request'].get(name)}, is {requested[name]}" for name in names)
        raise ConfigurationError(
            f"{folder} holds another dataset: {changes}; remove it, or choose another --output"
        )
    if "minari" in request.formats and not data.is_dir():
        raise ConfigurationError(
            f"{folder / CARD} names a Minari dataset, but {data} is missing; remove {folder}"
        )
    return True
