"""Durations of episodes, timing and reports on this machine, from which a dry run estimates others."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

from space_envs.codegen.cache import LibraryError, cache_folder, private_folder
from space_envs.errors import ConfigurationError
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.system.files import atomic_write_text
from space_envs.system.reading import read_object

FILE = "rates.json"
REPORT = "report"  # which takes as long for every entry: pictures, plots, tables


@dataclass(frozen=True)
class Seconds:
    """Estimated duration in s, and its range."""

    least: float
    usual: float
    most: float

    @classmethod
    def of(cls, values: Sequence[float]) -> Self:
        """Mean and range of some durations."""
        return cls(min(values), sum(values) / len(values), max(values))

    def __add__(self, other: "Seconds") -> "Seconds":
        return Seconds(self.least + other.least, self.usual + other.usual, self.most + other.most)

    def __mul__(self, factor: float) -> "Seconds":
        return Seconds(factor * self.least, factor * self.usual, factor * self.most)


def playing(entry: LeaderboardEntry) -> str:
    """Key of the duration of an entry's episode, which is about the same on every split."""
    return f"{entry.task.env_id} {entry.task.difficulty} {entry.policy} {entry.control_mode}"


def timing(entry: LeaderboardEntry) -> str:
    """Key of the duration of timing an entry."""
    return f"timing {playing(entry)}"


def remember(rates: Mapping[str, Seconds]) -> None:
    """Store durations by their keys; without a cache folder nothing is stored."""
    known = _read() | {name: [one.least, one.usual, one.most] for name, one in rates.items()}
    try:
        folder = private_folder(cache_folder())
        atomic_write_text(folder / FILE, json.dumps(known, indent=1, sort_keys=True))
    except (LibraryError, OSError):
        return


def recorded(name: str) -> Seconds | None:
    """Duration stored under a key; None if it was not measured on this machine."""
    rate = _read().get(name)
    if not isinstance(rate, list) or len(rate) != 3:
        return None
    known = all(isinstance(value, float) and math.isfinite(value) and value >= 0.0 for value in rate)
    return Seconds(*rate) if known else None


def _read() -> dict[str, Any]:
    try:
        return read_object(cache_folder() / FILE)
    except (LibraryError, OSError, ConfigurationError):
        return {}
