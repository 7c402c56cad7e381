"""The published JSON schema of a record: one line of records.jsonl.

Types, names and ranges come from `EpisodeRecord`, so that the schema cannot say something else; what a field
means stands here. Three rules are beyond a schema and are checked where records are read: the checksum is
that of the fields, a whole number is written without a point, and no key stands twice.
"""

import dataclasses
import json
import types
from typing import Any, Union, get_args, get_origin, get_type_hints

from space_envs.evaluation.records.record import (
    CAUSES,
    NONNEGATIVE,
    OUTCOMES,
    SCHEMA_VERSION,
    TIMES,
    EpisodeRecord,
    Timing,
    causes_of,
)

SCHEMA_ID = f"urn:space-capture:schema:record:{SCHEMA_VERSION}"
DESCRIPTIONS = {
    "schema": "Version of this schema.",
    "env_id": "Registered id, with its version.",
    "policy": "Name of the policy, any text.",
    "control_mode": "What the policy's actions are, such as joint_velocity.",
    "difficulty": "Size of the goal region.",
    "split": "Set of goals that the goal is from.",
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
    "time_to_capture": "s; null without a capture.",
    "time_to_envelope": "s, until the envelope was entered for good: time_to_capture without the time for "
    "which it is held.",
    "steps": "Control steps until the end.",
    "episode_return": "Sum of the rewards.",
    "position_error": "m, when the episode ended: for a capture, at the capture, not where it settles later.",
    "orientation_error": "deg, likewise.",
    "peak_attitude": "deg, largest angle of the base from where it started, at any step of the simulation.",
    "final_attitude": "deg, angle of the base from where it started, at the end.",
    "attitude_cost": "m^2/s, eq. 20 of shyam2020 times the control period: a sum over control periods.",
    "base_angular_impulse": "N m s, total variation of the base's angular momentum about its centre of mass, "
    "over the steps of the simulation.",
    "kinetic_energy_integral": "J s, integral of twice the kinetic energy: C of shah2013.",
    "mechanical_work": "J, sum over joints and steps of the simulation of |torque times angle|.",
    "peak_power": "W, largest sum over joints of |torque times rate|, at any step of the simulation.",
    "collisions": "How often the robot touched what it must not; the first ends the episode.",
    "clipped_actions": "Steps whose action lay outside [-1, 1].",
    "linear_momentum_drift": "N s, largest change of the robot's total linear momentum since the start.",
    "angular_momentum_drift": "N m s, largest change of the robot's total angular momentum since the start.",
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
    timing = get_type_hints(Timing)
    properties = {name: _property(name, kind) for name, kind in get_type_hints(EpisodeRecord).items()}
    properties["schema"] = {"const": SCHEMA_VERSION, **properties["schema"]}
    properties["outcome"] = {"enum": list(OUTCOMES), "description": DESCRIPTIONS["outcome"]}
    properties["cause"] = {"enum": [None, *CAUSES], "description": DESCRIPTIONS["cause"]}
    properties["checksum"] = {**properties["checksum"], "pattern": "^[0-9a-f]{16}$"}
    properties["timing"] = {
        **_object({name: _property(name, kind) for name, kind in timing.items()}),
        "description": DESCRIPTIONS["timing"],
    }
    captured = {"captured": {"const": True}}
    numbers = {name: {"type": "number"} for name in (*TIMES, *NONNEGATIVE)}
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": SCHEMA_ID,
        "title": f"Record of an episode, version {SCHEMA_VERSION}",
        "description": "One line of records.jsonl. A quantity that does not exist for an episode is null.",
        **_object({item.name: properties[item.name] for item in dataclasses.fields(EpisodeRecord)}),
        "if": {"properties": captured},
        "then": {"properties": {"outcome": {"const": "captured"}, "cause": {"type": "null"}, **numbers}},
        "else": {
            "properties": {name: {"type": "null"} for name in TIMES},
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
        "required": list(properties),
        "additionalProperties": False,
    }


def _property(name: str, kind: Any) -> dict[str, Any]:
    optional = get_origin(kind) in (types.UnionType, Union)
    if optional:
        (kind,) = (option for option in get_args(kind) if option is not types.NoneType)
    if kind not in _TYPES:  # an object, described by the caller
        return {}
    found: dict[str, Any] = {"type": [_TYPES[kind], "null"] if optional else _TYPES[kind]}
    if kind is int or name in (*NONNEGATIVE, *TIMES, *get_type_hints(Timing)) and kind is float:
        found["minimum"] = 0
    if kind is str and name not in ("reason", "checksum"):
        found["minLength"] = 1
    return {**found, "description": DESCRIPTIONS[name]}
