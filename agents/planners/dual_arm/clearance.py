"""How far the arms are from the satellite's body, from each other and from a moving target, batched.

Links are capsules, from joint to joint; the satellite and the target are boxes. This module is what plans are
checked with; it shares nothing with the expressions that the planner is kept clear by.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicHermiteSpline

from space_envs.checks import count, finite_array, flag, non_negative
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.capsules import box_distance, segment_distance
from space_envs.dynamics.rigid_body import tumble
from space_envs.dynamics.rotations import Array, conjugate, multiply, rotate
from space_envs.errors import ConfigurationError, positive

TargetMotion = Callable[[Array], tuple[Array, Array]]
_GRID = 0.5  # s, of the attitudes of a turning target between which others are interpolated
_SHORT = 1e-6  # m; links below it are joints without a body of their own


@dataclass(frozen=True, eq=False)
class Surroundings:
    """What the arms have to keep away from, and how far.

    Attributes:
        radius: m, of the links.
        margin: m, least gap between surfaces that a plan is made for.
        arms: whether the arms keep away from each other.
        bus: (3,) m, half sides of the satellite's box about the base's origin; None leaves it out, as for the
            planar arms, which turn in a plane before the satellite's deck.
        standing: number of links at the root of each arm that may touch the satellite, on which they stand.
        target: (3,) m, half sides of the target's box; None leaves it out.
        motion: times (K,) s from the start of the plan -> centre (K, 3) m and quaternion (K, 4) of the
            target, inertial frame, the satellite's centre of mass being at the origin at time 0.
        gripper: m, outer part of the last link of which only the centre line counts against the target when
            it grapples.
        contact: s before the end, when the gripper begins to open: that part grows evenly from nothing to
            `gripper` at half of that.
    """

    radius: float = 0.05
    margin: float = 0.02
    arms: bool = True
    bus: Array | None = None
    standing: int = 2
    target: Array | None = None
    motion: TargetMotion | None = None
    gripper: float = 0.15
    contact: float = 4.0

    def __post_init__(self) -> None:
        positive("radius of the links", self.radius)
        for name in ("margin", "gripper", "contact"):
            non_negative(name, getattr(self, name))
        flag("arms", self.arms)
        count("standing", self.standing, 100)
        for name in ("bus", "target"):
            sides = getattr(self, name)
            if sides is not None:
                sides = finite_array(f"half sides of {name}", sides, (3,))
                if not (sides > 0.0).all():
                    raise ConfigurationError(f"{name} must be three positive half sides, got {sides!r}")
                object.__setattr__(self, name, sides)
        if (self.target is None) != (self.motion is None):
            raise ConfigurationError("a target needs half sides and a motion, or neither")
        if self.motion is not None and not callable(self.motion):
            raise ConfigurationError(f"motion must be a function of times, got {self.motion!r}")

    def counted(self, length: Array, time: Array, duration: float) -> Array:
        """Share (K, S) of last links of `length` (S,) m that counts in full against the target at times (K,)
        s."""
        if self.contact == 0.0:
            return np.ones((len(time), len(length)))
        open_part = np.clip(2.0 * ((time - duration) / self.contact + 1.0), 0.0, 1.0)
        return np.maximum(1.0 - open_part[:, None] * self.gripper / length, 0.0)


def turning_target(
    centre: Array, quaternion: Array, angular_velocity: Array, inertia: Array, at: float = 0.0
) -> TargetMotion:
    """Motion of a target that turns freely about its resting centre.

    Args:
        centre: (3,) m. quaternion: (4,), body to inertial. angular_velocity: (3,) rad/s, inertial axes.
        inertia: (3,) principal moments. at: s, the time at which the attitude and the rate are given.
    """

    def side(times: Array) -> Array:
        """Attitudes at times that all lie on one side of `at`, by Hermite interpolation of a coarse grid."""
        far = times[np.abs(times - at).argmax()] - at
        count = max(int(np.ceil(abs(far) / _GRID)), 1)
        grid = far * np.arange(count + 1) / count
        attitude, spin = tumble(np.asarray(quaternion), np.asarray(angular_velocity), inertia, grid)
        pure = np.concatenate([np.zeros((count + 1, 1)), spin], axis=1)
        slope = 0.5 * multiply(pure, attitude)
        order = slice(None) if far > 0.0 else slice(None, None, -1)
        turned = CubicHermiteSpline(grid[order], attitude[order], slope[order])(times - at)
        return turned / np.linalg.norm(turned, axis=1, keepdims=True)

    def motion(times: Array) -> tuple[Array, Array]:
        times = np.asarray(times, dtype=np.float64)
        attitude = np.tile(np.asarray(quaternion, dtype=np.float64), (len(times), 1))
        for part in (times > at, times < at):
            if part.any():
                attitude[part] = side(times[part])
        return np.broadcast_to(centre, (len(times), 3)), attitude

    return motion


@dataclass(frozen=True, eq=False)
class Links:
    """The links of a robot that have a body.

    Attributes:
        link: (S,) their numbers, from 1. arm: (S,) the end-effector they lead to. order: (S,) place in the
            arm, counted over all its links from 0. end: (S, 3) m, where they end, in the link's frame.
        last: (S,) whether it carries the end-effector.
    """

    link: NDArray[np.int64]
    arm: NDArray[np.int64]
    order: NDArray[np.int64]
    end: Array
    last: NDArray[np.bool_]

    @classmethod
    def of(cls, robot: FloatingRobot) -> "Links":
        """Links from joint to joint, and from the last joint to the end-effector."""
        rows = []
        for arm, tip in enumerate(robot.end_effector_link):
            chain = [int(tip)]
            while robot.parent[chain[0] - 1] != 0:
                chain.insert(0, int(robot.parent[chain[0] - 1]))
            ends = [robot.offset[link - 1] for link in chain[1:]] + [robot.end_effector_offset[arm]]
            for order, (link, end) in enumerate(zip(chain, ends, strict=True)):
                if np.linalg.norm(end) > _SHORT:
                    rows.append((link, arm, order, end, link == tip))
        link, arm, order, end, last = (np.array(column) for column in zip(*rows, strict=True))
        return cls(link, arm, order, end, last)

    def segments(self, robot: FloatingRobot, q: Array) -> tuple[Array, Array, Array]:
        """Begin and end (K, S, 3) of the links in the base frame and the centre of mass (K, 3), m."""
        k = robot.kinematics(q)
        begin = k.position[:, self.link - 1]
        end = begin + (k.rotation[:, self.link - 1] @ self.end[:, :, None])[..., 0]
        return begin, end, robot.centre_of_mass(k)


@dataclass(frozen=True, eq=False)
class Gaps:
    """Gaps between surfaces along a motion, m, negative where they overlap; infinite where nothing counts.

    Attributes:
        arms, bus, target: (K,) least gap of the arms from each other, of the arms from the satellite and of
            the arms from the target.
    """

    arms: Array
    bus: Array
    target: Array

    @property
    def each(self) -> Array:
        """(K,) least of all, m."""
        return np.minimum(np.minimum(self.arms, self.bus), self.target)

    @property
    def least(self) -> float:
        """Of all, m."""
        return float(self.each.min())

    def row(self, place: int) -> "Gaps":
        """Of one place in the motion."""
        return Gaps(*(gap[place : place + 1] for gap in (self.arms, self.bus, self.target)))

    def worst(self) -> tuple[str, int]:
        """What is nearest, in words, and the place in the motion."""
        names = {"arm 1 and arm 2": self.arms, "an arm and the satellite": self.bus}
        names |= {"an arm and the target": self.target}
        name = min(names, key=lambda key: names[key].min())
        return name, int(names[name].argmin())


def gaps(
    robot: FloatingRobot,
    around: Surroundings,
    time: Array,
    q: Array,
    duration: float,
    start: Array,
    poses: tuple[Array, Array] | None = None,
) -> Gaps:
    """Gaps of a motion that keeps the base's attitude.

    Args:
        time: (K,) s. q: (K, n) rad. duration: s, of the plan: the target is grappled at its end.
        start: (n,) rad, where the plan starts: the base's origin is then at the inertial origin.
        poses: of the target at these times, if the caller has them already.
    """
    links = Links.of(robot)
    begin, end, centre = links.segments(robot, q)
    far = np.full(len(time), np.inf)
    result = {"arms": far, "bus": far, "target": far}
    if around.arms and links.arm.any():
        one, other = np.flatnonzero(links.arm == 0), np.flatnonzero(links.arm == 1)
        one, other = (part.ravel() for part in np.meshgrid(one, other, indexing="ij"))
        apart = segment_distance(begin[:, one], end[:, one], begin[:, other], end[:, other])
        result["arms"] = apart.min(axis=1) - 2.0 * around.radius
    if around.bus is not None:
        free = links.order >= around.standing
        apart = box_distance(begin[:, free], end[:, free], around.bus)
        result["bus"] = apart.min(axis=1) - around.radius
    if around.target is not None and around.motion is not None:
        position, quaternion = around.motion(time) if poses is None else poses
        # Where the base is: the common centre of mass stays.
        base = robot.centre_of_mass(robot.kinematics(start)) - centre
        counted = around.counted(np.linalg.norm(links.end, axis=1), time, duration)
        share = np.where(links.last, counted, 1.0)
        outer = begin + share[..., None] * (end - begin)
        back = conjugate(quaternion)[:, None]
        points = (point + (base - position)[:, None] for point in (begin, outer, end))
        root, outer, tip = (rotate(back, point) for point in points)
        apart = box_distance(root, outer, around.target).min(axis=1) - around.radius
        # What is open counts by its centre line.
        line = box_distance(outer[:, links.last], tip[:, links.last], around.target).min(axis=1)
        result["target"] = np.minimum(apart, line)
    return Gaps(**result)
