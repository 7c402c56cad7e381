"""Reaching problems of the single arm whose least costs are known from elsewhere, for tests of planners."""

import json
from pathlib import Path

import numpy as np

from agents.planners.common.plans import Limits
from agents.planners.single_arm.problem import Reach
from agents.policies.clearance import link_radii
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.grapples import Grapple
from space_envs.robots.zoo import find_robot
from space_envs.tasks.single_arm import SingleArmTask

# Goals and the least costs, m^2/s, with the attitude free and kept.
ROBOT = find_robot("shyam2020")
KNOWN = json.loads((Path(__file__).parent / "data" / "single_arm_goals.json").read_text())
OUT_OF_REACH = Grapple.at_rest([0.0, 9.0, 0.0], [1.0, 0.0, 0.0, 0.0])


def robot() -> FloatingRobot:
    return SingleArmTask().mechanics


def drives() -> Limits:
    return Limits(robot().range, 0.3, 0.25, 60.0)


def reach_of(number: int, keep_attitude: bool = False) -> Reach:
    goal = Grapple.at_rest(*(np.array(KNOWN[number][name]) for name in ("position", "quaternion")))
    radii = link_radii(ROBOT)
    return Reach(robot().home, goal, keep_attitude=keep_attitude, link_radius=radii)
