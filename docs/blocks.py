"""Blocks of the hand-written pages that come from the code, by the name in their marker."""

import inspect
from collections.abc import Callable
from dataclasses import fields
from functools import cached_property
from typing import Any, ClassVar, get_origin

from agents.planners.common.plans import Cause
from agents.planners.dual_arm.tracking import FINE, Tracking
from agents.policies.registry import POLICIES, control_mode, policies_for
from agents.policies.registry import knowledge as knowledge_of
from docs.reading import attributes, comments, number, summary, table
from docs.robots import links, planar_links, spatial_links
from docs.zoo import robot_pictures, robots
from space_envs import control, drives
from space_envs.evaluation.leaderboard.columns import COLUMNS, NOTE, RULES
from space_envs.evaluation.leaderboard.pareto import FRONT
from space_envs.evaluation.records.schema import record_schema
from space_envs.policy import Knowledge, Needs
from space_envs.registration import ENTRIES
from space_envs.tasks.base import CaptureTask


def environments() -> str:
    """Registered ids with links to their pages."""
    rows = [
        (f"[{env_id}](environments/{env_id.split('/')[-1]}.md)", entry.summary)
        for env_id, entry in ENTRIES.items()
    ]
    return table(("id", "task"), rows)


def policies() -> str:
    """Policies evaluated by `--policy all`, by id."""
    names = [env_id.partition("/")[2].rpartition("-")[0] for env_id in ENTRIES]
    rows = []
    for name, entry in POLICIES.items():
        fits = ["x" if name in policies_for(env_id) else "" for env_id in ENTRIES]
        rows.append((f"`{name}`", knowledge_of(name), f"`{control_mode(name)}`", *fits, entry.summary))
    return table(("policy", "knowledge", "control mode", *names, "method"), rows)


def drive() -> str:
    """Constants of the drives and control modes."""
    rows = [
        (f"`{module.__name__}.{name}`", number(getattr(module, name)), text)
        for module in (drives, control)
        for name, text in comments(module).items()
        if name.isupper() and not name.startswith("_")
    ]
    return table(("constant", "value", "meaning"), rows)


def causes() -> str:
    """Causes of a planner's failures."""
    meanings = comments(Cause)
    return table(("cause", "meaning"), [(f"`{cause}`", meanings[cause.name]) for cause in Cause])


def tracking() -> str:
    """Settings of tracking at torque level."""
    meanings, usual = attributes(Tracking), Tracking()
    rows = [
        (
            f"`{f.name}`",
            number(getattr(usual, f.name)),
            number(getattr(FINE, f.name)),
            meanings[f.name].rstrip("."),
        )
        for f in fields(Tracking)
    ]
    return table(("setting", "`Tracking()`", "`FINE`", "meaning"), rows)


def needs() -> str:
    """Capabilities that a policy can need."""
    meanings = attributes(Needs)
    rows = [(f"`{f.name}`", meanings[f.name].rstrip(".")) for f in fields(Needs)]
    return table(("field of `Needs`", "what it is"), rows)


def task_states() -> str:
    """Class variables that a task defines."""
    meanings = comments(CaptureTask)
    stated = {"split_sizes": "Number of goals of each split."}
    rows = []
    for name, kind in inspect.get_annotations(CaptureTask).items():
        if get_origin(kind) is ClassVar:
            text = stated[name] if name in stated else f"{meanings[name][:1].upper()}{meanings[name][1:]}."
            rows.append((f"`{name}`", text))
    return table(("class variable", "meaning"), rows)


def task_hooks() -> str:
    """Members that a task has to implement."""
    return _members(lambda source: "raise NotImplementedError" in source)


def task_members() -> str:
    """Members that the base class of all tasks implements."""
    return _members(lambda source: "raise NotImplementedError" not in source)


def _members(chosen: Callable[[str], bool]) -> str:
    rows = []
    for name, value in vars(CaptureTask).items():
        inner = value.func if isinstance(value, cached_property) else getattr(value, "fget", value)
        if name.startswith("_") or not (callable(value) or isinstance(value, property | cached_property)):
            continue
        if chosen(inspect.getsource(inner)):
            call = f"{name}{_arguments(inner)}" if callable(value) else name
            rows.append((f"`{call}`", summary(inner)))
    return table(("member", "meaning"), rows)


def _arguments(function: Callable[..., Any]) -> str:
    names = [name for name in inspect.signature(function).parameters if name != "self"]
    return f"({', '.join(names)})"


def columns() -> str:
    """The leaderboard's columns."""
    rows = [(column.title, column.unit, column.better or "", column.meaning) for column in COLUMNS]
    return "\n\n".join((table(("column", "unit", "better", "meaning"), rows), *RULES, NOTE))


def pareto_front() -> str:
    """Definition of the Pareto front."""
    return FRONT


def record_fields() -> str:
    """Fields of a record, from its JSON schema; those of the object `timing` behind it."""
    rows = []
    for name, about in record_schema()["properties"].items():
        inner = [(f"{name}.{each}", entry) for each, entry in about.get("properties", {}).items()]
        for field, entry in ((name, about), *inner):
            kind = entry.get("type", "string")
            rows.append(
                (f"`{field}`", " or ".join(kind) if isinstance(kind, list) else kind, entry["description"])
            )
    return table(("field", "type", "meaning"), rows)


def knowledge() -> str:
    """Kinds of knowledge that policies are made of."""
    meanings = comments(Knowledge)
    return table(("knowledge", "meaning"), [(f"`{kind}`", meanings[kind.name]) for kind in Knowledge])


def outcomes() -> str:
    """Outcomes of an episode."""
    return ", ".join(f"`{outcome}`" for outcome in record_schema()["properties"]["outcome"]["enum"]) + "."


BLOCKS: dict[str, Callable[[], str]] = {
    function.__name__.replace("_", "-"): function
    for function in (
        environments,
        policies,
        links,
        planar_links,
        spatial_links,
        drive,
        causes,
        tracking,
        needs,
        task_states,
        task_hooks,
        task_members,
        columns,
        pareto_front,
        record_fields,
        knowledge,
        outcomes,
        robots,
        robot_pictures,
    )
}
