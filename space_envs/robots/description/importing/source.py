"""Arms that a description asks for from robot files."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from space_envs.errors import ConfigurationError, shown
from space_envs.robots.description.importing.files.packages import Packages, resolve
from space_envs.robots.description.tables import DescriptionTable


@dataclass(frozen=True)
class ArmSource:
    """An arm in a URDF or MJCF file.

    Attributes:
        table: of the arm, with its home and limits. file: the robot file. packages: where `package://NAME`
            lies, by name; other places are looked at too.
        root: link that is fixed to the satellite; None for the file's root. tool: link or site of the
            end-effector; None for the last link, if there is only one. prefix: added to names that the file
            does not have.
        lock: joints that are fixed, with their angles or displacements. Joints that are not between root and
            tool are fixed in any case.
    """

    table: DescriptionTable
    file: Path
    packages: Packages
    root: str | None
    tool: str | None
    prefix: str
    lock: Mapping[str, Any]

    def is_branch_of(self, other: "ArmSource") -> bool:
        """Whether this arm and another one are branches of one robot, and not two copies of it.

        Raises:
            ConfigurationError: if one of two branches has no mount.
        """
        if (self.file.resolve(), self.root) != (other.file.resolve(), other.root):
            return False
        mounts = [source.table.get("mount", None) for source in (other, self)]
        if mounts.count(None) == 1 and (self.prefix, self.tool) != (other.prefix, other.tool):
            raise self.table.error(
                "has the file and the root of the other arm but another tool: write the same mount for both "
                "if they are branches of one robot, or two mounts for two copies"
            )
        return mounts[0] == mounts[1]


def arm_source(table: DescriptionTable, packages: Packages) -> ArmSource:
    """The source that the table of an arm with `file` describes.

    Raises:
        ConfigurationError: for a package that is nowhere, and values that are no names.
    """
    lock = table.get("lock", {})
    if isinstance(lock, list):
        lock = dict.fromkeys(map(str, lock), 0.0)
    if not isinstance(lock, Mapping):
        raise table.error(f"lock must be a table of joints and their values, or a list, got {shown(lock)}")
    try:
        file = resolve(table.text("file"), table.file, packages)
    except ConfigurationError as error:
        raise table.error(str(error)) from None
    return ArmSource(
        table=table,
        file=file,
        packages=packages,
        root=table.text("root", None),
        tool=table.text("tool", None),
        prefix=table.text("prefix", ""),
        lock=lock,
    )
