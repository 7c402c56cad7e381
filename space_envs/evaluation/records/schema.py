"""The published JSON schema of a record: one line of records.jsonl.

Types, names and ranges come from `EpisodeRecord` and the table of metrics, so that the schema cannot say
something else; what the other fields mean stands here. Four rules are beyond a schema and are checked where
records are read: the checksum is that of the fields, a whole number is written without a point, no key stands
twice, and metrics beyond those of every task are those of the id's own task.
"""

import json
from typing import Any, get_type_hints

from space_envs.evaluation.play.causes import CAUSES, OUTCOMES, causes_of
from space_envs.evaluation.records.episode import (
    FIELDS,
    MAY_BE_ABSENT,
    MAY_BE_EMPTY,
    PLAIN,
    SCHEMA_VERSION,
)
from space_envs.evaluation.records.metrics import METRICS
from space_envs.evaluation.records.timing import Timing
from space_envs.evaluation.records.values import plain_kind
from space_envs.metric import Metric
from space_envs.policy import Knowledge
from space_envs.tasks.goals.kinds import GOAL_KINDS

SCHEMA_ID = f"urn:space-capture:schema:record:{SCHEMA_VERSION}"
DESCRIPTIONS = {
    "schema": "Version of this schema.",
    "env_id": "Registered id, with its version.",
    "robot": "Name of the robot, with its variant where it has several.",
    "robot_digest": "First 12 hexadecimal digits of the SHA-256 of everything about the robot that is "
    "simulated; those of different robots are not compared.",
    "policy": "Name of the policy, any text.",
    "control_mode": "What the policy's actions are, such as joint_velocity.",
    "knowledge": "Knowledge that the policy is made of, where it states that.",
    "difficulty": "Size of the goal region.",
    "split": "Set of goals that the goal is from.",
    "goal": "What a capture asks of the end-effector, where that is not the grapple's whole pose: its "
    "position and approach axis, or its position.",
    "perturbation": "Differences between the simulated robot and its nominal model, and errors of what is "
    "observed, where there are any: a preset's name, or amounts as NAME=VALUE.",
    "index": "Number of the goal in its split.",
    "episode": "Running number within this policy and seed.",
    "seed": "Evaluation seed, of the goals played and of the policy; the stratum of the bootstrap.",
    "config_hash": "Changes with anything that defines the task, apart from its split; summary.json has the "
    "configuration itself.",
    "task_version": "Version of the task, raised with every change that moves a score; those of different "
    "versions are not compared.",
    "captured": "Whether the episode ended in a capture.",
    "outcome": "How the episode ended.",
    "cause": "Why it failed: without a plan the planner's cause, else the outcome; null for a capture.",
    "reason": "The cause in a sentence, where the policy or the harness says more.",
    "timing": "What a clock decided; not a part of the checksum.",
    "checksum": "First 16 hexadecimal digits of the SHA-256 of all fields but timing and itself, in their "
    "order, as Python's json.dumps writes them.",
    "planning_ms": "ms to make the plan, median over episodes played one at a time, in the faster of two "
    "rounds; null without a plan.",
    "action_ms": "ms to choose one action, likewise; null where nothing was timed.",
    "processor": "Name of the processor it was timed on.",
    "threads": "Number of threads it was timed with.",
}
_TYPES = {bool: "boolean", int: "integer", float: "number", str: "string"}


def record_schema() -> dict[str, Any]:
    """JSON schema (draft 2020-12) of one record, as plain values."""
    properties: dict[str, Any] = {}
    for name in FIELDS:
        if name == "metrics":
            properties |= {metric.name: _metric(metric) for metric in METRICS}
        elif name != "timing":
            properties[name] = _property(name, PLAIN[name], empty=name in MAY_BE_EMPTY)
        else:
            timing = {each: _property(each, kind) for each, kind in get_type_hints(Timing).items()}
            properties[name] = {**_object(timing), "description": DESCRIPTIONS[name]}
    properties["schema"] = {"const": SCHEMA_VERSION, **properties["schema"]}
    properties["outcome"] = {"enum": list(OUTCOMES), "description": DESCRIPTIONS["outcome"]}
    properties["goal"] = {"enum": list(GOAL_KINDS[1:]), "description": DESCRIPTIONS["goal"]}
    properties["knowledge"] = {"enum": list(Knowledge), "description": DESCRIPTIONS["knowledge"]}
    properties["cause"] = {"enum": [None, *CAUSES], "description": DESCRIPTIONS["cause"]}
    properties["checksum"] = {**properties["checksum"], "pattern": "^[0-9a-f]{16}$"}
    of_captures = [metric.name for metric in METRICS if metric.of_captures]
    numbers = {m.name: {"type": "number"} for m in METRICS if not (m.whole or m.optional)}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": SCHEMA_ID,
        "title": f"Record of an episode, version {SCHEMA_VERSION}",
        "description": "One line of records.jsonl. A quantity that does not exist for an episode is null.",
        **_object(properties),
        "additionalProperties": {"type": ["number", "null"], "description": "Metric of the task's own."},
        "if": {"properties": {"captured": {"const": True}}},
        "then": {"properties": {"outcome": {"const": "captured"}, "cause": {"type": "null"}, **numbers}},
        "else": {
            "properties": {name: {"type": "null"} for name in of_captures},
            "anyOf": [
                {"properties": {"outcome": {"const": outcome}, "cause": {"enum": list(causes_of(outcome))}}}
                for outcome in OUTCOMES[1:]
            ],
        },
    }


def schema_text() -> str:
    """The schema as the file that is published."""
    return json.dumps(record_schema(), indent=2) + "\n"


def _object(properties: dict[str, Any]) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": [name for name in properties if name not in MAY_BE_ABSENT],
        "additionalProperties": False,
    }


def _metric(metric: Metric) -> dict[str, Any]:
    kind: dict[str, Any] = {"type": "integer" if metric.whole else ["number", "null"]}
    return kind | ({} if metric.signed else {"minimum": 0}) | {"description": metric.description}


def _property(name: str, kind: Any, empty: bool = False) -> dict[str, Any]:
    """A field of the record or of its timing, none of whose numbers is negative."""
    kind, optional = plain_kind(kind)
    found: dict[str, Any] = {"type": [_TYPES[kind], "null"] if optional else _TYPES[kind]}
    if kind in (int, float):
        found["minimum"] = 0
    if kind is str and not empty:
        found["minLength"] = 1
    return {**found, "description": DESCRIPTIONS[name]}
