"""Limits and home of the joints of an imported arm: those of its description, then those of its file."""

from collections.abc import Sequence
from math import inf, nan, pi
from typing import Any

from space_envs.checks import number
from space_envs.errors import ConfigurationError, positive, shown, unknown_name
from space_envs.robots.description.importing.chain import Chain
from space_envs.robots.description.importing.files.tree import FileJoint, FileTree
from space_envs.robots.description.importing.source import ArmSource
from space_envs.robots.description.joint_values import joint_values
from space_envs.robots.pose import vector
from space_envs.robots.robot import Joint

LIMITS = ("range", "rate", "acceleration", "torque")
_ENDLESS = (-2 * pi, 2 * pi)  # rad, of joints without a range


def joint_limits(tree: FileTree, chain: Chain, source: ArmSource) -> tuple[list[Joint], list[str]]:
    """Joints of a chain with their limits and home, and notes.

    Raises:
        ConfigurationError: for limits that are neither in the file nor in the description, or not valid, and
            a home outside of the range; the message says what to write.
    """
    for key in source.limits:
        if key not in LIMITS:
            raise unknown_name("limit", key, LIMITS)
    names = [joint.name for joint in chain.joints]
    given = {
        key: joint_values(f"limits.{key}", source.limits.get(key), names, convert, source.prefix)
        for key, convert in zip(LIMITS, (_range, positive, positive, positive), strict=True)
    }
    ranges, notes = _ranges(chain.joints, given["range"])
    rates = _from_file("rate", "velocity", "rad/s", names, given["rate"], [j.rate for j in chain.joints])
    torques = _from_file("torque", "effort", "N m", names, given["torque"], [j.effort for j in chain.joints])
    accelerations = [nan if each is None else each for each in given["acceleration"]]
    home = _home(tree, chain.joints, ranges, source)
    joints = [
        Joint(
            name=joint.name,
            range=ranges[place],
            home=home[place],
            rate_limit=rates[place],
            acceleration_limit=accelerations[place],
            torque_limit=torques[place],
            rotor_inertia=joint.rotor_inertia,
            axis=vector(joint.axis),
        )
        for place, joint in enumerate(chain.joints)
    ]
    return joints, notes


def _range(name: str, value: Any) -> tuple[float, float]:
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise ConfigurationError(f"{name} must be [least, largest] in rad, got {shown(value)}")
    low, high = (number(name, each) for each in value)
    if not low < high:
        raise ConfigurationError(f"{name} must be [least, largest] in rad, got {shown(value)}")
    return low, high


def _ranges(
    joints: Sequence[FileJoint], given: Sequence[tuple[float, float] | None]
) -> tuple[list[tuple[float, float]], list[str]]:
    ranges, endless, missing = [], [], []
    for joint, own in zip(joints, given, strict=True):
        found = own or joint.range
        if found is None and not joint.endless:
            missing.append(joint.name)
        elif found is not None and not found[0] < found[1]:
            raise ConfigurationError(
                f"the range of joint {joint.name!r} is {found[0]:g} to {found[1]:g} rad; the least angle "
                f"must be below the largest. Write limits = {{ range = {{ {joint.name} = [-3.1, 3.1] }} }}"
            )
        elif found is None:
            endless.append(joint.name)
        ranges.append(found or _ENDLESS)
    if missing:
        raise _missing("range", "lower and upper", "rad", missing, "[-3.1, 3.1]")
    if not endless:
        return ranges, []
    return ranges, [f"joints without a range may rotate by 360 deg to either side: {', '.join(endless)}."]


def _from_file(
    key: str,
    attribute: str,
    unit: str,
    names: Sequence[str],
    given: Sequence[float | None],
    found: Sequence[float | None],
) -> list[float]:
    """Limits from the description, else from the file."""
    missing, limits = [], []
    for name, own, other in zip(names, given, found, strict=True):
        value = other if own is None else own
        if value is not None and not 0.0 < value < inf:
            raise ConfigurationError(
                f"the {key} limit of joint {name!r} is {value:g} {unit} in the file ({attribute}); a joint "
                f"with that cannot move. Write [arm] limits = {{ {key} = {{ {name} = 1.0 }} }}"
            )
        missing += [name] if value is None else []
        limits.append(value or nan)
    if missing:
        raise _missing(key, attribute, unit, missing, "1.0")
    return limits


def _missing(key: str, attribute: str, unit: str, joints: Sequence[str], example: str) -> ConfigurationError:
    return ConfigurationError(
        f"the file has no limit of {key} ({attribute}) for {', '.join(joints)}. Write one, in {unit}: [arm] "
        f"limits = {{ {key} = {example} }} for all joints, or {key} = {{ {joints[0]} = {example} }} for one"
    )


def _home(
    tree: FileTree,
    joints: Sequence[FileJoint],
    ranges: Sequence[tuple[float, float]],
    source: ArmSource,
) -> list[float]:
    names = [joint.name for joint in joints]
    given = source.home
    if given is None:
        given = {name: tree.home[name] for name in names if name in tree.home} or None
    values = joint_values("home", given, names, number, source.prefix, single=False)
    missing = [name for name, value in zip(names, values, strict=True) if value is None]
    if missing:
        example = ", ".join(f"{(low + high) / 2:.2g}" for low, high in ranges)
        raise ConfigurationError(
            f"home has no angle for {', '.join(missing)}: write where the arm starts, bent so that it can "
            f"move in all directions, in rad: [arm] home = [{example}] is the middle of the ranges"
        )
    home = [float(value) for value in values if value is not None]
    for name, value, (low, high) in zip(names, home, ranges, strict=True):
        if not low < value < high:
            raise ConfigurationError(
                f"home of joint {name!r} is {value:g} rad, outside of its range {low:g} to {high:g}"
            )
    return home
