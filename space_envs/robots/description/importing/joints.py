"""Joints of an imported arm: limits and home of its description, else of its file."""

from math import inf, nan, pi
from typing import Any

from space_envs.errors import ConfigurationError
from space_envs.robots.description.importing.chain import JointChain
from space_envs.robots.description.importing.files.tree import FileJoint, FileTree
from space_envs.robots.description.importing.source import ArmSource
from space_envs.robots.description.limits import JointValues, joint_values
from space_envs.robots.pose import Pose
from space_envs.robots.robot import Joint

_ENDLESS = (-2 * pi, 2 * pi)  # rad, of joints without a range


def file_limits(tree: FileTree, chain: JointChain) -> dict[str, list[Any]]:
    """Values of the joints of a chain in their file, by key; NaN where it has none.

    Raises:
        ConfigurationError: for values that are not valid.
    """
    return {
        "home": [tree.home.get(joint.name, nan) for joint in chain.joints],
        "range": [_range(joint) for joint in chain.joints],
        "rate": [_limit(joint, "velocity", joint.rate) for joint in chain.joints],
        "torque": [_limit(joint, "effort", joint.effort) for joint in chain.joints],
        "rotor_inertia": [joint.rotor_inertia for joint in chain.joints],
    }


def joints_of(
    chain: JointChain, defaults: dict[str, list[Any]], source: ArmSource
) -> tuple[list[Joint], list[str]]:
    """Joints of a chain, and notes.

    Raises:
        ConfigurationError: for limits that are neither in the file nor in the description, or not valid, and
            a home outside of the range; the message says what to write.
    """
    names = [joint.name for joint in chain.joints]
    values = joint_values(source.table, names, defaults, source.prefix)
    joints = [_joint(values, number, joint) for number, joint in enumerate(chain.joints)]
    endless = [
        joint.name
        for joint, own in zip(chain.joints, joints, strict=True)
        if joint.range is None and own.range == _ENDLESS
    ]
    if not endless:
        return joints, []
    return joints, [f"joints without a range may rotate by 360 deg to either side: {', '.join(endless)}."]


def _joint(values: JointValues, number: int, joint: FileJoint) -> Joint:
    return Joint(
        name=joint.name,
        range=values.range[number],
        home=values.home[number],
        rate_limit=values.rate[number],
        acceleration_limit=values.acceleration[number],
        torque_limit=values.torque[number],
        rotor_inertia=values.rotor_inertia[number],
        axis=Pose.of(joint.axis).vector,
    )


def _range(joint: FileJoint) -> tuple[float, float]:
    """Range in the file, rad; NaN where it has none."""
    if joint.range is None:
        return _ENDLESS if joint.endless else (nan, nan)
    low, high = joint.range
    if low > high:
        raise ConfigurationError(
            f"the range of joint {joint.name!r} is {low:g} to {high:g} rad: lower must be below upper"
        )
    return (nan, nan) if low == high else (low, high)


def _limit(joint: FileJoint, attribute: str, value: float | None) -> float:
    """Limit in the file; NaN where it has none, or zero, which some files write for none."""
    if value is not None and not 0.0 <= value < inf:
        raise ConfigurationError(
            f"the limit {attribute} of joint {joint.name!r} is {value:g}; it must be positive"
        )
    return value or nan
