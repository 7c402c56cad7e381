"""Values that a description gives for the joints of an arm: one for all, a list, or a table by name."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeVar

from space_envs.errors import ConfigurationError, shown, unknown_name

T = TypeVar("T")


def joint_values(
    name: str,
    value: Any,
    joints: Sequence[str],
    convert: Callable[[str, Any], T],
    prefix: str = "",
    single: bool = True,
) -> list[T | None]:
    """The value of each joint; None for those that a table does not name, and for all if there is no value.

    Args:
        name: of the value, for messages. joints: names in order. prefix: of names that a table leaves out.
        convert: from the name and the value of one joint, raising ConfigurationError.
        single: whether one value may stand for all joints.

    Raises:
        ConfigurationError: for a list of another length, and names that are no joints.
    """
    if value is None:
        return [None] * len(joints)
    if isinstance(value, Mapping):
        named = {found_name(f"joint in {name}", key, joints, prefix): each for key, each in value.items()}
        return [convert(f"{name} of {joint!r}", named[joint]) if joint in named else None for joint in joints]
    if _is_list_of_values(value, single):
        if len(value) != len(joints):
            raise ConfigurationError(
                f"{name} has {len(value)} values, but the arm has {len(joints)} joints: {', '.join(joints)}"
            )
        return [convert(f"{name} of {joint!r}", each) for joint, each in zip(joints, value, strict=True)]
    if not single:
        raise ConfigurationError(
            f"{name} must be a list of {len(joints)} numbers or a table by joint, got {shown(value)}"
        )
    return [convert(name, value)] * len(joints)


def _is_list_of_values(value: Any, single: bool) -> bool:
    """Whether it is a list with one entry a joint; a range of two numbers is one value."""
    if not isinstance(value, list | tuple):
        return False
    return not single or not _is_pair(value)


def _is_pair(value: Sequence[Any]) -> bool:
    return len(value) == 2 and all(isinstance(each, int | float) for each in value)


def found_name(kind: str, name: str, valid: Iterable[str], prefix: str = "") -> str:
    """The valid name that is meant: itself, or with the prefix.

    Raises:
        ConfigurationError: with the nearest valid name.
    """
    valid = list(valid)
    for candidate in (name, f"{prefix}{name}"):
        if candidate in valid:
            return candidate
    raise unknown_name(kind, name, valid)
