"""Planning time and time per action of each policy of an evaluation, stored until it is complete."""

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from time import perf_counter

from joblib import delayed
from tqdm import tqdm

from space_envs.errors import ConfigurationError, PolicyError
from space_envs.evaluation.harness.chunk_result import time_chunk
from space_envs.evaluation.harness.runner import CHUNKS
from space_envs.evaluation.play.chunks import Chunk
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.records.timing import UNTIMED, Timing
from space_envs.system.files import atomic_write_text
from space_envs.system.parallel import ProcessDiedError, elsewhere
from space_envs.system.provenance import processor
from space_envs.system.reading import read_object

TIMED_EPISODES = 5
ROUNDS = 2  # of timing, apart in time: what else a machine does slows a policy down for seconds


def policy_times(
    chunks: Sequence[Chunk], folder: Path
) -> tuple[dict[LeaderboardEntry, Timing], dict[LeaderboardEntry, float]]:
    """Planning time and time per action of each policy on a task, one episode at a time on one thread.

    All are timed in turn, ROUNDS times, and the fastest round of each counts. A policy that raises, takes too
    long or ends its process where it is timed has none.

    Returns:
        The times, and the seconds that it took to find them.
    """
    first = {chunk.entry: chunk for chunk in reversed(chunks)}
    rounds: dict[LeaderboardEntry, list[Timing]] = {chunk.entry: [] for chunk in chunks}
    spent = dict.fromkeys(rounds, 0.0)
    turns = [(number, entry) for number in range(ROUNDS) for entry in rounds]
    for number, entry in tqdm(turns, unit="policy", desc="timing", leave=False):
        if UNTIMED in rounds[entry]:
            continue  # it may have taken all the time that it had
        chunk = replace(first[entry], indices=first[entry].indices[:TIMED_EPISODES])
        timing, seconds = _kept(folder / CHUNKS / f"{chunk.key}-timing-{number}.json", chunk)
        rounds[entry].append(timing)
        spent[entry] += seconds
    return {entry: fastest(each) for entry, each in rounds.items()}, spent


def _kept(path: Path, chunk: Chunk) -> tuple[Timing, float]:
    """One round of a policy, read from its file where there is one, and the seconds that it took."""
    if not path.exists():
        before = perf_counter()
        timing = _timed(chunk)
        atomic_write_text(path, json.dumps({"seconds": perf_counter() - before, "timing": timing}))
    try:
        values = read_object(path)
        return Timing(**values["timing"]), float(values["seconds"])
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise ConfigurationError(f"{path} is damaged: {error}; remove it, then --resume") from None


def _timed(chunk: Chunk) -> Timing:
    try:
        time = elsewhere(delayed(time_chunk)(chunk))
    except (PolicyError, ProcessDiedError):
        return UNTIMED
    return Timing(planning_ms=time.planning, action_ms=time.action, processor=processor(), threads=1)


def fastest(rounds: Sequence[Timing]) -> Timing:
    """Least planning time and least time per action of several rounds; none where a round has none."""
    planning = [one["planning_ms"] for one in rounds if one["planning_ms"] is not None]
    action = [one["action_ms"] for one in rounds if one["action_ms"] is not None]
    if len(action) < len(rounds):
        return UNTIMED
    return Timing(
        planning_ms=min(planning) if len(planning) == len(rounds) else None,
        action_ms=min(action),
        processor=rounds[-1]["processor"],
        threads=rounds[-1]["threads"],
    )
