"""Tumbling targets: the goals of a dual-arm task, and the ranges that they are drawn from."""

from dataclasses import dataclass

from space_envs.dynamics.rotations import Array
from space_envs.tasks.common import Goals

HALF_WIDTH = 0.3  # m


@dataclass(frozen=True)
class TargetGoals(Goals):
    """Targets at the start of an episode.

    Attributes:
        position: (K, 3) m, centre, inertial frame, at rest. quaternion: (K, 4), body to inertial.
        angular_velocity: (K, 3) rad/s, inertial axes. half_width: (K,) m, grapple points from the centre.
    """

    position: Array
    quaternion: Array
    angular_velocity: Array
    half_width: Array


@dataclass(frozen=True)
class Draws:
    """Ranges that goals are drawn from around the nominal target of a robot: easy, medium, hard.

    Attributes:
        reach: m, of arms for which displacements are these; they are smaller for shorter arms.
        displacement: m, largest of the target's centre, along each axis.
        rotation: rad, largest rotation of the target from its nominal attitude, at the rendezvous.
        spin: rad/s, largest. start: rad, largest displacement of a joint from home.
        half_width: m, least and largest, of a target with nominally `HALF_WIDTH`; in proportion for others.
        along: 1 for the axes that the centre is displaced along, else 0.
    """

    reach: float
    displacement: tuple[float, float, float]
    rotation: tuple[float, float, float]
    spin: tuple[float, float, float]
    start: tuple[float, float, float]
    half_width: tuple[float, float]
    along: tuple[float, float, float] = (1.0, 1.0, 1.0)
