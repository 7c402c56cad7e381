"""Runs of a sweep spread over processes: their folders, the result of each, failures contained."""

import threading
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from joblib import delayed

from agents.learning.runs.folder import RunFolder
from agents.learning.sweeps.plan import SweepRun
from space_envs.errors import ConfigurationError, SpaceEnvsError
from space_envs.system.files import atomic_write_text, write_json
from space_envs.system.parallel import backend

SUMMARY, ERROR = "sweep.json", "error.txt"
_UNDER_WAY = ".running"  # in a run's folder while a process works on it
# Learning draws from the generators of its process, so two runs must not share them.
_ONE_IN_A_PROCESS = threading.Lock()


@dataclass(frozen=True)
class RunResult:
    """Status of a run; `error` has the exception's type and message, `summary` that of a finished run."""

    name: str
    status: Literal["finished", "failed", "unfinished"]
    summary: dict[str, Any] | None = None
    error: str | None = None


def prepare(runs: Sequence[SweepRun], output: Path, command: list[str]) -> list[RunResult]:
    """Make the folders of all runs, or find those of an earlier command; returns the status of each.

    Raises:
        ConfigurationError: if a folder cannot be made, or holds a run of other settings.
    """
    if RunFolder(output).exists():
        raise ConfigurationError(f"{output} holds a single run; choose another --output for several")
    folders = [(run, RunFolder(output / run.name)) for run in runs]
    for run, folder in folders:
        if folder.exists():
            _check_same(run, folder)
    found = []
    for run, folder in folders:
        summary = folder.summary() if folder.exists() else None
        if summary is not None:
            found.append(RunResult(run.name, "finished", summary))
            continue
        if not folder.exists():
            folder.create(run.settings, run.parameters)
        folder.note_command(command)
        found.append(RunResult(run.name, "unfinished"))
    return found


def spread(
    folders: Sequence[Path], episodes: int | None, jobs: int, name: str = "loky", address: str | None = None
) -> Iterator[RunResult]:
    """Carry out the runs of these folders, `jobs` at a time; results come in the order in which runs end.

    A process that dies takes the others of its pool along. Runs that had started are then continued one by
    one, so that only the run whose process dies alone is lost.

    Args:
        episodes: of a validation. jobs, name, address: of `space_envs.system.parallel.backend`.

    Raises:
        ConfigurationError: as in `backend`.
    """
    waiting = {folder.name: folder.resolve() for folder in folders}
    for folder in waiting.values():
        (folder / _UNDER_WAY).unlink(missing_ok=True)
    while waiting:
        try:
            calls = [delayed(_carry_out)(path, episodes) for path in waiting.values()]
            with backend(jobs, name, address) as parallel:
                for result in parallel(calls):
                    del waiting[result.name]
                    yield result
        except SpaceEnvsError:
            raise
        # A broken pool raises another type in each backend; errors of a run are in its result.
        except Exception as error:
            started = [path for path in waiting.values() if (path / _UNDER_WAY).exists()]
            if not started:
                yield from (_lost(path, error) for path in waiting.values())
                return
            for path in started:
                del waiting[path.name]
                yield _alone(path, episodes, name, address)


def write_summary(
    output: Path, command: list[str], runs: Sequence[SweepRun], results: Sequence[RunResult]
) -> None:
    """Write sweep.json, whole or not at all."""
    rows = [
        {"run": run.name, "values": run.values, **{k: v for k, v in asdict(result).items() if k != "name"}}
        for run, result in zip(runs, results, strict=True)
    ]
    write_json(output / SUMMARY, {"format": 1, "command": command, "runs": rows})


def _carry_out(path: Path, episodes: int | None) -> RunResult:
    """Train one run to its end, in whatever process this is called."""
    mark = path / _UNDER_WAY
    folder = RunFolder(path)
    try:
        with _ONE_IN_A_PROCESS:
            from agents.learning.training import learn  # torch takes seconds to import

            mark.touch()
            summary = folder.summary() or learn(folder, episodes, quiet=True)
        (path / ERROR).unlink(missing_ok=True)
    # A run may raise anything; the others go on.
    except Exception as error:
        return _failed(path, error)
    finally:
        mark.unlink(missing_ok=True)
    return RunResult(path.name, "finished", summary)


def _alone(path: Path, episodes: int | None, name: str, address: str | None) -> RunResult:
    try:
        with backend(2, name, address) as parallel:  # joblib would do the work of one job in this process
            (result,) = parallel([delayed(_carry_out)(path, episodes)])
    except Exception as error:
        return _lost(path, error)
    return result


def _lost(path: Path, error: Exception) -> RunResult:
    (path / _UNDER_WAY).unlink(missing_ok=True)
    return _failed(path, error, "its process died, or could not be started: ")


def _failed(path: Path, error: Exception, cause: str = "") -> RunResult:
    text = cause + "".join(traceback.format_exception(error))
    try:
        atomic_write_text(path / ERROR, text)
    except OSError:  # a full disk may be why it failed
        pass
    first = (str(error).strip().splitlines() or [""])[0]
    return RunResult(path.name, "failed", error=f"{cause}{type(error).__name__}: {first}".rstrip(": "))


def _check_same(run: SweepRun, folder: RunFolder) -> None:
    """Refuse to continue a run that has other settings."""
    settings, parameters = folder.restore()
    here, expected = asdict(settings) | asdict(parameters), asdict(run.settings) | asdict(run.parameters)
    for name in expected:
        if here.get(name) != expected.get(name):
            raise ConfigurationError(
                f"{folder.path} holds a run with {name} {here.get(name)!r}, not {expected[name]!r}; choose "
                "another --output"
            )
