"""Imported arms as momentum-level mathematics, and where the robots of example-robot-data lie."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from space_envs.dynamics.floating import FloatingRobot
from space_envs.errors import ConfigurationError
from space_envs.robots.description.importing.files.packages import resolve
from space_envs.robots.inertia import matrix
from space_envs.robots.pose import Pose
from space_envs.robots.robot import Arm, Inertial

BOX = (0.5, 0.5, 0.5)
FACE = (0.0, 0.0, 0.5)  # centre of a face of the box


def example_robot(name: str) -> Path:
    """A file of example-robot-data; the test is skipped where that package is not installed."""
    try:
        return resolve(f"package://example-robot-data/robots/{name}", Path(__file__), {})
    except ConfigurationError:
        pytest.skip("example-robot-data is not installed")


def mechanics(base: Inertial, arms: Sequence[Arm]) -> FloatingRobot:
    """Mathematics of arms on a base."""
    links = [link for arm in arms for link in arm.links]
    bodies = [base, *(link.inertial for link in links)]
    parents, first = [], 0
    for arm in arms:
        parents += [0, *range(first + 1, first + len(arm.links))]
        first += len(arm.links)
    ends = np.cumsum([len(arm.links) for arm in arms])
    return FloatingRobot(
        parent=np.array(parents),
        offset=np.array([link.position for link in links]),
        mounting=np.array([Pose.of(link.position, link.orientation).rotation for link in links]),
        hinge=np.array([link.joint.axis for link in links]),
        rotor_inertia=np.array([link.joint.rotor_inertia for link in links]),
        mass=np.array([body.mass for body in bodies]),
        com=np.array([body.centre for body in bodies]),
        inertia=np.array([matrix(body) for body in bodies]),
        end_effector_link=ends,
        end_effector_offset=np.array([arm.tool_position for arm in arms]),
        end_effector_mounting=np.array(
            [Pose.of(arm.tool_position, arm.tool_orientation).rotation for arm in arms]
        ),
        range=np.array([link.joint.range for link in links]),
        home=np.array([link.joint.home for link in links]),
    )
