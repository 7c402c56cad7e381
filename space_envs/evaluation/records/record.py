"""What an evaluation leaves behind: one record an episode, traces, and everything a report is made from.

Records are JSON lines with the keys always in the order of `EpisodeRecord`, floats as Python's `repr`, so the
same evaluation writes the same bytes. Everything a clock decides stands in the one field `timing`.
"""

import dataclasses
import hashlib
import json
import math
import types
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Self, TypedDict, Union, get_args, get_origin, get_type_hints

import numpy as np

from space_envs.errors import ConfigurationError, unknown_name
from space_envs.evaluation.replay.replay import Replay
from space_envs.evaluation.replay.states import States
from space_envs.evaluation.replay.traces import Traces
from space_envs.evaluation.report.stills import Still
from space_envs.system.files import atomic_write_text
from space_envs.system.reading import read_bytes
from space_envs.tasks.outcome import ENDED, Outcome

SCHEMA_VERSION = 3
RECORDS, SUMMARY, REPORT = "records.jsonl", "summary.json", "report.html"  # in a result folder
OUTCOMES = tuple(outcome.value for outcome in ENDED)
# Why a policy has no plan; the last is for policies that give no cause, or another one.
NO_PLAN_CAUSES = (
    "infeasible",
    "singular",
    "joint_limit",
    "out_of_reach",
    "clearance",
    "solver",
    "inaccurate",
    "no_plan",
)
CAUSES = (
    *NO_PLAN_CAUSES,
    *OUTCOMES[1:],
)  # of a failed episode: without a plan that is why, else how it ended
# Outcomes that a missing plan does not explain.
OWN_CAUSES = (Outcome.DIVERGED.value, Outcome.POLICY_ERROR.value)


class Timing(TypedDict):
    """Milliseconds: to make the plan (None where the policy makes none) and for each action (median).

    Measured one episode at a time, apart from the episodes that are counted, on the processor and with the
    number of threads that are named (None where nothing was timed).
    """

    planning_ms: float | None
    action_ms: float | None
    processor: str | None
    threads: int | None


UNTIMED = Timing(planning_ms=None, action_ms=None, processor=None, threads=None)


@dataclass(frozen=True, order=True)
class Task:
    """What was asked: records of different tasks never share a row or a table."""

    env_id: str
    difficulty: str
    split: str

    def __str__(self) -> str:
        return f"{self.env_id}, {self.difficulty}, {self.split} split"


@dataclass(frozen=True, order=True)
class Entrant:
    """What one row of a leaderboard is about: a policy in a control mode on a task."""

    task: Task
    policy: str
    control_mode: str


@dataclass(frozen=True)
class EpisodeRecord:
    """One episode. A quantity that does not exist for it (a simulation that diverged at once) is None.

    Building one checks it: types, finite numbers, ranges, and that captured, outcome and time_to_capture
    agree. NumPy scalars become Python's own. The checksum is of all fields but `timing` and itself; left
    empty, it is computed. Raises ConfigurationError that names the field.
    """

    schema: int  # SCHEMA_VERSION
    env_id: str
    policy: str
    control_mode: str
    difficulty: str
    split: str
    index: int  # of the goal in its split
    episode: int  # running number within this policy and seed
    seed: int  # evaluation seed: the stratum of the bootstrap
    config_hash: str
    task_version: int  # raised with every change that moves a score
    captured: bool
    outcome: str  # one of OUTCOMES
    cause: str | None  # one of CAUSES; None for a capture
    reason: str | None
    time_to_capture: float | None  # s
    time_to_envelope: float | None  # s, the same without the time for which the envelope is held
    steps: int
    episode_return: float | None
    position_error: float | None  # m, at the end: for a capture, at the capture
    orientation_error: float | None  # deg, likewise
    peak_attitude: float | None  # deg
    final_attitude: float | None  # deg
    attitude_cost: float | None  # m^2/s, shyam2020 eq. 20 times dt
    base_angular_impulse: float | None  # N m s
    kinetic_energy_integral: float | None  # J s, shah2013's C
    mechanical_work: float | None  # J
    peak_power: float | None  # W
    collisions: int
    clipped_actions: int
    linear_momentum_drift: float | None  # N s, the largest
    angular_momentum_drift: float | None  # N m s, the largest
    timing: Timing
    checksum: str = ""  # sixteen hexadecimal digits

    def __post_init__(self) -> None:
        for name, kind in _KINDS.items():
            object.__setattr__(self, name, _checked(name, getattr(self, name), kind))
        object.__setattr__(self, "timing", _checked_timing(self.timing))
        if self.schema != SCHEMA_VERSION:
            raise _other_schema(self.schema)
        if self.outcome not in OUTCOMES:
            raise unknown_name("outcome", self.outcome, OUTCOMES)
        if self.captured != (self.outcome == Outcome.CAPTURED):
            raise ConfigurationError(f"captured is {self.captured} but outcome is {self.outcome!r}")
        _check_cause(self.outcome, self.cause)
        for name in TIMES:
            if self.captured != (getattr(self, name) is not None):
                raise ConfigurationError(
                    f"captured is {self.captured} but {name} is {getattr(self, name)}; "
                    "a captured episode has a time, any other has none"
                )
        if self.captured:
            missing = [name for name in NONNEGATIVE if getattr(self, name) is None]
            if missing:
                raise ConfigurationError(f"a captured episode lacks {', '.join(missing)}")
        checksum = self._digest()
        if self.checksum not in ("", checksum):
            raise ConfigurationError(
                f"checksum is {self.checksum} where the fields give {checksum}: the record was edited"
            )
        object.__setattr__(self, "checksum", checksum)

    @property
    def entrant(self) -> Entrant:
        """The row that this episode counts in."""
        return Entrant(Task(self.env_id, self.difficulty, self.split), self.policy, self.control_mode)

    @property
    def explanation(self) -> str | None:
        """Why it failed, beyond its outcome: the cause of a missing plan and the sentence, if there are."""
        cause = None if self.cause in (None, self.outcome) else self.cause.replace("_", " ")
        return ": ".join(part for part in (cause, self.reason) if part) or None

    def _digest(self) -> str:
        values = {name: getattr(self, name) for name in _NAMES if name not in ("timing", "checksum")}
        return hashlib.sha256(json.dumps(values, allow_nan=False).encode()).hexdigest()[:16]

    def to_json(self) -> str:
        """One line without its end, keys in the order of the fields."""
        return json.dumps(self.to_dict(), allow_nan=False)

    def to_dict(self) -> dict[str, Any]:
        """Plain Python values, keys in the order of the fields."""
        values = {name: getattr(self, name) for name in _NAMES}
        values["timing"] = dict(self.timing)
        return values

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Build from a mapping that has exactly the fields. Raises ConfigurationError."""
        if not isinstance(values, Mapping):
            raise ConfigurationError(f"expected an object with the fields of a record, got {_shown(values)}")
        if type(version := values.get("schema")) is int and version != SCHEMA_VERSION:
            raise _other_schema(version)
        for name in values:
            if name not in _NAMES:
                raise unknown_name("field", name, _NAMES)
        missing = [name for name in _NAMES if name not in values]
        if missing:
            raise ConfigurationError(f"missing field {', '.join(missing)}")
        if values["checksum"] == "":
            raise ConfigurationError("checksum must not be empty")
        return cls(**values)

    @classmethod
    def from_json(cls, line: str) -> Self:
        """Parse one line. NaN, infinity and repeated keys are refused. Raises ConfigurationError."""
        try:
            values = json.loads(line, parse_constant=_refuse_constant, object_pairs_hook=_unique)
        except ConfigurationError:
            raise
        except RecursionError:
            raise ConfigurationError("not a JSON object: nested too deeply") from None
        except ValueError as error:
            raise ConfigurationError(f"not a JSON object: {error}") from error
        return cls.from_dict(values)


@dataclass(frozen=True)
class EvaluationResult:
    """All that `write_report` needs, for one run of `evaluate.py`.

    `provenance` is shown in the report as it is: `command`, `versions`, `machine`, `commit`, ... What a clock
    or the machine's load decides goes under its key `timing`, so that the rest repeats byte for byte.
    `pictures` holds stills of a capture for each entrant, in order of time; where it is empty,
    `pictures_note` says why in one sentence. `replays` holds the best, the median and the worst
    episode of each, `states` the recorded states of all. `experts` are the names of policies among which the
    best has the normalised score 1.
    """

    records: Sequence[EpisodeRecord]
    traces: Mapping[Entrant, Traces] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    pictures: Mapping[Entrant, Sequence[Still]] = field(default_factory=dict)
    pictures_note: str = ""
    replays: Mapping[Entrant, Sequence[Replay]] = field(default_factory=dict)
    states: Mapping[Entrant, States] = field(default_factory=dict)
    experts: Collection[str] = ()


def write_records(path: str | Path, records: Iterable[EpisodeRecord]) -> None:
    """Write one JSON line for each record; a reader sees the whole file or none of it."""
    atomic_write_text(path, "".join(record.to_json() + "\n" for record in records))


def read_records(path: str | Path) -> list[EpisodeRecord]:
    """Read a file of JSON lines. Raises ConfigurationError that names file, line and mistake."""
    path = Path(path)
    try:
        # Bytes are split at line feeds alone: str.splitlines also splits at U+2028, which JSON allows.
        lines = read_bytes(path).split(b"\n")
    except (OSError, ConfigurationError) as error:
        raise ConfigurationError(f"{path}: cannot be read: {error}") from error
    if lines[-1] != b"":
        raise ConfigurationError(f"{path}:{len(lines)}: the last line has no end; the file was cut short")
    records = []
    for number, line in enumerate(lines[:-1], start=1):
        try:
            records.append(EpisodeRecord.from_json(line.decode("utf-8")))
        except (ConfigurationError, UnicodeDecodeError) as error:
            raise ConfigurationError(f"{path}:{number}: {error}") from error
    return records


def records_without_timing(records: Iterable[EpisodeRecord]) -> list[dict[str, Any]]:
    """The records as plain dictionaries without `timing`: what two runs of one seed must have in common."""
    plain = [record.to_dict() for record in records]
    for values in plain:
        del values["timing"]
    return plain


def _checked(name: str, value: Any, kind: Any) -> Any:
    if isinstance(value, np.generic):
        value = value.item()
    if get_origin(kind) in (types.UnionType, Union):
        if value is None:
            return None
        (kind,) = (option for option in get_args(kind) if option is not types.NoneType)
    if kind is float and type(value) is int:
        value = float(value)
    if type(value) is not kind:
        raise ConfigurationError(f"{name} must be {kind.__name__}, got {_shown(value)}")
    if kind is float and not math.isfinite(value):
        raise ConfigurationError(f"{name} must be finite, got {value}; a value that does not exist is null")
    if (kind is int or name in (*NONNEGATIVE, *TIMES)) and value < 0:
        raise ConfigurationError(f"{name} must not be negative, got {value}")
    if kind is str and name not in ("reason", "checksum") and not value:
        raise ConfigurationError(f"{name} must not be empty")
    return value


def causes_of(outcome: str) -> tuple[str, ...]:
    """Causes that a failed episode may have which ended so."""
    return (outcome,) if outcome in OWN_CAUSES else (outcome, *NO_PLAN_CAUSES)


def _check_cause(outcome: str, cause: str | None) -> None:
    if outcome == Outcome.CAPTURED:
        if cause is not None:
            raise ConfigurationError(f"cause is {cause!r} but the episode captured; a capture has none")
    elif cause not in causes_of(outcome):
        raise unknown_name(f"cause of outcome {outcome!r}:", cause, causes_of(outcome))


def _checked_timing(value: Any) -> Timing:
    keys = tuple(get_type_hints(Timing))
    if not isinstance(value, Mapping) or set(value) != set(keys):
        raise ConfigurationError(f"timing must have exactly {', '.join(keys)}, got {_shown(value)}")
    kinds = get_type_hints(Timing)
    checked = {key: _checked(f"timing.{key}", value[key], kinds[key]) for key in keys}
    for key in ("planning_ms", "action_ms"):
        if checked[key] is not None and checked[key] < 0:
            raise ConfigurationError(f"timing.{key} must not be negative, got {checked[key]}")
    return Timing(**checked)


def _other_schema(version: int) -> ConfigurationError:
    return ConfigurationError(
        f"schema is {version}; this version reads schema {SCHEMA_VERSION}: evaluate again with it"
    )


def _refuse_constant(name: str) -> None:
    raise ConfigurationError(f"{name} is not a JSON number; a value that does not exist is null")


def _unique(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values = dict(pairs)
    if len(values) != len(pairs):
        raise ConfigurationError("a key stands twice in one object")
    return values


def _shown(value: Any) -> str:
    text = repr(value)
    return text if len(text) <= 80 else text[:77] + "..."


_NAMES = tuple(item.name for item in dataclasses.fields(EpisodeRecord))
_KINDS = {name: kind for name, kind in get_type_hints(EpisodeRecord).items() if name != "timing"}
TIMES = ("time_to_capture", "time_to_envelope")  # of captures alone
NONNEGATIVE = (
    "position_error",
    "orientation_error",
    "peak_attitude",
    "final_attitude",
    "attitude_cost",
    "base_angular_impulse",
    "kinetic_energy_integral",
    "peak_power",
    "linear_momentum_drift",
    "angular_momentum_drift",
)
