"""Provenance of the results, as lists of the page."""

from collections.abc import Mapping, Sequence
from typing import Any

from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.records.names import counted, display_name
from space_envs.evaluation.results.result import EvaluationResult


def provenance_lists(result: EvaluationResult) -> dict[str, list[tuple[str, str]]]:
    """Rows of lists under their headings; the command stands by itself."""
    plain = {
        key: value for key, value in result.provenance.items() if key not in ("command", "configurations")
    }
    groups = {"Run": flat_rows({key: value for key, value in plain.items() if key != "versions"})}
    groups["Run"] += _timing(result.records)
    groups["Versions"] = flat_rows(plain.get("versions", {}))
    groups["Configurations"] = flat_rows(result.provenance.get("configurations", {}))
    return {title: rows for title, rows in groups.items() if rows}


def _timing(records: Sequence[EpisodeRecord]) -> list[tuple[str, str]]:
    """Processors on which planning time and time per action were measured."""
    timed = {(record.timing["processor"], record.timing["threads"]) for record in records}
    machines = [
        f"{processor}, {counted(threads, 'thread')}"
        for processor, threads in sorted(timed, key=str)
        if processor is not None and threads is not None
    ]
    return [("planning and action timed on", display_name("; ".join(machines), 1000))] if machines else []


def flat_rows(values: Mapping[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    """Nested plain values as rows of a list, such as `machine: processor` with its name."""
    flat: list[tuple[str, str]] = []
    for key, value in values.items():
        name = f"{prefix}{display_name(str(key)).replace('_', ' ')}"
        if isinstance(value, Mapping):
            flat += flat_rows(value, f"{name}: ")
        elif isinstance(value, (list, tuple)):
            flat.append((name, display_name(", ".join(map(str, value)), 1000)))
        else:
            flat.append((name, "-" if value is None else display_name(str(value), 1000)))
    return flat
