"""Record of an episode: task, policy and goal, outcome and metrics; and its form as a line of JSON.

The keys stand in the order of `EpisodeRecord`, those of its metrics in the order of `metrics_of`, floats as
Python's `repr`, so the same evaluation writes the same bytes. Everything a clock decides stands in the one
field `timing`.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, Self, get_type_hints

from space_envs.errors import ConfigurationError, unknown_name
from space_envs.evaluation.play.causes import check_cause
from space_envs.evaluation.play.entry import EvaluatedTask, LeaderboardEntry
from space_envs.evaluation.records.timing import Timing
from space_envs.evaluation.records.values import abbreviated, checked, checked_metrics, checked_timing
from space_envs.perturbations.amounts import NOMINAL, Perturbation
from space_envs.policy import Knowledge
from space_envs.system.digests import text_digest
from space_envs.tasks.goals.kinds import checked_kind

SCHEMA_VERSION = 4
RECORDS, SUMMARY, REPORT = "records.jsonl", "summary.json", "report.html"  # in a result folder


@dataclass(frozen=True)
class EpisodeRecord:
    """Record of one episode.

    Building one checks it: types, finite numbers, ranges, and that captured, outcome and metrics agree. NumPy
    scalars become Python's own. The checksum is of all fields but `timing` and itself; left empty, it is
    computed. Raises ConfigurationError that names the field.
    """

    schema: int  # SCHEMA_VERSION
    env_id: str
    robot: str  # name, with the variant where there are several
    robot_digest: str  # first twelve hexadecimal digits
    policy: str
    control_mode: str
    knowledge: str = field(default=Knowledge.UNSTATED.value, kw_only=True)  # one of Knowledge; as `goal`
    difficulty: str
    split: str
    goal: str = field(default="pose", kw_only=True)  # one of GOAL_KINDS; its key is absent for full poses
    perturbation: str = field(default=NOMINAL, kw_only=True)  # of the robot; its key is absent without one
    index: int  # of the goal in its split
    episode: int  # running number within this policy and seed
    seed: int  # evaluation seed: the stratum of the bootstrap
    config_hash: str
    task_version: int  # raised with every change that moves a score
    captured: bool
    outcome: str  # one of OUTCOMES
    cause: str | None  # one of CAUSES; None for a capture
    reason: str | None
    metrics: Mapping[str, float | int | None]  # by name; None where the episode has none
    timing: Timing
    checksum: str = ""  # sixteen hexadecimal digits

    def __post_init__(self) -> None:
        for name, kind in PLAIN.items():
            value = checked(name, getattr(self, name), kind, signed=False, empty=name in MAY_BE_EMPTY)
            object.__setattr__(self, name, value)
        object.__setattr__(self, "timing", checked_timing(self.timing))
        if self.schema != SCHEMA_VERSION:
            raise _other_schema(self.schema)
        checked_kind(self.goal)
        _check_perturbation(self.perturbation)
        if self.knowledge not in list(Knowledge):
            raise unknown_name("kind of knowledge", self.knowledge, list(Knowledge))
        check_cause(self.captured, self.outcome, self.cause)
        metrics = checked_metrics(self.metrics, self.env_id, self.captured, FIELDS)
        object.__setattr__(self, "metrics", metrics)
        checksum = self._digest()
        if self.checksum not in ("", checksum):
            raise ConfigurationError(
                f"checksum is {self.checksum} where the fields give {checksum}: the record was edited"
            )
        object.__setattr__(self, "checksum", checksum)

    @cached_property
    def entry(self) -> LeaderboardEntry:
        """Row of the leaderboard that this episode counts in."""
        goals = self.difficulty, self.split, self.goal, self.perturbation
        task = EvaluatedTask(self.env_id, self.robot, self.robot_digest, *goals)
        return LeaderboardEntry(task, self.policy, self.control_mode)

    @property
    def explanation(self) -> str | None:
        """Reason of a failure beyond its outcome: the cause of a missing plan and the sentence, if any."""
        cause = None if self.cause in (None, self.outcome) else self.cause.replace("_", " ")
        return ": ".join(part for part in (cause, self.reason) if part) or None

    def _digest(self) -> str:
        values = {name: v for name, v in self.to_dict().items() if name not in ("timing", "checksum")}
        return text_digest(json.dumps(values, allow_nan=False), 16)

    def to_json(self) -> str:
        """The record as one line of JSON, without a line end."""
        return json.dumps(self.to_dict(), allow_nan=False)

    def to_dict(self) -> dict[str, Any]:
        """Plain Python values, the metrics in the place of the field `metrics`."""
        values: dict[str, Any] = {}
        for name in FIELDS:
            values |= self.metrics if name == "metrics" else {name: getattr(self, name)}
        for name, usual in USUAL.items():
            if values[name] == usual:
                del values[name]
        values["timing"] = dict(self.timing)
        return values

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Self:
        """Build from a mapping that `to_dict` gave. Raises ConfigurationError."""
        if not isinstance(values, Mapping):
            raise ConfigurationError(
                f"expected an object with the fields of a record, got {abbreviated(values)}"
            )
        if type(version := values.get("schema")) is int and version != SCHEMA_VERSION:
            raise _other_schema(version)
        own = [name for name in FIELDS if name != "metrics"]
        if missing := [name for name in own if name not in values and name not in MAY_BE_ABSENT]:
            raise ConfigurationError(f"missing field {', '.join(missing)}")
        if values["checksum"] == "":
            raise ConfigurationError("checksum must not be empty")
        metrics = {name: value for name, value in values.items() if name not in own}
        return cls(metrics=metrics, **{name: values[name] for name in own if name in values})

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


def _check_perturbation(text: str) -> None:
    """ConfigurationError unless a perturbation is written as it writes itself."""
    written = Perturbation.of(text).text
    if text != written:
        raise ConfigurationError(f"perturbation is {text!r}, expected {written!r}")


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


_KINDS = get_type_hints(EpisodeRecord)
FIELDS = tuple(_KINDS)
PLAIN = {name: kind for name, kind in _KINDS.items() if name not in ("metrics", "timing")}
MAY_BE_EMPTY = ("reason", "checksum")  # of the texts
# Values whose keys are absent.
USUAL = {"goal": "pose", "perturbation": NOMINAL, "knowledge": Knowledge.UNSTATED.value}
MAY_BE_ABSENT = tuple(USUAL)
