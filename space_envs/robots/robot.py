"""A free-floating robot as a value: its satellite, its arms and their limits, wherever it was described.

Every robot, of this package and of a user, is a `Robot`. `space_envs.robots.description` reads one from a
file, and `space_envs.robots.models` makes its MuJoCo model. Lengths are in m, angles in rad, quaternions
w x y z.
"""

import hashlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, is_dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from space_envs.dynamics.rotations import Array

Vector3 = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]

NOMINAL = "nominal"  # variant of a robot that has only one
ORIGIN: Vector3 = (0.0, 0.0, 0.0)
IDENTITY: Quaternion = (1.0, 0.0, 0.0, 0.0)
UNCHECKED = float("-inf")  # m, radius of a capsule with respect to a body that it is not checked against


class StepLimits(NamedTuple):
    """Time steps of a robot's simulation: the default, whose momentum drift is well below the bound (see
    docs/momentum.md), the largest, and the largest control period, s."""

    default_timestep: float
    largest_timestep: float
    largest_control_period: float


@dataclass(frozen=True)
class Inertial:
    """Mass properties of a body.

    Attributes:
        mass: kg. moments: principal inertia about the centre of mass, kg m^2.
        centre: centre of mass in the body's frame. axes: principal axes in the body's frame.
    """

    mass: float
    moments: Vector3
    centre: Vector3 = ORIGIN
    axes: Quaternion = IDENTITY


@dataclass(frozen=True)
class Visual:
    """Geometry that is only drawn.

    Attributes:
        kind: box, sphere, cylinder, capsule, ellipsoid or mesh. size: half sizes as in MuJoCo; for a mesh the
            scale along its axes. mesh: its file. position, orientation: in the body's frame.
        colour: red, green, blue, opacity; None is that of links.
    """

    kind: str
    size: Vector3
    position: Vector3 = ORIGIN
    orientation: Quaternion = IDENTITY
    mesh: Path | None = None
    colour: tuple[float, float, float, float] | None = None


@dataclass(frozen=True)
class Joint:
    """A hinge through the origin of its link's frame.

    Attributes:
        name: in the robot's own file. axis: unit, in the link's frame.
        range: least and largest angle. home: angle at the start of an episode.
        rate_limit: rad/s. acceleration_limit: rad/s^2. torque_limit: N m.
        rotor_inertia: kg m^2 behind the gear; it adds to the joint's inertia alone.
    """

    name: str
    range: tuple[float, float]
    home: float
    rate_limit: float
    acceleration_limit: float
    torque_limit: float
    rotor_inertia: float = 0.0
    axis: Vector3 = (0.0, 0.0, 1.0)


@dataclass(frozen=True)
class Link:
    """A link of an arm.

    Attributes:
        name: in the robot's own file. joint: that it hangs on.
        position, orientation: of its frame at joint angle zero, in the frame of the link before it or, for
            the first link of an arm, of the satellite.
        visuals: what is drawn of it; empty for a rod along its axis.
    """

    name: str
    position: Vector3
    orientation: Quaternion
    joint: Joint
    inertial: Inertial
    visuals: tuple[Visual, ...] = ()


class Anchor(NamedTuple):
    """A point fixed to a link, an end of capsules.

    Attributes:
        link: number from 1. at: in the link's frame.
        name: of its site in the model; None for the origin of the link's frame.
    """

    link: int
    at: Vector3 = ORIGIN
    name: str | None = None


class Capsule(NamedTuple):
    """A capsule around the line between two anchors, for contacts.

    Attributes:
        link: number from 1 of the link that it is part of. start, end: places in the arm's `anchors`.
        radius: m, in checks against the other arm and keep-out spheres. satellite, target: m, radius in
            checks against that body. 0 is the centre line alone, `UNCHECKED` no check.
    """

    link: int
    start: int
    end: int
    radius: float
    satellite: float
    target: float


@dataclass(frozen=True)
class Arm:
    """A serial chain of links from the satellite to a tool.

    Attributes:
        links: from the satellite outwards.
        tool_position, tool_orientation: of the end-effector's frame, in the last link's frame.
        anchors, capsules: shape of the arm for contacts.
    """

    links: tuple[Link, ...]
    tool_position: Vector3
    tool_orientation: Quaternion
    anchors: tuple[Anchor, ...]
    capsules: tuple[Capsule, ...]

    @property
    def length(self) -> float:
        """Of the stretched arm, from its first joint to its end-effector, m."""
        steps = [*(link.position for link in self.links[1:]), self.tool_position]
        return float(np.linalg.norm(np.array(steps), axis=1).sum())


@dataclass(frozen=True)
class Satellite:
    """The free-floating base; its frame is at the centre of mass of everything that is fixed to it.

    Attributes:
        inertial: with its centre at the origin.
        box: half sides of its body, for goals, contacts and drawings. box_centre: of that body.
        reachable: whether the arms can touch it, and contacts with it are checked.
        visuals: what is drawn of it. bus: whether a standard bus of the size of the box is drawn too.
    """

    inertial: Inertial
    box: Vector3
    box_centre: Vector3 = ORIGIN
    reachable: bool = True
    visuals: tuple[Visual, ...] = ()
    bus: bool = True


@dataclass(frozen=True)
class Target:
    """The free body that a robot with two arms captures, with a grapple point for each arm.

    Attributes:
        mass: kg. inertia: kg m^2, principal, at the nominal size; it scales with the square of the size.
        half_width: nominal distance of the grapple points from the centre.
        body: half sides of the box between the grapple points, nominal.
        gripper: outer part of an arm that may touch the target.
        position, orientation: around which targets are drawn, in the satellite's frame at the start. In
            space the grapple points of arms 1 and 2 lie on the target's axes +x and -x, in the plane on -y
            and +y.
    """

    mass: float
    inertia: Vector3
    half_width: float
    body: Vector3
    gripper: float
    position: Vector3
    orientation: Quaternion = IDENTITY


@dataclass(frozen=True)
class View:
    """Cameras and light of drawings, in the inertial frame, with the satellite at the origin.

    Attributes:
        overview, chase: position of a camera and the point it looks at; `chase` moves along with the robot.
        earth: centre of the planet. sun: direction in which sunlight travels.
    """

    overview: tuple[Vector3, Vector3]
    chase: tuple[Vector3, Vector3]
    earth: Vector3 = (-370.0, 110.0, -340.0)
    sun: Vector3 = (-0.50, 0.45, -0.74)


@dataclass(frozen=True)
class Robot:
    """A free-floating robot with one or two arms.

    Attributes:
        name: for people, in records and on pages. variant: of its inertias, where it has several.
        satellite: the base. arms: one or two, with as many joints each.
        planar: whether it moves in the plane z = 0 only; all hinges are then along z.
        steps: time steps of its simulation. target: of two arms; None for one arm.
        view: of drawings; None is one that shows the whole robot.
        notes: sentences for its user about what was assumed or left out when it was read.
    """

    name: str
    variant: str
    satellite: Satellite
    arms: tuple[Arm, ...]
    steps: StepLimits
    planar: bool = False
    target: Target | None = None
    view: View | None = None
    notes: tuple[str, ...] = ()

    def __hash__(self) -> int:
        return hash(self.digest)

    @property
    def title(self) -> str:
        """Name with the variant, if there are several."""
        return self.name if self.variant == NOMINAL else f"{self.name}/{self.variant}"

    @cached_property
    def digest(self) -> str:
        """SHA-256 of everything that is simulated: neither names nor what is only drawn."""
        digest = hashlib.sha256()
        for number in _numbers(self):
            digest.update(f"{number};".encode())
        return digest.hexdigest()

    def mounted_at(self, mounts: Sequence[tuple[float, float]]) -> "Robot":
        """The robot in the plane with its arms at other points (x, y) of the satellite, m."""
        arms = []
        for arm, (x, y) in zip(self.arms, mounts, strict=True):
            root = replace(arm.links[0], position=(x, y, arm.links[0].position[2]))
            arms.append(replace(arm, links=(root, *arm.links[1:])))
        return replace(self, arms=tuple(arms))

    @property
    def links(self) -> tuple[Link, ...]:
        """Links of all arms, arm by arm."""
        return tuple(link for arm in self.arms for link in arm.links)

    @property
    def joints(self) -> tuple[Joint, ...]:
        """Joints of all arms, arm by arm."""
        return tuple(link.joint for link in self.links)

    @property
    def n_joints(self) -> int:
        """Number of joints of all arms."""
        return len(self.links)

    @property
    def reach(self) -> float:
        """Largest distance of an end-effector from the first joint of its arm, over all arms, m."""
        return max(arm.length for arm in self.arms)

    @property
    def home(self) -> Array:
        """(n,) rad."""
        return np.array([joint.home for joint in self.joints])

    @property
    def joint_range(self) -> Array:
        """(n, 2) least and largest angle, rad."""
        return np.array([joint.range for joint in self.joints])

    @property
    def rate_limit(self) -> Array:
        """(n,) rad/s."""
        return np.array([joint.rate_limit for joint in self.joints])

    @property
    def acceleration_limit(self) -> Array:
        """(n,) rad/s^2."""
        return np.array([joint.acceleration_limit for joint in self.joints])

    @property
    def torque_limit(self) -> Array:
        """(n,) N m."""
        return np.array([joint.torque_limit for joint in self.joints])


_DIGITS = 12  # of a number in a digest, significant and behind the point
_DRAWN = ("visuals", "bus", "view")  # fields of what is only drawn
_NOTES = "notes"  # a robot's digest is that of the same robot without any


def _numbers(value: Any) -> Iterator[str]:
    """Numbers of a value in the order of its fields, with the names of its fields."""
    if isinstance(value, str):
        return
    if is_dataclass(value):
        for field in fields(value):
            if field.name not in _DRAWN:
                yield field.name
                yield from _numbers(() if field.name == _NOTES else getattr(value, field.name))
    elif isinstance(value, tuple):
        yield str(len(value))
        for part in value:
            yield from _numbers(part)
    elif value is None or isinstance(value, bool | int):
        yield repr(value)
    else:
        # Not to the last bit, which depends on a machine's mathematical functions.
        yield f"{round(float(value), _DIGITS) + 0.0:.{_DIGITS}g}"
