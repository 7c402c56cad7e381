"""Blocks of the hand-written pages that come from the code, by the name in their marker."""

import inspect
from collections.abc import Callable
from dataclasses import fields
from functools import cached_property
from math import pi
from typing import Any

from agents.registry import POLICIES, policies_for
from docs.reading import comments, number, summary, table
from space_envs import control
from space_envs.evaluation.tables import COLUMNS, NOTE
from space_envs.models.parameters import SINGLE_ARM, DHLink, SingleArmParameters
from space_envs.models.single_arm import ModelOptions, single_arm_model
from space_envs.registration import ENTRIES
from space_envs.tasks.single_arm import SingleArmTask


def environments() -> str:
    """Registered ids with links to their pages."""
    rows = [
        (f"[{env_id}](environments/{env_id.split('/')[-1]}.md)", entry.summary)
        for env_id, entry in ENTRIES.items()
    ]
    return table(("id", "what it asks"), rows)


def policies() -> str:
    """What `--policy all` plays."""
    rows = []
    for name in dict.fromkeys(name for env_id in ENTRIES for name in policies_for(env_id)):
        rows.append((f"`{name}`", f"`{POLICIES[name].control_mode}`", POLICIES[name].summary))
    return table(("policy", "control mode", "what it is"), rows)


def links() -> str:
    """Tables I and II of shyam2020, and the inertias of the physical variant as compiled."""
    physical = single_arm_model(ModelOptions("physical"))
    satellite = physical.body("satellite").inertia
    rows = [
        (
            "satellite",
            "",
            "",
            "",
            number(SINGLE_ARM.satellite_mass),
            number(SINGLE_ARM.satellite_inertia),
            number(satellite.tolist()),
        )
    ]
    for i, link in enumerate(SINGLE_ARM.links, start=1):
        inertia = physical.body(f"link{i}").inertia
        rows.append(
            (
                f"link {i}",
                f"{link.alpha / pi:+g} pi",
                number(link.a),
                number(link.d),
                number(link.mass),
                number(link.inertia),
                number(inertia.tolist()),
            )
        )
    header = (
        "body",
        "alpha, rad",
        "a, m",
        "d, m",
        "mass, kg",
        "`paper` inertia, kg m^2",
        "`physical` inertia, kg m^2",
    )
    convention = " ".join((inspect.getdoc(DHLink) or "").split("\n\n")[1].split())
    return f"{convention}\n\n{table(header, rows)}"


def parameters() -> str:
    """What else the model consists of, with units and sources from the comments in the code."""
    said = comments(SingleArmParameters)
    rows = [
        (f"`{field.name}`", number(getattr(SINGLE_ARM, field.name)), said[field.name])
        for field in fields(SingleArmParameters)
        if field.name in said and field.name not in ("satellite_mass", "satellite_inertia")
    ]
    return table(("parameter", "value", "unit and source"), rows)


def drive() -> str:
    """Constants of the drives and control modes."""
    rows = [
        (f"`{name}`", number(getattr(control, name)), text)
        for name, text in comments(control).items()
        if name.isupper()
    ]
    return table(("constant of `space_envs.control`", "value", "meaning"), rows)


def task_members() -> str:
    """What an environment and the harness ask of a task."""
    rows = []
    for name, value in vars(SingleArmTask).items():
        inner = value.func if isinstance(value, cached_property) else getattr(value, "fget", value)
        if name.startswith("_") or not (callable(value) or isinstance(value, property | cached_property)):
            continue
        call = f"{name}{_arguments(inner)}" if callable(value) else name
        rows.append((f"`{call}`", summary(inner)))
    return table(("member", "what it is"), rows)


def _arguments(function: Callable[..., Any]) -> str:
    names = [name for name in inspect.signature(function).parameters if name != "self"]
    return f"({', '.join(names)})"


def columns() -> str:
    """The leaderboard's columns."""
    rows = [(column.title, column.unit, column.better or "", column.meaning) for column in COLUMNS]
    return f"{table(('column', 'unit', 'better', 'meaning'), rows)}\n\n{NOTE}"


BLOCKS: dict[str, Callable[[], str]] = {
    function.__name__.replace("_", "-"): function
    for function in (environments, policies, links, parameters, drive, task_members, columns)
}
