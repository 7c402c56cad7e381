"""Evaluations that survive being killed: units are played in any order, and kept as soon as they are done.

While an evaluation runs its folder holds run.json, which says what is played, and parts/, one file a unit.
What is finished is written to the folder by `collect`'s caller; then the parts are removed.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import perf_counter
from typing import Any

from joblib import delayed
from tqdm import tqdm

from space_envs.errors import ConfigurationError, PolicyError
from space_envs.evaluation.play.chunks import CHUNK, Part, Player, Unit, play, task_keywords, time_unit
from space_envs.evaluation.play.policy_process import TimeLimits
from space_envs.evaluation.play.rollout import Rollout, join, split_indices
from space_envs.evaluation.records.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.records.episode import RECORDS, SCHEMA_VERSION, SUMMARY, EpisodeRecord
from space_envs.evaluation.records.names import counted
from space_envs.evaluation.records.timing import UNTIMED, Timing
from space_envs.registration import make_task
from space_envs.system.files import atomic_write_text
from space_envs.system.output import remove_files
from space_envs.system.parallel import ProcessDiedError, backend, elsewhere
from space_envs.system.provenance import commit, processor, versions
from space_envs.system.reading import read_object

PLAN, PARTS = "run.json", "parts"
EVALUATION = "evaluation"  # kind of the folder
TIMED_EPISODES = 5
ROUNDS = 2  # of timing, apart in time: what else a machine does slows a policy down for seconds


@dataclass(frozen=True)
class Evaluation:
    """What is played.

    Attributes:
        entries: pairs of a task and a policy, in the order of the records.
        episodes: different goals of each split. seeds: of goals, policies and environments; each is a
            stratum of the intervals. variant: of the models, or None. limits: of the policies' calls, if any.
    """

    entries: tuple[tuple[EvaluatedTask, Player], ...]
    episodes: int
    seeds: tuple[int, ...]
    variant: str | None = None
    limits: TimeLimits | None = None

    def units(self) -> list[Unit]:
        """All units, in the order of the records.

        Raises:
            ConfigurationError: if a split has fewer goals, or a task cannot be made.
        """
        goals: dict[tuple[EvaluatedTask, int], Any] = {}
        for task in dict.fromkeys(task for task, _ in self.entries):
            made = make_task(task.env_id, task_keywords(task, self.variant))
            for seed in self.seeds:
                goals[task, seed] = split_indices(made, task.split, self.episodes, seed).tolist()
        return [
            Unit(
                player,
                task,
                self.variant,
                seed,
                first,
                tuple(goals[task, seed][first : first + CHUNK]),
                self.limits,
            )
            for task, player in self.entries
            for seed in self.seeds
            for first in range(0, self.episodes, CHUNK)
        ]

    def plan(self) -> dict[str, Any]:
        """What decides the records, as plain JSON values."""
        return {
            "schema": SCHEMA_VERSION,
            "entries": [[*asdict(task).values(), p.name, p.control_mode] for task, p in self.entries],
            "episodes": self.episodes,
            "seeds": list(self.seeds),
            "variant": self.variant,
            "limits": None if self.limits is None else asdict(self.limits),
            "commit": commit(),
            "versions": versions(),
        }


@dataclass(frozen=True, eq=False)
class Played:
    """All episodes of an entry, rows and records in one order: by seed, then by number of the episode."""

    entry: LeaderboardEntry
    variant: str | None
    records: tuple[EpisodeRecord, ...]
    rollout: Rollout
    pace: tuple[float, ...]  # s an episode, of each unit


def prepare(evaluation: Evaluation, folder: Path, resume: bool = False, overwrite: bool = False) -> bool:
    """Write down what is played, or check that the folder holds the same.

    Args:
        folder: that nobody else writes to (space_envs/system/output.py). resume: go on with what it holds.
        overwrite: replace what it holds; without either, it must hold no evaluation.

    Returns:
        Whether there is anything to do; not where the folder that is resumed holds all of it.

    Raises:
        ConfigurationError: if the folder cannot be written, or what it holds is something else.
    """
    plan, path = evaluation.plan(), folder / PLAN
    if not (resume or overwrite) and any((folder / name).exists() for name in (PLAN, PARTS, RECORDS)):
        raise ConfigurationError(
            f"{folder} holds an evaluation already: --resume goes on with it, --overwrite replaces it, or "
            "name another --output"
        )
    if resume:
        try:
            before = read_object(path)
        except FileNotFoundError:
            before = plan  # killed before it began
        except (OSError, ConfigurationError) as error:
            raise ConfigurationError(f"{path} cannot be read: {error}; --overwrite replaces it") from None
        if before != plan:
            names = [name for name in plan if before.get(name) != plan[name]]
            told = "; ".join(f"{name} was {before.get(name)}, is {plan[name]}" for name in names)
            raise ConfigurationError(f"{folder} holds another evaluation: {told}")
        if path.is_file() and (folder / SUMMARY).is_file() and not (folder / PARTS).is_dir():
            return False
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not resume:
            # First, since a plan without parts says that all of it was played.
            path.unlink(missing_ok=True)
            _remove_parts(folder)
        (folder / PARTS).mkdir(exist_ok=True)
        atomic_write_text(path, json.dumps(plan, indent=2) + "\n")
    except OSError as error:
        raise ConfigurationError(f"cannot write to {folder}: {error.strerror}") from None
    return True


def progress(folder: Path) -> str:
    """How far the evaluation in a folder is, in words."""
    done = len(list((folder / PARTS).glob("*.npz")))
    try:
        plan = read_object(folder / PLAN)
        total = len(plan["entries"]) * len(plan["seeds"]) * -(-plan["episodes"] // CHUNK)
    except (OSError, ConfigurationError, KeyError, TypeError):
        return f"{counted(done, 'chunk')} of {CHUNK} episodes evaluated"
    phase = "; timing" if done >= total else ""
    return f"{done} of {counted(total, 'chunk')} of {CHUNK} episodes evaluated{phase}"


def play_missing(
    units: Sequence[Unit], folder: Path, jobs: int, name: str = "loky", address: str | None = None
) -> None:
    """Play every unit that has no part yet, in parallel.

    If a policy ends the process that it plays in, what is left is played with policies in processes of their
    own, so that it loses the episodes in which it does so and nothing else is lost.

    Args:
        jobs, name, address: of the processes, as in `space_envs.system.parallel.backend`.

    Raises:
        PolicyError: if processes go on to die; what is done is kept.
    """
    for apart in (False, True):
        missing = [unit for unit in units if _kept(folder, unit) is None]
        if not missing:
            return
        total = sum(len(unit.indices) for unit in units)
        done = total - sum(len(unit.indices) for unit in missing)
        bar = tqdm(total=total, initial=done, unit="episode", desc="episodes", leave=False, smoothing=0.0)
        calls = (delayed(_played)(number, unit, apart) for number, unit in enumerate(missing))
        try:
            with bar, backend(min(jobs, len(missing)), name, address) as spread:
                for number, part in spread(calls):
                    part.save(_path(folder, missing[number]))
                    bar.update(len(missing[number].indices))
            return
        except ProcessDiedError as error:
            if apart:
                raise PolicyError(
                    f"a process died ({error}), and again with policies in processes of their own; is "
                    "the memory full? What is done is kept for --resume"
                ) from None


def _played(number: int, unit: Unit, apart: bool) -> tuple[int, Part]:
    return number, play(unit, apart)


def timings(
    units: Sequence[Unit], folder: Path
) -> tuple[dict[LeaderboardEntry, Timing], dict[LeaderboardEntry, float]]:
    """Planning time and time per action of each entry, one episode at a time on one thread.

    All are timed in turn, ROUNDS times, and the fastest round of each counts. A policy that raises, takes too
    long or ends its process where it is timed has none. Returns the times, and the seconds that it took to
    find them.
    """
    first = {unit.entry: unit for unit in reversed(units)}
    rounds: dict[LeaderboardEntry, list[Timing]] = {unit.entry: [] for unit in units}
    spent = dict.fromkeys(rounds, 0.0)
    turns = [(number, entry) for number in range(ROUNDS) for entry in rounds]
    for number, entry in tqdm(turns, unit="policy", desc="timing", leave=False):
        if UNTIMED in rounds[entry]:
            continue  # it may have taken all the time that it had
        unit = replace(first[entry], indices=first[entry].indices[:TIMED_EPISODES])
        path = folder / PARTS / f"{unit.key}-timing-{number}.json"
        if not path.exists():
            before = perf_counter()
            try:
                time = elsewhere(delayed(time_unit)(unit))
                made = Timing(
                    planning_ms=time.planning, action_ms=time.action, processor=processor(), threads=1
                )
            except (PolicyError, ProcessDiedError):
                made = UNTIMED
            atomic_write_text(path, json.dumps({"seconds": perf_counter() - before, "timing": made}))
        try:
            told = read_object(path)
            rounds[entry].append(Timing(**told["timing"]))
            spent[entry] += float(told["seconds"])
        except (OSError, ValueError, TypeError, KeyError) as error:
            raise ConfigurationError(f"{path} is damaged: {error}; remove it, then --resume") from None
    return {entry: fastest(told) for entry, told in rounds.items()}, spent


def fastest(rounds: Sequence[Timing]) -> Timing:
    """The smallest of each time; none where a round has none."""
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


def collect(units: Sequence[Unit], times: dict[LeaderboardEntry, Timing], folder: Path) -> Iterator[Played]:
    """The entries one after the other, in the order of the units.

    Raises:
        ConfigurationError: if a part has gone since it was played.
    """
    for entry in dict.fromkeys(unit.entry for unit in units):
        own = [unit for unit in units if unit.entry == entry]
        parts = [Part.load(_path(folder, unit), unit) for unit in own]
        records = [replace(r, timing=times[entry]) for part in parts for r in part.records]
        rollout = join([part.rollout for part in parts])
        pace = tuple(part.seconds / len(part.records) for part in parts)
        yield Played(entry, own[0].variant, tuple(records), rollout, pace)


def finish(folder: Path) -> None:
    """Remove the parts, once everything made of them is written."""
    _remove_parts(folder)


def _remove_parts(folder: Path) -> None:
    # What a kill left half-written has a name that begins with a dot.
    remove_files(folder / PARTS, "*.npz", "*.json", ".*.npz", ".*.json")


def _path(folder: Path, unit: Unit) -> Path:
    return folder / PARTS / f"{unit.key}.npz"


def _kept(folder: Path, unit: Unit) -> Part | None:
    path = _path(folder, unit)
    try:
        return Part.load(path, unit) if path.exists() else None
    except ConfigurationError:
        return None  # played again
