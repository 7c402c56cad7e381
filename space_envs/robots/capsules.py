"""Collision shapes: arms as chains of capsules, the satellite and the target as boxes.

One definition for the simulation, whose sensors measure the points of the chains, for the sampling of goals
and for planners. Parts that are in contact with a body by design have zero radius with respect to it: the arm
on the satellite's deck, and the gripper at the target.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco

from space_envs.robots.parameters import DUAL_ARM_PLANAR, DUAL_ARM_SPATIAL, SINGLE_ARM, TargetParameters

_IGNORED = float("-inf")  # m, radius of a link that is not checked


@dataclass(frozen=True)
class ArmShape:
    """One arm as capsules, S of them between S + 1 points that are fixed to its links.

    Attributes:
        points: names of the links' bodies, whose origins they are, and of sites; `{arm}` is the arm's number.
        link: (S,) number of the link that each capsule is part of.
        radius: m, of the capsules. satellite, target: (S,) m, radius of each in checks against that body;
            0 is the centre line alone, minus infinity no check.
        half: m, half a side of the satellite's cube; None if the arms cannot reach it.
        body: (3,) m, half sides of the target's box for each metre of the grapple points' distance from its
            centre; None for a task without a target body.
    """

    points: tuple[str, ...]
    link: tuple[int, ...]
    radius: float
    satellite: tuple[float, ...]
    target: tuple[float, ...] = ()
    half: float | None = None
    body: tuple[float, ...] | None = None


_R, _r = SINGLE_ARM.link_radius, DUAL_ARM_SPATIAL.link_radius


def _per_metre(target: TargetParameters) -> tuple[float, float, float]:
    """Half sides of the target's box for each metre of its half width."""
    x, y, z = target.body
    return x / target.half_width, y / target.half_width, z / target.half_width


# Link 1 is the pillar within the satellite, link 2 has no length, and link 3 rotates on the deck.
SINGLE_ARM_SHAPE = ArmShape(
    points=("root", "link4", "link5", "link6", "link7", "end_effector"),
    link=(3, 4, 5, 6, 7),
    radius=_R,
    satellite=(0.0, _R, _R, _R, _R),
    half=SINGLE_ARM.satellite_side / 2,
)
# The arms rotate in a plane above the satellite's deck, in which the target lies.
PLANAR_SHAPE = ArmShape(
    points=("arm{arm}_link1", "arm{arm}_link2", "arm{arm}_link3", "gripper{arm}", "end_effector{arm}"),
    link=(1, 2, 3, 3),
    radius=DUAL_ARM_PLANAR.link_radius,
    satellite=(_IGNORED,) * 4,
    target=(DUAL_ARM_PLANAR.link_radius,) * 3 + (0.0,),
    body=_per_metre(DUAL_ARM_PLANAR.target),
)
# Link 1 is the pillar on the satellite's face, and link 2 has no length.
SPATIAL_SHAPE = ArmShape(
    points=(
        *(f"arm{{arm}}_link{number}" for number in (1, 3, 4, 5, 6, 7)),
        "gripper{arm}",
        "end_effector{arm}",
    ),
    link=(1, 3, 4, 5, 6, 7, 7),
    radius=_r,
    satellite=(_IGNORED, *(_r,) * 6),
    target=(_r,) * 6 + (0.0,),
    half=DUAL_ARM_SPATIAL.satellite_side / 2,
    body=_per_metre(DUAL_ARM_SPATIAL.target),
)


def point_names(shape: ArmShape, arms: Sequence[int]) -> list[str]:
    """Names of all points of all arms, arm by arm."""
    return [name.format(arm=arm) for arm in arms for name in shape.points]


def add_point_sensors(spec: mujoco.MjSpec, shape: ArmShape, arms: Sequence[int], frame: str) -> None:
    """Add sensors `{point}_in_{frame}` of all points, in the frame of a body, one after another."""
    sites = {site.name for site in spec.sites}
    body, site = mujoco.mjtObj.mjOBJ_XBODY, mujoco.mjtObj.mjOBJ_SITE
    for name in point_names(shape, arms):
        spec.add_sensor(
            name=f"{name}_in_{frame}",
            type=mujoco.mjtSensor.mjSENS_FRAMEPOS,
            objtype=site if name in sites else body,
            objname=name,
            reftype=body,
            refname=frame,
        )
