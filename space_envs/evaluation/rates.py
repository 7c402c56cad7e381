"""How long episodes took on this machine, so that a dry run can say how long others will."""

import json
import math
from collections.abc import Iterable
from typing import Any

from space_envs.dynamics.c_library import LibraryError, cache_folder, private_folder
from space_envs.errors import ConfigurationError
from space_envs.evaluation.records import Entrant
from space_envs.evaluation.runner import Played
from space_envs.files import atomic_write_text
from space_envs.reading import read_object

FILE = "rates.json"


def record_rates(played: Iterable[Played]) -> None:
    """Remember the seconds of an episode on one core; where there is no place to, nothing is remembered."""
    rates = _read()
    for one in played:
        rates[_key(one.entrant)] = one.seconds / len(one.records)
    try:
        folder = private_folder(cache_folder())
        atomic_write_text(folder / FILE, json.dumps(rates, indent=1, sort_keys=True))
    except (LibraryError, OSError):
        return


def recorded_rate(entrant: Entrant) -> float | None:
    """Seconds of an episode of an entrant on one core, if any were played on this machine."""
    rate = _read().get(_key(entrant))
    return rate if isinstance(rate, float) and math.isfinite(rate) else None


def _key(entrant: Entrant) -> str:
    # A policy takes about as long on any split.
    return f"{entrant.task.env_id} {entrant.task.difficulty} {entrant.policy} {entrant.control_mode}"


def _read() -> dict[str, Any]:
    try:
        return read_object(cache_folder() / FILE)
    except (LibraryError, OSError, ConfigurationError):
        return {}
