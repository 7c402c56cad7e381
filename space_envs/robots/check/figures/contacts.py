"""Parts of a robot that touch each other at home, by the capsules of its arms."""

from itertools import combinations
from typing import NamedTuple

import numpy as np

from space_envs.dynamics.capsules import box_distance, segment_distance
from space_envs.dynamics.rotations import Array
from space_envs.robots.robot import Robot
from space_envs.step_limits.motions import mechanics

NEIGHBOURS = 2  # links of an arm so near to each other in number may touch where they are joined


class _Part(NamedTuple):
    """Capsule of an arm: numbers of arm and link, ends (3,) in the satellite's frame, and radii, m."""

    arm: int
    link: int
    start: Array
    end: Array
    radius: float
    satellite: float

    def name(self, arms: int) -> str:
        """Name for messages."""
        return f"link {self.link}" + (f" of arm {self.arm}" if arms > 1 else "")


def home_contacts(robot: Robot) -> tuple[str, ...]:
    """Pairs of parts that touch at home, in words."""
    parts, arms = _parts(robot), len(robot.arms)
    found = [f"{part.name(arms)} and the satellite" for part in parts if _touches_satellite(robot, part)]
    found += [f"{a.name(arms)} and {b.name(arms)}" for a, b in combinations(parts, 2) if _touch(a, b)]
    return tuple(dict.fromkeys(found))


def _parts(robot: Robot) -> list[_Part]:
    kinematics, parts, first = mechanics(robot).kinematics(robot.home), [], 0
    for number, arm in enumerate(robot.arms, start=1):
        points = [
            kinematics.position[first + link - 1] + kinematics.rotation[first + link - 1] @ np.array(at)
            for link, at, _ in arm.anchors
        ]
        parts += [
            _Part(number, one.link, points[one.start], points[one.end], one.radius, one.satellite)
            for one in arm.capsules
        ]
        first += len(arm.links)
    return parts


def _touches_satellite(robot: Robot, part: _Part) -> bool:
    satellite = robot.satellite
    if not satellite.reachable:
        return False
    centre, half = np.array(satellite.box_centre), np.array(satellite.box)
    return bool(box_distance(part.start - centre, part.end - centre, half) <= part.satellite)


def _touch(a: _Part, b: _Part) -> bool:
    if a.arm == b.arm and abs(a.link - b.link) <= NEIGHBOURS:
        return False
    return bool(segment_distance(a.start, a.end, b.start, b.end) <= a.radius + b.radius)
