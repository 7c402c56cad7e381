"""Arms that a description asks for from robot files, and the arms as they are read."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from space_envs.robots.robot import IDENTITY, ORIGIN, Arm, Inertial, Quaternion, Vector3, Visual


@dataclass(frozen=True)
class ArmSource:
    """An arm in a URDF or MJCF file.

    Attributes:
        file: the file. packages: where `package://NAME` lies, by name; other places are looked at too.
        root: link that is fixed to the satellite; None for the file's root. tool: link or site of the
            end-effector; None for the last link, if there is only one. prefix: added to names that the file
            does not have.
        position, orientation: of the root in the satellite's own frame, m and unit quaternion w x y z.
        lock: joints that are fixed, with their angles or displacements, or a list of names, at zero. Joints
            that are not between root and tool are fixed in any case.
        home: angles of the joints at the start, in their order or by name; None for the file's.
        limits: `range`, `rate`, `acceleration` and `torque` that replace those of the file: one for all
            joints, a list, or a table by name.
        contacts: whether a contact shape is fitted; not where a description has its own.
    """

    file: Path
    packages: Mapping[str, Path] = field(default_factory=dict)
    root: str | None = None
    tool: str | None = None
    prefix: str = ""
    position: Vector3 = ORIGIN
    orientation: Quaternion = IDENTITY
    lock: Mapping[str, Any] | Sequence[str] = ()
    home: Any = None
    limits: Mapping[str, Any] = field(default_factory=dict)
    contacts: bool = True


@dataclass(frozen=True)
class ImportedArms:
    """Arms from robot files.

    Attributes:
        arms: in the order of their sources; the first link is in the satellite's own frame. The acceleration
            limit of a joint is NaN where no limit was given: files have none.
        fixed: what is fixed to the satellite, in its own frame; mass 0 if there is nothing.
        visuals: how that is drawn, in the satellite's own frame.
        notes: sentences about what was found and assumed or ignored.
    """

    arms: tuple[Arm, ...]
    fixed: Inertial
    visuals: tuple[Visual, ...]
    notes: tuple[str, ...]
