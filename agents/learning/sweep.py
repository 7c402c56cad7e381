"""Many runs of one command: what they are, where they lie, and how they are spread over processes."""

import itertools
import json
import re
import threading
import tomllib
import traceback
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

from joblib import delayed

from agents.learning.hyperparameters import AnyHyperparameters
from agents.learning.options import Options
from agents.learning.runs import RunFolder, Settings
from agents.learning.seeds import parse_seeds
from space_envs.errors import ConfigurationError, SpaceEnvsError, unknown_name
from space_envs.system.files import atomic_write_text
from space_envs.system.parallel import backend

MOST = 10_000  # runs of a sweep
SUMMARY, ERROR = "sweep.json", "error.txt"
_UNDER_WAY = ".running"  # in a run's folder while a process works on it
_TABLES = ("seeds", "fixed", "values")
# Learning draws from the generators of its process, so two runs must not share them.
_ONE_IN_A_PROCESS = threading.Lock()


@dataclass(frozen=True)
class Run:
    """One run of a sweep: the folder's name, what was swept (the seed among it), and what is trained."""

    name: str
    values: dict[str, Any]
    settings: Settings
    parameters: AnyHyperparameters


@dataclass(frozen=True)
class RunResult:
    """How a run ended; `error` has the exception's type and message, `summary` what the run ended with."""

    name: str
    status: Literal["finished", "failed", "unfinished"]
    summary: dict[str, Any] | None = None
    error: str | None = None


@dataclass(frozen=True)
class Plan:
    """A sweep file: seeds (None if it has none), options of all runs, and values whose product is trained."""

    seeds: tuple[int, ...] | None
    fixed: dict[str, Any]
    values: dict[str, list[Any]]


def read_plan(path: str | Path) -> Plan:
    """Read a sweep file.

    Raises:
        ConfigurationError: if it cannot be read, is not TOML, or has other tables or kinds of values; names
            of options are checked where runs are made.
    """
    try:
        content = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(f"the sweep file {path} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ConfigurationError(f"the sweep file {path} is not TOML: {error}") from None
    for name in content:
        if name not in _TABLES:
            raise ConfigurationError(f"{path}: {unknown_name('table', name, _TABLES)}")
    fixed, values, seeds = content.get("fixed", {}), content.get("values", {}), content.get("seeds")
    for name, table in (("fixed", fixed), ("values", values)):
        if not isinstance(table, dict):
            raise ConfigurationError(f"{path}: {name} must be a table, [{name}], got {table!r}")
        if "seed" in table:
            raise ConfigurationError(f'{path}: seeds stand above the tables, like seeds = "0-4"')
    for name, several in values.items():
        if not isinstance(several, list) or not several:
            raise ConfigurationError(f"{path}: values of {name} must be a list, got {several!r}")
        _once(f"{path}: values of {name}", several)
        if name in fixed:
            raise ConfigurationError(f"{path}: {name} is fixed and has values; leave one out")
    if seeds is None:
        return Plan(None, fixed, values)
    if isinstance(seeds, str):
        return Plan(parse_seeds(seeds), fixed, values)
    listed = seeds if isinstance(seeds, list) else [seeds]
    if not listed or not all(isinstance(seed, int) and not isinstance(seed, bool) for seed in listed):
        raise ConfigurationError(f'{path}: seeds must be text like "0-9" or whole numbers, got {seeds!r}')
    return Plan(_once("seeds", tuple(listed)), fixed, values)


def make_runs(plan: Plan, given: Mapping[str, Any]) -> list[Run]:
    """All runs: every combination of values with every seed, all of them checked.

    Args:
        given: options of the command line, which hold for all runs.

    Raises:
        ConfigurationError, PolicyError: for anything in any of the runs that would fail later.
    """
    if twice := [name for name in given if name in plan.fixed | plan.values]:
        raise ConfigurationError(
            f"{twice[0]} is given in the sweep file and as --{twice[0].replace('_', '-')}; leave one out"
        )
    seeds = plan.seeds or (0,)
    count = len(seeds)
    for several in plan.values.values():
        count *= len(several)
    if count > MOST:
        raise ConfigurationError(f"the sweep has {count:,} runs; at most {MOST:,} are trained")
    runs: dict[str, Run] = {}
    for combination in itertools.product(*plan.values.values()):
        swept = dict(zip(plan.values, combination, strict=True))
        for seed in seeds:
            values = swept | {"seed": seed}
            settings, parameters = Options.named({**given, **plan.fixed, **values}).settle()
            if settings.init is not None:  # a worker may be in another folder
                settings = replace(settings, init=str(Path(settings.init).resolve()))
            name = "_".join(f"{key}-{_short(value)}" for key, value in values.items())
            if name in runs:
                raise ConfigurationError(f"{runs[name].values} and {values} would share the folder {name}")
            runs[name] = Run(name, values, settings, parameters)
    return list(runs.values())


def prepare(runs: Sequence[Run], output: Path, command: list[str]) -> list[RunResult]:
    """Make the folders of all runs, or find them as an earlier sitting left them; how each stands now.

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
            folder.begin(run.settings, run.parameters)
        folder.note_command(command)
        found.append(RunResult(run.name, "unfinished"))
    return found


def spread(
    folders: Sequence[Path], episodes: int, jobs: int, name: str = "loky", address: str | None = None
) -> Iterator[RunResult]:
    """Carry out the runs of these folders, `jobs` at a time; outcomes come in the order in which runs end.

    A process that dies takes the others of its pool along. What had begun then goes on one by one, so that
    only the run whose process dies alone is lost.

    Args:
        episodes: of a validation. jobs, name, address: of `space_envs.system.parallel.backend`.

    Raises:
        ConfigurationError: as `backend` says.
    """
    waiting = {folder.name: folder.resolve() for folder in folders}
    for folder in waiting.values():
        (folder / _UNDER_WAY).unlink(missing_ok=True)
    while waiting:
        try:
            calls = [delayed(_carry_out)(path, episodes) for path in waiting.values()]
            with backend(jobs, name, address) as parallel:
                for outcome in parallel(calls):
                    del waiting[outcome.name]
                    yield outcome
        except SpaceEnvsError:
            raise
        # What breaks a pool has a type of its own in each backend; a run's own errors are in its outcome.
        except Exception as error:
            begun = [path for path in waiting.values() if (path / _UNDER_WAY).exists()]
            if not begun:
                yield from (_lost(path, error) for path in waiting.values())
                return
            for path in begun:
                del waiting[path.name]
                yield _alone(path, episodes, name, address)


def write_summary(
    output: Path, command: list[str], runs: Sequence[Run], outcomes: Sequence[RunResult]
) -> None:
    """Write sweep.json, whole or not at all."""
    rows = [
        {"run": run.name, "values": run.values, **{k: v for k, v in asdict(outcome).items() if k != "name"}}
        for run, outcome in zip(runs, outcomes, strict=True)
    ]
    atomic_write_text(
        output / SUMMARY, json.dumps({"format": 1, "command": command, "runs": rows}, indent=2) + "\n"
    )


def _carry_out(path: Path, episodes: int) -> RunResult:
    """One run, from where it stands to its end; in whatever process this is called."""
    mark = path / _UNDER_WAY
    folder = RunFolder(path)
    try:
        with _ONE_IN_A_PROCESS:
            from agents.learning.training import learn  # torch takes seconds to import

            mark.touch()
            summary = folder.summary() or learn(folder, episodes, quiet=True)
        (path / ERROR).unlink(missing_ok=True)
    # Whatever a run raises is its own affair.
    except Exception as error:
        return _failed(path, error)
    finally:
        mark.unlink(missing_ok=True)
    return RunResult(path.name, "finished", summary)


def _alone(path: Path, episodes: int, name: str, address: str | None) -> RunResult:
    try:
        with backend(2, name, address) as parallel:  # joblib would do the work of one job in this process
            (outcome,) = parallel([delayed(_carry_out)(path, episodes)])
    except Exception as error:
        return _lost(path, error)
    return outcome


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


def _check_same(run: Run, folder: RunFolder) -> None:
    """Refuse to go on with a run that is another one."""
    settings, parameters = folder.restore()
    here, wanted = asdict(settings) | asdict(parameters), asdict(run.settings) | asdict(run.parameters)
    for name in wanted:
        if here.get(name) != wanted.get(name):
            raise ConfigurationError(
                f"{folder.path} holds a run with {name} {here.get(name)!r}, not {wanted.get(name)!r}; choose "
                "another --output"
            )


def _once(what: str, values: Any) -> Any:
    """The values, if none is there twice."""
    for index, value in enumerate(values):
        if value in values[:index]:
            raise ConfigurationError(f"{what}: {value!r} is there twice")
    return values


def _short(value: Any) -> str:
    """A value as a part of a folder's name."""
    text = "x".join(map(str, value)) if isinstance(value, list) else str(value).split("SpaceCapture/")[-1]
    return re.sub(r"[^\w.+-]+", "-", text)
