"""Evaluations that can be interrupted: chunks are played in any order, and stored as soon as they are done.

While an evaluation runs its folder holds run.json, which says what is played, and chunks/, one file a chunk.
The caller of `collect` writes everything else to the folder and then removes the chunks.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from joblib import delayed
from tqdm import tqdm

from space_envs.errors import ConfigurationError, PolicyError
from space_envs.evaluation.harness.chunk_result import ChunkResult, evaluate_chunk
from space_envs.evaluation.harness.evaluation import Evaluated, Evaluation
from space_envs.evaluation.play.chunks import CHUNK, Chunk
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.play.episodes import concatenate
from space_envs.evaluation.records.episode import RECORDS, SUMMARY
from space_envs.evaluation.records.names import counted
from space_envs.evaluation.records.timing import Timing
from space_envs.system.files import write_json
from space_envs.system.output import remove_files
from space_envs.system.parallel import ProcessDiedError, backend
from space_envs.system.reading import read_object

EVALUATION = "evaluation"  # kind of the folder
PLAN, CHUNKS = "run.json", "chunks"


def prepare(evaluation: Evaluation, folder: Path, resume: bool = False, overwrite: bool = False) -> bool:
    """Write down what is played, or check that the folder holds the same.

    Args:
        folder: that nobody else writes to (space_envs/system/output.py). resume: continue what it holds.
        overwrite: replace what it holds; without either, it must hold no evaluation.

    Returns:
        Whether there is anything to do; not where the folder that is resumed holds all of it.

    Raises:
        ConfigurationError: if the folder cannot be written, or what it holds is something else.
    """
    plan, path = evaluation.plan(), folder / PLAN
    if not (resume or overwrite) and any((folder / name).exists() for name in (PLAN, CHUNKS, RECORDS)):
        raise ConfigurationError(
            f"{folder} holds an evaluation already: --resume goes on with it, --overwrite replaces it, or "
            "name another --output"
        )
    if resume:
        _check_same(plan, folder)
        if path.is_file() and (folder / SUMMARY).is_file() and not (folder / CHUNKS).is_dir():
            return False
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not resume:
            # First, since a plan without chunks says that all of it was played.
            path.unlink(missing_ok=True)
            finish(folder)
        (folder / CHUNKS).mkdir(exist_ok=True)
        write_json(path, plan)
    except OSError as error:
        raise ConfigurationError(f"cannot write to {folder}: {error.strerror}") from None
    return True


def _check_same(plan: dict[str, object], folder: Path) -> None:
    """Refuse to resume another evaluation than the one that a folder holds."""
    path = folder / PLAN
    try:
        before = read_object(path)
    except FileNotFoundError:
        return  # killed before it began
    except (OSError, ConfigurationError) as error:
        raise ConfigurationError(f"{path} cannot be read: {error}; --overwrite replaces it") from None
    differences = [
        f"{name} was {before.get(name)}, is {plan[name]}" for name in plan if before.get(name) != plan[name]
    ]
    if before != plan:
        raise ConfigurationError(f"{folder} holds another evaluation: {'; '.join(differences)}")


def progress(folder: Path) -> str:
    """Progress of the evaluation in a folder, in words."""
    done = len(list((folder / CHUNKS).glob("*.npz")))
    try:
        plan = read_object(folder / PLAN)
        total = len(plan["entries"]) * len(plan["seeds"]) * -(-plan["episodes"] // CHUNK)
    except (OSError, ConfigurationError, KeyError, TypeError):
        return f"{counted(done, 'chunk')} of {CHUNK} episodes evaluated"
    phase = "; timing" if done >= total else ""
    return f"{done} of {counted(total, 'chunk')} of {CHUNK} episodes evaluated{phase}"


def play_missing(
    chunks: Sequence[Chunk], folder: Path, jobs: int, name: str = "loky", address: str | None = None
) -> None:
    """Play every chunk that has no result yet, in parallel.

    If a policy ends the process that it plays in, the rest is played with policies in processes of their
    own, so that it loses the episodes in which it does so and nothing else is lost.

    Args:
        jobs, name, address: of the processes, as in `space_envs.system.parallel.backend`.

    Raises:
        PolicyError: if processes go on to die; what is done is kept.
    """
    for apart in (False, True):
        missing = [chunk for chunk in chunks if _kept(folder, chunk) is None]
        if not missing:
            return
        total = sum(len(chunk.indices) for chunk in chunks)
        done = total - sum(len(chunk.indices) for chunk in missing)
        bar = tqdm(total=total, initial=done, unit="episode", desc="episodes", leave=False, smoothing=0.0)
        calls = (delayed(_numbered)(number, chunk, apart) for number, chunk in enumerate(missing))
        try:
            with bar, backend(min(jobs, len(missing)), name, address) as spread:
                for number, result in spread(calls):
                    result.save(_path(folder, missing[number]))
                    bar.update(len(missing[number].indices))
            return
        except ProcessDiedError as error:
            if apart:
                raise PolicyError(
                    f"a process died ({error}), and again with policies in processes of their own; is "
                    "the memory full? What is done is kept for --resume"
                ) from None


def _numbered(number: int, chunk: Chunk, apart: bool) -> tuple[int, ChunkResult]:
    return number, evaluate_chunk(chunk, apart)


def collect(
    chunks: Sequence[Chunk], times: dict[LeaderboardEntry, Timing], folder: Path
) -> Iterator[Evaluated]:
    """Each policy on a task with all its episodes, in the order of the chunks.

    Raises:
        ConfigurationError: if a chunk's result has gone since it was played.
    """
    for entry in dict.fromkeys(chunk.entry for chunk in chunks):
        own = [chunk for chunk in chunks if chunk.entry == entry]
        results = [ChunkResult.load(_path(folder, chunk), chunk) for chunk in own]
        records = tuple(replace(r, timing=times[entry]) for result in results for r in result.records)
        episodes = concatenate([result.episodes for result in results])
        pace = tuple(result.seconds / len(result.records) for result in results)
        yield Evaluated(records, episodes, pace)


def finish(folder: Path) -> None:
    """Remove the results of chunks, once everything made of them is written."""
    # What a kill left half-written has a name that begins with a dot.
    remove_files(folder / CHUNKS, "*.npz", "*.json", ".*.npz", ".*.json")


def _path(folder: Path, chunk: Chunk) -> Path:
    return folder / CHUNKS / f"{chunk.key}.npz"


def _kept(folder: Path, chunk: Chunk) -> ChunkResult | None:
    path = _path(folder, chunk)
    try:
        return ChunkResult.load(path, chunk) if path.exists() else None
    except ConfigurationError:
        return None  # played again
