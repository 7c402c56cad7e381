"""Values of an arm's joints in a description: one number for all, a list, or a table by joint name."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from space_envs.checks import numbers
from space_envs.errors import shown, unknown_name
from space_envs.robots.description.tables import DescriptionTable

LIMIT_KEYS = ("rate", "acceleration", "torque", "range")
_UNITS = {
    "rate": "rad/s",
    "acceleration": "rad/s^2",
    "torque": "N m",
    "home": "rad",
    "rotor_inertia": "kg m^2",
}


@dataclass(frozen=True)
class JointValues:
    """Values of n joints.

    Attributes:
        names: of the joints. home: rad. range: least and largest angle, rad.
        rate: rad/s. acceleration: rad/s^2, NaN where it is not given. torque: N m. rotor_inertia: kg m^2.
    """

    names: list[str]
    home: list[float]
    range: list[tuple[float, float]]
    rate: list[float]
    acceleration: list[float]
    torque: list[float]
    rotor_inertia: list[float]


def joint_values(
    arm: DescriptionTable,
    names: list[str],
    defaults: Mapping[str, Sequence[Any] | None] | None = None,
    prefix: str = "",
) -> JointValues:
    """Values of an arm's joints from its table, with the defaults of its own file.

    Args:
        arm: table of the arm. names: of its joints.
        defaults: values of each joint by key (`home` and those of `limits`); None, and NaN in a list, where
            there is none. prefix: of names that tables by joint may leave out.

    Raises:
        ConfigurationError: for a value that is missing, malformed or contradictory.
    """
    known = defaults or {}
    limits = arm.table("limits", LIMIT_KEYS, {})

    def read(table: DescriptionTable, key: str, default: Any = None) -> list[float]:
        return _one_each(table, key, names, known.get(key, default), prefix)

    n = len(names)
    ranges = _ranges(limits, names, known.get("range"), prefix)
    given = "acceleration" in limits or known.get("acceleration") is not None
    values = JointValues(
        names=names,
        home=read(arm, "home"),
        range=ranges,
        rate=read(limits, "rate"),
        acceleration=read(limits, "acceleration") if given else [math.nan] * n,
        torque=read(limits, "torque"),
        rotor_inertia=read(arm, "rotor_inertia", [0.0] * n),
    )
    for key in ("rate", "acceleration", "torque"):
        for name, value in zip(names, getattr(values, key), strict=True):
            if value <= 0.0:
                raise limits.error(f"{key} of {name!r} must be positive, got {value!r}")
    for name, value in zip(names, values.rotor_inertia, strict=True):
        if value < 0.0:
            raise arm.error(f"rotor_inertia of {name!r} must be at least 0, got {value!r}")
    for name, value, (low, high) in zip(names, values.home, ranges, strict=True):
        if not low < high:
            raise limits.error(f"range of {name!r} must be [least, largest], got {[low, high]}")
        if not low <= value <= high:
            raise arm.error(f"home of {name!r} is outside its range {[low, high]} rad: {value!r}")
    return values


def _one_each(
    table: DescriptionTable, key: str, names: list[str], default: Sequence[float] | None, prefix: str
) -> list[float]:
    """A number for each joint, in the order of `names`."""
    value = table.get(key, None)
    if isinstance(value, Mapping):
        value = _by_joint(table, key, value, names, prefix)
        found = [value.get(name, None if default is None else default[n]) for n, name in enumerate(names)]
    elif isinstance(value, list):
        found = value
    else:
        found = (
            (list(default) if default is not None else [None] * len(names))
            if value is None
            else [value] * len(names)
        )
    missing = [name for name, part in zip(names, found, strict=False) if part is None or part != part]
    if missing and len(found) == len(names):
        raise table.error(_lack(key, missing))
    array = numbers(found)
    if array is None or array.shape != (len(names),) or not np.isfinite(array).all():
        raise table.error(
            f"{key} must be a number, a list of {len(names)} numbers or a table by joint, in {_UNITS[key]}, "
            f"got {shown(value)}"
        )
    return array.tolist()


def _by_joint(
    table: DescriptionTable, key: str, values: Mapping[str, Any], names: list[str], prefix: str
) -> dict[str, Any]:
    """Values by the whole names of joints."""
    found = {}
    for name, value in values.items():
        whole = name if name in names else f"{prefix}{name}"
        if whole not in names:
            raise table.error(f"{key}: {unknown_name('joint', name, names)}")
        found[whole] = value
    return found


def _lack(key: str, missing: list[str]) -> str:
    example = f"{key} = {{ {missing[0]!r} = ... }}".replace("'", '"')
    where = "" if key in ("home", "rotor_inertia") else "limits."
    return (
        f"there is no {key} of {', '.join(map(repr, missing))}: write {where}{example} in {_UNITS[key]}, or "
        "one number for all joints"
    )


def _ranges(
    limits: DescriptionTable, names: list[str], default: Sequence[Any] | None, prefix: str
) -> list[tuple[float, float]]:
    """Least and largest angle of each joint."""
    value = limits.get("range", None)
    if isinstance(value, Mapping):
        value = _by_joint(limits, "range", value, names, prefix)
        found = [value.get(name, None if default is None else default[n]) for n, name in enumerate(names)]
    else:
        found = value if value is not None else list(default) if default is not None else [None] * len(names)
    missing = [n for n, part in zip(names, found, strict=False) if part is None or part[0] != part[0]]
    if missing:
        raise limits.error(
            f"there is no range of {', '.join(map(repr, missing))}: write limits.range = "
            f'{{ "{missing[0]}" = [least, largest] }} in rad, or a list with one pair for each joint'
        )
    array = numbers(found)
    if array is None or array.shape != (len(names), 2) or not np.isfinite(array).all():
        raise limits.error(f"range must be {len(names)} pairs [least, largest] in rad, got {shown(value)}")
    return [(low, high) for low, high in array.tolist()]
