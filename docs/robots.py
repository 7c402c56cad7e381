"""Tables of the robots: links as compiled, and parameters with their comments in the code."""

import inspect
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from math import pi
from typing import Any

from docs.reading import comments, number, table
from space_envs.robots.dual_arm import DualArmOptions, dual_arm_model
from space_envs.robots.parameters import DUAL_ARM_PLANAR, DUAL_ARM_SPATIAL, SINGLE_ARM, DHLink
from space_envs.robots.single_arm import ModelOptions, single_arm_model


def links() -> str:
    """Tables I and II of shyam2020, and the inertias of the physical variant as compiled."""
    physical = single_arm_model(ModelOptions("physical"))
    satellite = number(physical.body("satellite").inertia.tolist())
    first = number(SINGLE_ARM.satellite_mass), number(SINGLE_ARM.satellite_inertia), satellite
    rows = [("satellite", "", "", "", *first)]
    for i, link in enumerate(SINGLE_ARM.links, start=1):
        inertia = number(physical.body(f"link{i}").inertia.tolist())
        rows.append(
            (
                f"link {i}",
                *_frame(link.alpha, link.a, link.d),
                number(link.mass),
                number(link.inertia),
                inertia,
            )
        )
    header = (*FRAME, "mass, kg", "`paper` inertia, kg m^2", "`physical` inertia, kg m^2")
    convention = " ".join((inspect.getdoc(DHLink) or "").split("\n\n")[1].split())
    return f"{convention}\n\n{table(header, rows)}"


def planar_links() -> str:
    """Table I of shah2013."""
    robot = DUAL_ARM_PLANAR
    rows = [("satellite", "", number(robot.satellite_mass), number(robot.satellite_inertia))]
    for i, link in enumerate(robot.arm, start=1):
        rows.append((f"link {i} of each arm", number(link.length), number(link.mass), number(link.inertia)))
    return table(("body", "length, m", "mass, kg", "Izz, kg m^2"), rows)


def spatial_links() -> str:
    """Links of the spatial dual-arm robot, with their inertias as compiled."""
    model, robot = dual_arm_model(DualArmOptions("spatial")), DUAL_ARM_SPATIAL
    satellite = number(model.body("satellite").inertia.tolist())
    rows = [("satellite", "", "", "", number(robot.satellite_mass), satellite)]
    for i, frame in enumerate(zip(robot.alpha, robot.a, robot.d, strict=True), start=1):
        inertia = number(model.body(f"arm1_link{i}").inertia.tolist())
        rows.append((f"link {i} of each arm", *_frame(*frame), number(robot.mass[i - 1]), inertia))
    return table((*FRAME, "mass, kg", "inertia, kg m^2"), rows)


FRAME = ("body", "alpha, rad", "a, m", "d, m")


def _frame(alpha: float, a: float, d: float) -> tuple[str, str, str]:
    return f"{alpha / pi:+g} pi", number(a), number(d)


def parameters(values: Any) -> str:
    """Table of a robot's parameters without its links, with their comments in the code."""
    return table(("parameter", "value", "unit and source"), list(_parameters(values)))


def _parameters(values: Any, prefix: str = "") -> Iterator[tuple[str, str, str]]:
    said = comments(type(values))
    for field in fields(values):
        value = getattr(values, field.name)
        if is_dataclass(value):
            yield from _parameters(value, f"{prefix}{field.name}.")
        elif not (isinstance(value, tuple) and is_dataclass(value[0])):  # links have tables of their own
            yield f"`{prefix}{field.name}`", number(value), said[field.name]
