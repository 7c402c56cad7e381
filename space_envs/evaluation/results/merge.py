"""Result folders of several people as one result."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.play.episodes import EpisodeBatch, concatenate
from space_envs.evaluation.records.episode import RECORDS, EpisodeRecord
from space_envs.evaluation.replay.replay import Replay, make_replays
from space_envs.evaluation.results.agreement import check_agreement
from space_envs.evaluation.results.folders import ResultFolder
from space_envs.evaluation.results.result import EvaluationResult

NO_PICTURES = "Pictures are not merged; those of each result are in its own report."
_Key = tuple[LeaderboardEntry, int, int]  # with seed and episode


@dataclass(frozen=True, eq=False)
class Source:
    """A result folder, and a name appended to those of its policies; empty for none."""

    folder: ResultFolder
    name: str = ""

    def renamed(self, policy: str) -> str:
        """A policy's name in the merged result."""
        return f"{policy} ({self.name})" if self.name else policy

    def original(self, entry: LeaderboardEntry) -> LeaderboardEntry:
        """The folder's own entry for an entry of the merged result."""
        return replace(entry, policy=entry.policy.removesuffix(f" ({self.name})" if self.name else ""))

    def __str__(self) -> str:
        return str(self.folder.path)


@dataclass(frozen=True, eq=False)
class _Kept:
    record: EpisodeRecord
    source: Source


def merge(
    sources: Sequence[Source], provenance: Mapping[str, Any], separate: bool = False
) -> tuple[EvaluationResult, list[str]]:
    """One result of several folders, and notes for its reader.

    An episode that stands in two folders alike is counted once. Recorded episodes and replays are those of
    the folders, where they have them.

    Args:
        provenance: of the merged result; configurations and the sources' own provenance are added to it.
        separate: as in `space_envs.evaluation.results.agreement.check_agreement`.

    Raises:
        ConfigurationError: if the folders are not of the same tasks, if an episode stands in two of them
            with different results, or a file of theirs was edited.
    """
    check_agreement([source.folder for source in sources], separate)
    kept, repeated = _gather(sources)
    entries: dict[LeaderboardEntry, list[_Kept]] = {}
    for (entry, _, _), one in kept.items():
        entries.setdefault(entry, []).append(one)
    for group in entries.values():
        group.sort(key=lambda one: (one.record.seed, one.record.episode))
    episodes: dict[LeaderboardEntry, EpisodeBatch] = {}
    replays: dict[LeaderboardEntry, Sequence[Replay]] = {}
    unknown: dict[str, None] = {}
    for entry, group in entries.items():
        recorded = _episodes(entry, group)
        if recorded is not None:
            episodes[entry] = recorded
            try:
                replays[entry] = _replays(recorded, group)
            except (
                ConfigurationError
            ) as error:  # a task that is not of this suite, or of another version of it
                unknown[f"there are no replays of {entry.task}: {error}"] = None
    result = EvaluationResult(
        records=[one.record for group in entries.values() for one in group],
        episodes=episodes,
        provenance=_provenance(sources, provenance),
        pictures_note=NO_PICTURES,
        replays=replays,
        described={env_id: own for source in sources for env_id, own in source.folder.described.items()},
    )
    read = [note for source in sources for note in source.folder.notes]
    return result, [*read, *_repetitions(repeated), *_mixtures(entries), *_coverage(entries), *unknown]


def _gather(sources: Sequence[Source]) -> tuple[dict[_Key, _Kept], Counter[tuple[str, str]]]:
    """Every episode once, and the number of equal ones in each pair of folders."""
    kept: dict[_Key, _Kept] = {}
    repeated: Counter[tuple[str, str]] = Counter()
    for source in sources:
        for record in source.folder.records:
            if source.name:
                record = replace(record, policy=source.renamed(record.policy), checksum="")
            key = (record.entry, record.seed, record.episode)
            before = kept.setdefault(key, _Kept(record, source))
            if before.record is record:
                continue
            if before.source is source:
                raise ConfigurationError(f"{source.folder.path / RECORDS}: {_called(record)} stands twice")
            if before.record.checksum != record.checksum:
                raise ConfigurationError(_conflict(before, _Kept(record, source)))
            repeated[str(before.source), str(source)] += 1
    return kept, repeated


def _called(record: EpisodeRecord) -> str:
    return (
        f"episode {record.episode} of seed {record.seed} of {record.policy!r} ({record.control_mode}) on "
        f"{record.entry.task}"
    )


def _conflict(one: _Kept, two: _Kept) -> str:
    first, second = one.record.to_dict(), two.record.to_dict()
    names = [name for name in first if name not in ("timing", "checksum") and first[name] != second[name]]
    name = "outcome" if "outcome" in names else names[0]
    rest = f" and {len(names) - 1} more fields differ" if len(names) > 1 else ""
    return (
        f"{_called(one.record)} is in {one.source} and in {two.source} with different results: {name} is "
        f"{first[name]!r} and {second[name]!r}{rest}. If they are two policies of one name, tell them apart "
        f"with --name {two.source}=WHOSE"
    )


def _episodes(entry: LeaderboardEntry, group: Sequence[_Kept]) -> EpisodeBatch | None:
    """Recorded episodes of an entry, as far as its folders have them."""
    parts = []
    for source in dict.fromkeys(one.source for one in group):
        found = source.folder.episodes(source.original(entry))
        if found is None:
            continue
        recorded = set(zip(found.seed.tolist(), found.episode.tolist(), strict=True))
        own = [(one.record.seed, one.record.episode) for one in group if one.source is source]
        part = found.take([found.row(*pair) for pair in own if pair in recorded])
        parts.append(replace(part, entry=entry))
    return concatenate(parts) if parts else None


def _replays(episodes: EpisodeBatch, group: Sequence[_Kept]) -> Sequence[Replay]:
    records = {(one.record.seed, one.record.episode): one.record for one in group}
    pairs = zip(episodes.seed.tolist(), episodes.episode.tolist(), strict=True)
    return make_replays(episodes.task(), episodes, [records[pair] for pair in pairs])


def _provenance(sources: Sequence[Source], provenance: Mapping[str, Any]) -> dict[str, Any]:
    configurations: dict[str, Any] = {}
    own_provenance: dict[str, Any] = {}
    for source in sources:
        folder = source.folder
        configurations |= folder.configurations
        own = {name: value for name, value in folder.provenance.items() if name != "configurations"}
        about = {"records": len(folder.records)} | ({"renamed": source.name} if source.name else {})
        own_provenance[str(source)] = about | own
    return {**provenance, "configurations": configurations, "sources": own_provenance}


def _repetitions(repeated: Counter[tuple[str, str]]) -> list[str]:
    return [
        f"{count} episodes stand in {one} and in {two} alike and are counted once"
        for (one, two), count in repeated.items()
    ]


def _mixtures(entries: Mapping[LeaderboardEntry, Sequence[_Kept]]) -> list[str]:
    """Notes on rows whose episodes are from several folders, which may be different policies."""
    notes = []
    for entry, group in entries.items():
        counts = Counter(str(one.source) for one in group)
        if len(counts) > 1:
            parts = ", ".join(f"{count} from {name}" for name, count in counts.items())
            notes.append(
                f"the episodes of {entry.policy!r} on {entry.task} are put together ({parts}); if they "
                "are different policies, tell them apart with --name"
            )
    return notes


def _coverage(entries: Mapping[LeaderboardEntry, Sequence[_Kept]]) -> list[str]:
    """Notes on tables whose policies were evaluated on different goals."""
    goals: dict[EvaluatedTask, dict[str, frozenset[int]]] = {}
    for entry, group in entries.items():
        name = f"{entry.policy} ({entry.control_mode})"
        goals.setdefault(entry.task, {})[name] = frozenset(one.record.index for one in group)
    notes = []
    for task, played in goals.items():
        if len(set(played.values())) > 1:
            common = len(frozenset.intersection(*played.values()))
            parts = ", ".join(f"{name} on {len(indices)}" for name, indices in played.items())
            notes.append(f"on {task} policies were played on different goals ({parts}; {common} in common)")
    return notes
