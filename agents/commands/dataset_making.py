"""What `evaluate.py dataset` makes: requests, the folders they go to, and the work itself."""

import os
import re
import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from joblib import delayed
from tqdm import tqdm

from agents.policies.resolve import ResolvedPolicy
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, PolicyError
from space_envs.evaluation.datasets.card import CARD, EPISODES, make_card, read_card, write_card
from space_envs.evaluation.datasets.minari import DATA, write_minari
from space_envs.evaluation.datasets.recording import Recorded, record
from space_envs.evaluation.datasets.storage import Dataset
from space_envs.evaluation.play.chunks import CHUNK, Chunk
from space_envs.evaluation.play.entry import EvaluatedTask
from space_envs.evaluation.play.episodes import task_keywords
from space_envs.evaluation.play.playing import split_indices
from space_envs.registration import find
from space_envs.system.digests import file_digest
from space_envs.system.parallel import ProcessDiedError, backend
from space_envs.system.provenance import provenance

NAMESPACE, VERSION = "space-capture", "v0"


@dataclass(frozen=True)
class Request:
    """One dataset: which episodes of which policy, and in which formats.

    `control_mode` and `variant` are those that were asked for; without, the policy's own and the paper's.
    """

    task: EvaluatedTask
    policy: ResolvedPolicy
    episodes: int
    seed: int
    captured_only: bool
    formats: tuple[str, ...]
    control_mode: str | None = None
    variant: str | None = None

    @property
    def id(self) -> str:
        """Of the dataset, in Minari's form, where a name is made of letters, digits, - and _."""
        name = re.sub(r"[^\w-]+", "-", self.policy.name, flags=re.ASCII).strip("-") or "policy"
        env = self.task.env_id.split("/")[1]
        words = [name, self.control_mode, self.variant, self.task.difficulty, self.task.split, VERSION]
        return f"{NAMESPACE}/{env}/{'-'.join(filter(None, words))}"

    @property
    def keywords(self) -> dict[str, Any]:
        """Of `gym.make`, but for the id."""
        return {"control_mode": self.policy.control_mode, **task_keywords(self.task, self.variant)}

    def make_env(self) -> CaptureVectorEnv:
        """The environment, for one episode."""
        return CaptureVectorEnv(self.task.env_id, 1, **self.keywords)

    def chunks(self) -> list[Chunk]:
        """All episodes.

        Raises:
            ConfigurationError: if the split has fewer goals.
        """
        task = self.make_env().task
        indices = split_indices(task, self.task.split, self.episodes, self.seed).tolist()
        return [
            Chunk(
                self.policy,
                self.task,
                self.variant,
                self.seed,
                first,
                tuple(indices[first : first + CHUNK]),
            )
            for first in range(0, self.episodes, CHUNK)
        ]

    def to_json(self) -> dict[str, Any]:
        """What decides the dataset, as plain values."""
        source = self.policy.source
        return {
            "id": self.id,
            "env_id": self.task.env_id,
            "policy": self.policy.name,
            "source": source.name if isinstance(source, Path) else source,
            "source_checksum": file_digest(source) if isinstance(source, Path) else None,
            "control_mode": self.policy.control_mode,
            "variant": self.variant,
            "difficulty": self.task.difficulty,
            "split": self.task.split,
            "episodes": self.episodes,
            "seed": self.seed,
            "captured_only": self.captured_only,
            "formats": list(self.formats),
        }

    def command(self) -> str:
        """The command line that makes this dataset alone."""
        told = self.to_json()
        words = ["evaluate.py", "dataset", "--env", told["env_id"], "--policy", told["source"]]
        words += [
            "--difficulty",
            told["difficulty"],
            "--split",
            told["split"],
            "--episodes",
            str(self.episodes),
        ]
        words += ["--seed", str(self.seed), "--format", *self.formats]
        words += [] if self.control_mode is None else ["--control-mode", self.control_mode]
        words += [] if self.variant is None else ["--variant", self.variant]
        return shlex.join([*words, "--captured-only"] if self.captured_only else words)


@dataclass(frozen=True)
class Places:
    """Folders: of the datasets, and the one that Minari is told of."""

    output: Path
    minari: Path

    def prepare(self) -> None:
        """Make them.

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

    def folder(self, request: Request) -> Path:
        """Of a dataset."""
        return self.output / request.id

    def data(self, request: Request) -> Path:
        """Minari's part of a dataset."""
        return self.minari / request.id / DATA


def complete(request: Request, places: Places) -> bool:
    """Whether a dataset is there already.

    Raises:
        ConfigurationError: if its place holds something else.
    """
    folder, data = places.folder(request), places.data(request)
    card, wanted = read_card(folder), request.to_json()
    if card is None:
        if (
            "minari" in request.formats
            and data.exists()
            and places.minari.resolve() != places.output.resolve()
        ):
            raise ConfigurationError(
                f"{data} is there already, but {folder} has no card of it; remove it, or choose other folders"
            )
        return False
    if card["request"] != wanted:
        names = [name for name in wanted if card["request"].get(name) != wanted[name]]
        told = "; ".join(f"{name} was {card['request'].get(name)}, is {wanted[name]}" for name in names)
        raise ConfigurationError(
            f"{folder} holds another dataset: {told}; remove it, or choose another --output"
        )
    if "minari" in request.formats and not data.is_dir():
        raise ConfigurationError(
            f"{folder / CARD} tells of a Minari dataset, but {data} is missing; remove {folder}"
        )
    return True


def make(requests: Sequence[Request], places: Places, jobs: int) -> Iterator[tuple[Request, dict[str, Any]]]:
    """Make the datasets in parallel, and write each as soon as its last episode is there; yields its card.

    Raises:
        PolicyError: if a process died with its policy; what is complete is kept.
    """
    chunks = [(number, chunk) for number, request in enumerate(requests) for chunk in request.chunks()]
    if not chunks:
        return
    left = [sum(number == of for of, _ in chunks) for number in range(len(requests))]
    parts: list[list[Recorded]] = [[] for _ in requests]
    total = sum(len(chunk.indices) for _, chunk in chunks)
    bar = tqdm(total=total, unit="episode", leave=False, smoothing=0.0)
    with bar, backend(min(jobs, len(chunks))) as spread:
        try:
            for number, episodes, recorded in spread(delayed(_recorded)(*pair) for pair in chunks):
                bar.update(episodes)
                parts[number].append(recorded)
                left[number] -= 1
                if left[number] == 0:
                    yield requests[number], _written(requests[number], parts[number], places)
                    parts[number] = []
        except ProcessDiedError:
            raise PolicyError(
                "a process died while a policy played in it; complete datasets are kept"
            ) from None


def _recorded(number: int, chunk: Chunk) -> tuple[int, int, Recorded]:
    return number, len(chunk.indices), record(chunk)


def _written(request: Request, parts: Sequence[Recorded], places: Places) -> dict[str, Any]:
    """Write a dataset; returns its card, or what would be its left-out episodes if there are no others."""
    folder = places.folder(request)
    kept = sorted(chain(*(part.kept for part in parts)), key=lambda one: one.episode)
    left_out = sorted(chain(*(part.left_out for part in parts)), key=lambda one: one.episode)
    if request.captured_only:
        kept = [one for one in kept if one.captured]
    if not kept:
        return {"episodes": {"written": 0, "captured": 0, "left_out": [vars(one) for one in left_out]}}
    told = request.to_json()
    names = ("env_id", "policy", "control_mode", "difficulty", "split")
    dataset = Dataset.of({name: told[name] for name in names}, kept)
    origin = provenance(request.command(), [request.seed])
    card = make_card(told, origin, dataset, left_out, request.make_env())
    card["files"] = {}
    if "npz" in request.formats:
        dataset.save(folder / EPISODES)
        card["files"] = {EPISODES: file_digest(folder / EPISODES)}
    if "minari" in request.formats:
        keywords = {"id": find(request.task.env_id).name, **request.keywords}
        about = f"Made by: {request.command()}"
        write_minari(dataset, request.id, places.minari, about, keywords)
        card["minari"] = {"dataset_id": request.id}
    write_card(folder, card)
    return card
