"""Check that result folders are of the same tasks; errors name the differences."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

from space_envs.errors import ConfigurationError
from space_envs.evaluation.results.folders import ResultFolder


@dataclass(frozen=True)
class _Use:
    """A configuration as a folder used it; `values` is None where the folder does not say what it is."""

    folder: str
    control_mode: str
    digest: str
    values: Mapping[str, Any] | None


def check_agreement(folders: Sequence[ResultFolder], separate: bool = False) -> None:
    """Check that records that would share a table are of one task, and that every folder shares one.

    Args:
        separate: accept a folder that shares no version, robot, difficulty, goal, split or perturbation with
            the others; its tasks become tables of their own.

    Raises:
        ConfigurationError: naming two folders and what differs between them, first of all their versions of
            the task.
    """
    _check_task_versions(folders)
    _check_metrics(folders)
    if not separate:
        _check_shared(folders)
    # Id, robot, difficulty, goal and perturbation -> configurations, by folder, control mode and hash.
    uses: dict[tuple[str, ...], dict[tuple[str, str, str], _Use]] = {}
    for folder in folders:
        for record in folder.records:
            key = (str(folder.path), record.control_mode, record.config_hash)
            use = _Use(*key, folder.configurations.get(record.config_hash))
            goals = record.difficulty, record.goal
            task = (record.env_id, record.robot_digest, *goals, record.perturbation)
            uses.setdefault(task, {})[key] = use
    for (env_id, _, difficulty, *_), known in uses.items():
        for one, other in combinations(known.values(), 2):
            if difference := _difference(one, other):
                raise ConfigurationError(
                    f"records of {env_id}, {difficulty}, cannot be compared, the tasks differ: {difference}"
                )


def _check_task_versions(folders: Sequence[ResultFolder]) -> None:
    """Refuse records of different versions of a task, also for tables of their own."""
    found: dict[str, dict[int, str]] = {}
    for folder in folders:
        for record in folder.records:
            found.setdefault(record.env_id, {}).setdefault(record.task_version, str(folder.path))
    for env_id, versions in found.items():
        if len(versions) > 1:
            parts = " and ".join(f"task version {version} in {name}" for version, name in versions.items())
            raise ConfigurationError(
                f"records of {env_id} are of {parts}: what is asked, or how it is scored, changed in "
                "between; evaluate the older again"
            )


def _check_metrics(folders: Sequence[ResultFolder]) -> None:
    """A task's own metrics must be the same numbers in every folder that describes them."""
    found: dict[str, tuple[str, Path]] = {}
    for folder in folders:
        for env_id, metrics in folder.described.items():
            names = ", ".join(f"{metric.name} [{metric.unit}]" for metric in metrics)
            first, path = found.setdefault(env_id, (names, folder.path))
            if first != names:
                raise ConfigurationError(
                    f"records of {env_id} have different metrics: {first} in {path} and {names} in "
                    f"{folder.path}"
                )


def _check_shared(folders: Sequence[ResultFolder]) -> None:
    """Every folder must share each of these figures of its ids with another folder."""
    # What is compared -> folder -> values that the folder has.
    levels: dict[tuple[str, str], dict[str, set[str]]] = {}
    for folder in folders:
        name = str(folder.path)
        for task in {record.entry.task for record in folder.records}:
            env_id, difficulty, split = task.env_id, task.difficulty, task.split
            base, version = _version(env_id)
            for about, value in (
                ((base, "version"), version),
                ((env_id, "robot"), f"{task.robot} ({task.robot_digest})"),
                ((env_id, "difficulty"), difficulty),
                ((env_id, "goal"), task.goal),
                ((env_id, "perturbation"), task.perturbation),
                ((f"{env_id}, {difficulty},", "split"), split),
            ):
                levels.setdefault(about, {}).setdefault(name, set()).add(value)
    for (what, kind), found in levels.items():
        for name, values in found.items():
            others = {other: theirs for other, theirs in found.items() if other != name}
            if others and not any(values & theirs for theirs in others.values()):
                parts = "; ".join(f"{other} has {', '.join(sorted(own))}" for other, own in others.items())
                raise ConfigurationError(
                    f"{what} differs in its {kind}: {name} has {', '.join(sorted(values))}; {parts}. Nothing "
                    "in it can be compared; with --separate each becomes a table of its own"
                )


def _version(env_id: str) -> tuple[str, str]:
    match = re.fullmatch(r"(.+)-(v\d+)", env_id)
    return (match[1], match[2]) if match else (env_id, "none")


def _difference(one: _Use, two: _Use) -> str:
    """Difference between two configurations apart from the control mode, in words; empty if they agree."""
    if one.digest == two.digest:
        return ""
    if one.values is None or two.values is None:
        if one.control_mode != two.control_mode:
            return ""  # that alone makes another hash
        silent = [use.folder for use in (one, two) if use.values is None]
        return (
            f"in {one.control_mode} the configuration has the hash {one.digest} in {one.folder} and "
            f"{two.digest} in {two.folder}; {' and '.join(silent)} does not say what it stands for"
        )
    first, second = _flat(one.values), _flat(two.values)
    parts = [
        f"{name} is {_shown(first, name)} in {one.folder} and {_shown(second, name)} in {two.folder}"
        for name in dict.fromkeys([*first, *second])
        if name != "control_mode" and _shown(first, name) != _shown(second, name)
    ]
    return "; ".join(parts)


def _flat(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    found: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            found |= _flat(value, f"{prefix}{name}.")
        else:
            found[f"{prefix}{name}"] = value
    return found


def _shown(values: Mapping[str, Any], name: str) -> str:
    return repr(values[name]) if name in values else "absent"
