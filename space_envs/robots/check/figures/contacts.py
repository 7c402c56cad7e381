"""Parts of a robot that are close to each other at home, by the capsules of its arms."""

from itertools import combinations
from typing import NamedTuple

import numpy as np

from space_envs.dynamics.capsules import segment_distance
from space_envs.dynamics.rotations import Array
from space_envs.robots.gaps import ArmGaps, Capsules
from space_envs.robots.models import robot_mechanics, robot_model
from space_envs.robots.robot import Robot
from space_envs.tasks.goals.poses import ROOM

NEIGHBOURS = 2  # links of an arm so near to each other in number may touch where they are joined


class HomeGap(NamedTuple):
    """Two parts that are close at home: their names, and their gap, m, negative where they overlap."""

    parts: str
    gap: float


def home_gaps(robot: Robot) -> tuple[HomeGap, ...]:
    """Pairs of parts that are nearer to each other at home than goals need, each with its least gap."""
    arms = ArmGaps.of(robot_model(robot), robot)
    points = arms.points(robot_mechanics(robot), robot.home[None])
    names, gaps = list(arms.pairs), arms.all_gaps(points)[0].tolist()
    if robot.target is not None:  # whose place is not a part of the robot
        first = arms.first_pair
        del names[first["target"] : first["arms"]]
    least: dict[str, float] = {}
    for name, gap in [*zip(names, gaps, strict=True), *_within_arms(arms, points[0])]:
        least[name] = min(gap, least.get(name, np.inf))
    return tuple(HomeGap(name, gap) for name, gap in least.items() if gap <= ROOM)


def _within_arms(arms: ArmGaps, points: Array) -> list[HomeGap]:
    """Gaps between links of one arm that are not joined, for points (P, 3) of the arms, m."""
    capsules = Capsules.of(arms.robot)
    names, found = arms.link_names(capsules), []
    for a, b in combinations(range(len(names)), 2):
        if capsules.arm[a] == capsules.arm[b] and capsules.link[b] - capsules.link[a] > NEIGHBOURS:
            ends = (points[place] for one in (a, b) for place in (capsules.start[one], capsules.end[one]))
            gap = float(segment_distance(*ends)) - capsules.radius[a] - capsules.radius[b]
            found.append(HomeGap(f"{names[a]} and {names[b]}", float(gap)))
    return found
