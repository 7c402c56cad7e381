"""Result folders of others: read, validated, and checked against their checksums."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from space_envs.errors import ConfigurationError
from space_envs.evaluation.harness.runner import CHUNKS, PLAN, progress
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.play.episode_file import load_episodes
from space_envs.evaluation.play.episodes import EpisodeBatch
from space_envs.evaluation.records.configuration import configuration_hash
from space_envs.evaluation.records.descriptions import described_metrics
from space_envs.evaluation.records.episode import RECORDS, SCHEMA_VERSION, SUMMARY, EpisodeRecord
from space_envs.evaluation.records.metrics import Described
from space_envs.evaluation.records.storage import read_records
from space_envs.evaluation.results.result import EPISODES, entry_stem
from space_envs.system.digests import file_digest
from space_envs.system.output import holder
from space_envs.system.reading import read_object


@dataclass(frozen=True, eq=False)
class ResultFolder:
    """Result folder of an evaluation, or of a comparison of several.

    Attributes:
        path: of the folder. records: all of them, each validated. summary: of summary.json, empty where
            there is none. described: metrics of its tasks' own, by id, as the summary has them. notes: what a
            reader should know of it.
    """

    path: Path
    records: tuple[EpisodeRecord, ...]
    summary: Mapping[str, Any]
    described: Described
    notes: tuple[str, ...] = ()

    @property
    def provenance(self) -> Mapping[str, Any]:
        """Provenance of the records, as far as the folder has it."""
        return self.summary.get("provenance", {})

    @property
    def configurations(self) -> Mapping[str, Mapping[str, Any]]:
        """Configurations of the tasks by their hash, as far as the folder has them."""
        return self.provenance.get("configurations", {})

    def episodes(self, entry: LeaderboardEntry) -> EpisodeBatch | None:
        """Recorded episodes of an entry, if there are any.

        Raises:
            ConfigurationError: if their file is damaged, was edited, or is of other episodes.
        """
        name = f"{EPISODES}/{entry_stem(entry)}.npz"
        checksums = self.summary.get("checksums", {})
        # Files that the summary does not know are left from something else that was written here.
        if not (self.path / name).is_file() or (checksums and name not in checksums):
            return None
        _verify(self.path, name, self.summary)
        episodes = load_episodes(self.path / name)
        ends = {
            (r.seed, r.episode): (r.index, r.outcome, r.metrics["steps"])
            for r in self.records
            if r.entry == entry
        }
        columns = (episodes.seed, episodes.episode, episodes.index, episodes.outcome, episodes.length)
        for seed, episode, *end in zip(*(column.tolist() for column in columns), strict=True):
            if ends.get((seed, episode)) != tuple(end):
                raise ConfigurationError(
                    f"{self.path / name}: episode {episode} of seed {seed} is another one than in {RECORDS}"
                )
        return episodes


def read_folder(path: str | Path) -> ResultFolder:
    """Read a result folder.

    Raises:
        ConfigurationError: if it is none, is not complete, or holds a record that is not valid or was edited;
            the message names the file, and the line where there is one.
    """
    path = Path(path)
    records, summary = path / RECORDS, path / SUMMARY
    interrupted = (path / CHUNKS).is_dir()
    if not path.is_dir():
        what = "is a file" if path.exists() else "does not exist"
        raise ConfigurationError(f"{path} {what}; expected a folder that evaluate.py left")
    if not records.is_file():
        if (writer := holder(path)) is not None:
            raise ConfigurationError(f"{writer} is evaluating into {path}: {progress(path)}")
        if interrupted or (path / PLAN).is_file():
            raise ConfigurationError(
                f"{path} holds an evaluation that was interrupted; run the same command with --resume"
            )
        raise ConfigurationError(f"{path} is no folder of results: it has no {RECORDS}")
    try:
        found = read_records(records)
        content = _read_summary(summary) if summary.is_file() else {}
        described = described_metrics(content.get("metrics", {}))
        _verify(path, RECORDS, content)
    except ConfigurationError as error:
        hint = "; an evaluation into this folder was interrupted, the same command with --resume finishes it"
        raise ConfigurationError(f"{error}{hint if interrupted else ''}") from error
    if not found:
        raise ConfigurationError(f"{records} is empty")
    notes = []
    if interrupted:
        writer = holder(path)
        state = "was interrupted" if writer is None else f"by {writer} is running, {progress(path)}"
        notes.append(f"an evaluation into {path} {state}; these are the results from before it")
    if not content:
        notes.append(f"{path} has no {SUMMARY}: neither its configuration nor that nobody edited it is known")
    return ResultFolder(path, tuple(found), content, described, tuple(notes))


def _read_summary(path: Path) -> dict[str, Any]:
    """Content of summary.json, with everything that is used later checked for its type."""
    try:
        content = read_object(path)
        provenance = content.get("provenance", {})
        configurations = provenance.get("configurations", {})
        for each in (provenance, configurations, content.get("checksums", {}), *configurations.values()):
            if not isinstance(each, dict):
                raise ValueError(f"expected an object, got {each!r}")
    except (OSError, ValueError, AttributeError) as error:
        raise ConfigurationError(f"{path}: not a summary of results: {error}") from error
    if content.get("schema") != SCHEMA_VERSION:
        raise ConfigurationError(
            f"{path}: its schema is {content.get('schema')!r}; this version reads schema {SCHEMA_VERSION}: "
            "evaluate again with it"
        )
    for name, configuration in configurations.items():
        digest = configuration_hash(configuration)
        if digest != name:
            raise ConfigurationError(f"{path}: the configuration {name} has the hash {digest}: it was edited")
    return content


def _verify(folder: Path, name: str, summary: Mapping[str, Any]) -> None:
    """Check a file's bytes, where the summary has their checksum."""
    wanted = summary.get("checksums", {}).get(name)
    if wanted is None:
        return
    try:
        got = file_digest(folder / name)
    except (OSError, ConfigurationError) as error:
        raise ConfigurationError(f"{folder / name}: cannot be read: {error}") from error
    if got != wanted:
        raise ConfigurationError(
            f"{folder / name} is not what was written: its SHA-256 is {got}, {SUMMARY} has {wanted}: "
            "it was edited or copied in part"
        )
