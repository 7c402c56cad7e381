"""Plan of a sweep: which runs a file of values and seeds describes, all of them checked."""

import itertools
import re
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from agents.learning.runs.hyperparameters import AnyHyperparameters
from agents.learning.runs.settings import Settings, settle
from space_envs.errors import ConfigurationError, unknown_name
from space_envs.system.command_line import parse_seeds

MOST = 10_000  # runs of a sweep
_TABLES = ("seeds", "fixed", "values")


@dataclass(frozen=True)
class SweepRun:
    """One run of a sweep: the folder's name, what was swept (the seed among it), and what is trained."""

    name: str
    values: dict[str, Any]
    settings: Settings
    parameters: AnyHyperparameters
    messages: tuple[str, ...] = ()


@dataclass(frozen=True)
class SweepPlan:
    """A sweep file: seeds (None if it has none), options of all runs, and values whose product is trained."""

    seeds: tuple[int, ...] | None
    fixed: dict[str, Any]
    values: dict[str, list[Any]]


def read_toml(path: str | Path, kind: str) -> dict[str, Any]:
    """The tables of a TOML file.

    Raises:
        ConfigurationError: if it cannot be read, or is not TOML.
    """
    try:
        return tomllib.loads(Path(path).read_text(encoding="utf-8"))
    except OSError as error:
        raise ConfigurationError(f"the {kind} {path} cannot be read: {error.strerror}") from None
    except ValueError as error:
        raise ConfigurationError(f"the {kind} {path} is not TOML: {error}") from None


def read_plan(path: str | Path) -> SweepPlan:
    """Read a sweep file.

    Raises:
        ConfigurationError: if it cannot be read, is not TOML, or has other tables or kinds of values; names
            of options are checked where runs are made.
    """
    content = read_toml(path, "sweep file")
    for name in content:
        if name not in _TABLES:
            raise ConfigurationError(f"{path}: {unknown_name('table', name, _TABLES)}")
    fixed, values = (_options(path, name, content.get(name, {})) for name in _TABLES[1:])
    for name, several in values.items():
        if not isinstance(several, list) or not several:
            raise ConfigurationError(f"{path}: values of {name} must be a list, got {several!r}")
        _once(f"{path}: values of {name}", several)
        if name in fixed:
            raise ConfigurationError(f"{path}: {name} is fixed and has values; leave one out")
    return SweepPlan(_seeds(path, content.get("seeds")), fixed, values)


def _options(path: str | Path, name: str, table: Any) -> dict[str, Any]:
    if not isinstance(table, dict):
        raise ConfigurationError(f"{path}: {name} must be a table, [{name}], got {table!r}")
    if "seed" in table:
        raise ConfigurationError(f'{path}: seeds stand above the tables, like seeds = "0-4"')
    return table


def _seeds(path: str | Path, given: Any) -> tuple[int, ...] | None:
    if given is None:
        return None
    if isinstance(given, str):
        return parse_seeds(given)
    listed = given if isinstance(given, list) else [given]
    if not listed or not all(isinstance(seed, int) and not isinstance(seed, bool) for seed in listed):
        raise ConfigurationError(f'{path}: seeds must be text like "0-9" or whole numbers, got {given!r}')
    return _once("seeds", tuple(listed))


def make_runs(plan: SweepPlan, given: Mapping[str, Any]) -> list[SweepRun]:
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
    runs: dict[str, SweepRun] = {}
    for combination in itertools.product(*plan.values.values()):
        swept = dict(zip(plan.values, combination, strict=True))
        for seed in seeds:
            values = swept | {"seed": seed}
            settings, parameters, messages = settle({**given, **plan.fixed, **values})
            if settings.init is not None:  # a worker may be in another folder
                settings = replace(settings, init=str(Path(settings.init).resolve()))
            name = "_".join(f"{key}-{_short(value)}" for key, value in values.items())
            if name in runs:
                raise ConfigurationError(f"{runs[name].values} and {values} would share the folder {name}")
            runs[name] = SweepRun(name, values, settings, parameters, messages)
    return list(runs.values())


def _once(what: str, values: Any) -> Any:
    """The values, if none is there twice."""
    for index, value in enumerate(values):
        if value in values[:index]:
            raise ConfigurationError(f"{what}: {value!r} is there twice")
    return values


def _short(value: Any) -> str:
    """A value as a part of a folder's name."""
    if isinstance(value, dict):
        return "-".join(f"{key}-{_short(each)}" for key, each in value.items())
    text = "x".join(map(str, value)) if isinstance(value, list) else str(value).split("SpaceCapture/")[-1]
    return re.sub(r"[^\w.+-]+", "-", text)
