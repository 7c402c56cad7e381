"""Arms imported from files, as momentum-level mathematics, and where the robots of example-robot-data lie."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from space_envs.dynamics.floating import FloatingRobot
from space_envs.dynamics.rotations import to_matrix
from space_envs.errors import ConfigurationError
from space_envs.robots.description.arms import DescribedArm
from space_envs.robots.description.importing.arms import imported_arms
from space_envs.robots.description.importing.files.packages import resolve
from space_envs.robots.description.reading import ARM_KEYS
from space_envs.robots.description.tables import DescriptionTable
from space_envs.robots.inertias import combined, matrix


def imported(*arms: dict[str, Any], folder: Path = Path(), **packages: Path) -> list[DescribedArm]:
    """Arms of tables as in a description file in a folder."""
    tables = [
        DescriptionTable(arm, folder / "robot.toml", f"arm {number}", ARM_KEYS)
        for number, arm in enumerate(arms, start=1)
    ]
    return imported_arms(tables, packages)


def example_robot(name: str) -> Path:
    """A file of example-robot-data; the test is skipped where that package is not installed."""
    try:
        return resolve(f"package://example-robot-data/robots/{name}", Path(__file__), {})
    except ConfigurationError:
        pytest.skip("example-robot-data is not installed")


def mechanics(arms: Sequence[DescribedArm]) -> FloatingRobot:
    """Mathematics of arms on their root."""
    links = [link for arm in arms for link in arm.links]
    base = combined([arm.root for arm in arms if arm.root])
    bodies = [base, *(link.inertial for link in links)]
    parents, first = [], 0
    for arm in arms:
        parents += [0, *range(first + 1, first + len(arm.links))]
        first += len(arm.links)
    ends = np.cumsum([len(arm.links) for arm in arms])
    return FloatingRobot(
        parent=np.array(parents),
        offset=np.array([link.position for link in links]),
        mounting=to_matrix(np.array([link.orientation for link in links])),
        hinge=np.array([link.joint.axis for link in links]),
        rotor_inertia=np.array([link.joint.rotor_inertia for link in links]),
        mass=np.array([body.mass for body in bodies]),
        com=np.array([body.centre for body in bodies]),
        inertia=np.array([matrix(body) for body in bodies]),
        end_effector_link=ends,
        end_effector_offset=np.array([arm.tool_position for arm in arms]),
        end_effector_mounting=to_matrix(np.array([arm.tool_orientation for arm in arms])),
        range=np.array([link.joint.range for link in links]),
        home=np.array([link.joint.home for link in links]),
    )
