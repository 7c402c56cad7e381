"""Masses, inertias and lengths of a robot, and what its torques move."""

from dataclasses import dataclass

import numpy as np

from space_envs.dynamics.rotations import Array
from space_envs.robots.models.accelerations import reduced_masses
from space_envs.robots.models.mechanics import robot_mechanics
from space_envs.robots.robot import Arm, Link, Robot


@dataclass(frozen=True)
class LinkFigures:
    """Mass properties of a link.

    Attributes:
        name: in the robot's file. arm, number: of the link, from 1. mass: kg.
        moments: kg m^2, principal, about the centre of mass.
        length: m, from the link's joint to the next or to the tool. centre: m, of mass from the joint.
    """

    name: str
    arm: int
    number: int
    mass: float
    moments: tuple[float, float, float]
    length: float
    centre: float

    @property
    def gyration(self) -> float:
        """Largest radius of gyration about the centre of mass, m; length / sqrt(12) for a thin rod."""
        return float(np.sqrt(max(self.moments) / self.mass))


@dataclass(frozen=True)
class MassFigures:
    """Mass properties of the whole robot at home.

    Attributes:
        satellite: kg. satellite_moments: kg m^2, principal. links: arm by arm.
        centre: of mass of the whole robot in the satellite's frame, m.
        moments: of the whole robot about it, kg m^2, principal, the smallest first.
        reach: of each arm, largest distance of its end-effector from the centre of mass, m.
    """

    satellite: float
    satellite_moments: tuple[float, ...]
    links: tuple[LinkFigures, ...]
    centre: tuple[float, ...]
    moments: tuple[float, ...]
    reach: tuple[float, ...]

    @property
    def arms(self) -> float:
        """Mass of all links, kg."""
        return sum(link.mass for link in self.links)

    @property
    def total(self) -> float:
        """Mass of the whole robot, kg."""
        return self.satellite + self.arms


@dataclass(frozen=True)
class TorqueFigures:
    """Accelerations (n) that the torque limits give at the worst of many configurations, rad/s^2.

    Attributes:
        alone: of each joint, the others free of acceleration. together: of all joints at once, whatever their
            directions, as far as each joint's own torque goes.
    """

    alone: tuple[float, ...]
    together: tuple[float, ...]


def torque_figures(robot: Robot) -> TorqueFigures:
    """Accelerations that a robot's torques give."""
    masses = np.abs(reduced_masses(robot))
    alone = robot.torque_limit / np.diagonal(masses, axis1=1, axis2=2)
    together = robot.torque_limit / masses.sum(axis=2)
    return TorqueFigures(tuple(alone.min(axis=0).tolist()), tuple(together.min(axis=0).tolist()))


def mass_figures(robot: Robot) -> MassFigures:
    """Mass properties of a robot."""
    tree = robot_mechanics(robot)
    kinematics = tree.kinematics(robot.home)
    centre = tree.centre_of_mass(kinematics)
    rotation = np.concatenate([np.eye(3)[None], kinematics.rotation])
    place = np.concatenate([tree.com[:1], kinematics.com]) - centre
    inertia = (rotation @ tree.inertia @ rotation.swapaxes(1, 2)).sum(axis=0)
    inertia = inertia + (tree.mass[:, None, None] * _parallel(place)).sum(axis=0)
    return MassFigures(
        robot.satellite.inertial.mass,
        tuple(robot.satellite.inertial.moments),
        tuple(figures for number, arm in enumerate(robot.arms, 1) for figures in _links(arm, number)),
        tuple(centre.tolist()),
        tuple(np.linalg.eigvalsh(inertia).tolist()),
        tuple(tree.reach(index) for index in range(len(robot.arms))),
    )


def link_axis(arm: Arm, number: int) -> Array:
    """Vector (3,) from the joint of a link, numbered from 1, to the next joint or tool, in its frame, m."""
    last = number == len(arm.links)
    return np.array(arm.tool_position if last else arm.links[number].position)


def _links(arm: Arm, number: int) -> list[LinkFigures]:
    return [_link(arm, number, place, link) for place, link in enumerate(arm.links, start=1)]


def _link(arm: Arm, arm_number: int, number: int, link: Link) -> LinkFigures:
    inertial = link.inertial
    length = float(np.linalg.norm(link_axis(arm, number)))
    centre = float(np.linalg.norm(inertial.centre))
    return LinkFigures(link.name, arm_number, number, inertial.mass, inertial.moments, length, centre)


def _parallel(place: Array) -> Array:
    """Inertia (..., 3, 3) of unit masses at places (..., 3), m^2."""
    square = (place * place).sum(axis=-1)[..., None, None] * np.eye(3)
    return square - place[..., :, None] * place[..., None, :]
