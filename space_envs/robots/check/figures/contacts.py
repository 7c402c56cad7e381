"""Parts of a robot that touch each other at home, or nearly so, by the capsules of its arms."""

from itertools import combinations
from typing import NamedTuple

import numpy as np

from space_envs.dynamics.capsules import box_distance, segment_distance
from space_envs.dynamics.rotations import Array
from space_envs.robots.robot import Robot
from space_envs.step_limits.motions import mechanics
from space_envs.tasks.goals.poses import ROOM

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


class HomeGap(NamedTuple):
    """Two parts that are close at home: their names, and their gap, m, negative where they overlap."""

    parts: str
    gap: float


def home_gaps(robot: Robot) -> tuple[HomeGap, ...]:
    """Pairs of parts nearer to each other at home than goals need, the least gap of each pair."""
    parts, arms = _parts(robot), len(robot.arms)
    found = [HomeGap(f"{part.name(arms)} and the satellite", _to_satellite(robot, part)) for part in parts]
    found += [
        HomeGap(f"{a.name(arms)} and {b.name(arms)}", _between(a, b)) for a, b in combinations(parts, 2)
    ]
    least: dict[str, float] = {}
    for name, gap in found:
        least[name] = min(gap, least.get(name, np.inf))
    return tuple(HomeGap(name, gap) for name, gap in least.items() if gap <= ROOM)


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


def _to_satellite(robot: Robot, part: _Part) -> float:
    satellite = robot.satellite
    if not satellite.reachable:
        return np.inf
    centre, half = np.array(satellite.box_centre), np.array(satellite.box)
    return float(box_distance(part.start - centre, part.end - centre, half)) - part.satellite


def _between(a: _Part, b: _Part) -> float:
    if a.arm == b.arm and abs(a.link - b.link) <= NEIGHBOURS:
        return np.inf
    return float(segment_distance(a.start, a.end, b.start, b.end)) - a.radius - b.radius
