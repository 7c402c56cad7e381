"""A robot file in one form, whether it is URDF or MJCF: bodies, joints, shapes, frames."""

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError
from space_envs.robots.pose import Pose
from space_envs.robots.robot import Inertial, Visual

HINGE, SLIDE = "hinge", "prismatic"
LARGEST = 1e9  # of a number, in any unit
_EXAMPLES = {
    "urdf": '<inertial> <origin xyz="0 0 0.1"/> <mass value="2.0"/> <inertia ixx="0.02" iyy="0.02" '
    'izz="0.01" ixy="0" ixz="0" iyz="0"/> </inertial>',
    "mjcf": '<inertial pos="0 0 0.1" mass="2.0" diaginertia="0.02 0.02 0.01"/>',
}


def inertial_example(file_format: str) -> str:
    """Mass and inertia as they are written in `urdf` or `mjcf`."""
    return _EXAMPLES[file_format]


class Mimic(NamedTuple):
    """A joint whose value is multiplier * leader + offset."""

    leader: str
    multiplier: float
    offset: float


@dataclass(frozen=True)
class FileJoint:
    """A joint of a file.

    Attributes:
        name: of the joint. kind: `hinge`, `prismatic`, or one that no arm here has: ball, floating, planar.
        axis: (3,) unit. at: (3,) m, a point of the axis; both in the body's frame.
        zero: value at which the body has the pose that the file gives it, rad or m.
        range, rate, effort: None where the file has none. endless: the file says that it has no range.
        mimic: that it follows; None for a joint of its own. rotor_inertia: kg m^2.
    """

    name: str
    kind: str
    axis: Array
    at: Array
    zero: float = 0.0
    range: tuple[float, float] | None = None
    rate: float | None = None
    effort: float | None = None
    endless: bool = False
    mimic: Mimic | None = None
    rotor_inertia: float = 0.0


class Shape(NamedTuple):
    """Geometry of a body in a file.

    Attributes:
        visual: its form and place; of a mesh without a readable file, only the place.
        drawn, solid: whether it is for drawings, and for contacts.
        vertices: (k, 3) m, of a mesh, in the visual's own frame; None where they are in its file.
        problem: why the mesh's file cannot be named; None if it can.
    """

    visual: Visual
    drawn: bool
    solid: bool
    vertices: Array | None = None
    problem: str | None = None


@dataclass(frozen=True)
class FileBody:
    """A body of a file.

    Attributes:
        name: of the body. parent: place of the one that carries it in the file's bodies; None for a root.
        pose: in the parent, with its joints at their `zero`.
        inertial: in the body's frame; None where the file has none.
        joints: by which it moves against its parent; none for a fixed one. shapes: geometry.
    """

    name: str
    parent: int | None
    pose: Pose
    inertial: Inertial | None
    joints: tuple[FileJoint, ...]
    shapes: tuple[Shape, ...]


class Frame(NamedTuple):
    """A named frame (a site of MJCF) on a body, which is its place in the file's bodies."""

    body: int
    pose: Pose


@dataclass(frozen=True)
class FileTree:
    """The content of a robot file.

    Attributes:
        bodies: parents before their children. frames: by name.
        format: `urdf`, or `mjcf`, whose first body is the world.
        home: angles of a pose named home, by joint; empty if there is none.
        coupled: joints and bodies that a constraint couples, with a word for it, by name.
        notes: sentences about what was ignored.
    """

    bodies: tuple[FileBody, ...]
    format: str
    frames: dict[str, Frame] = field(default_factory=dict)
    home: dict[str, float] = field(default_factory=dict)
    coupled: dict[str, str] = field(default_factory=dict)
    notes: tuple[str, ...] = ()

    @property
    def joints(self) -> dict[str, FileJoint]:
        """All joints by name."""
        return {joint.name: joint for body in self.bodies for joint in body.joints}

    def children(self, body: int) -> list[int]:
        """Places of the bodies that a body carries."""
        return [place for place, other in enumerate(self.bodies) if other.parent == body]

    def path_to(self, body: int) -> list[int]:
        """Places of the bodies from a root to a body, both included."""
        path: list[int] = []
        place: int | None = body
        while place is not None:
            path.insert(0, place)
            place = self.bodies[place].parent
        return path

    def check_numbers(self) -> None:
        """Raise ConfigurationError for a pose or a mass that is no number, or beyond all measure."""
        for body in self.bodies:
            mass = () if body.inertial is None else (body.inertial.mass, *body.inertial.moments)
            centre = () if body.inertial is None else body.inertial.centre
            points = [joint.at for joint in body.joints]
            values = np.concatenate([*body.pose, mass, centre, *points])
            if not (np.abs(values) <= LARGEST).all():
                raise ConfigurationError(
                    f"a position, mass or inertia of body {body.name!r} is no number of at most {LARGEST:g}"
                )
