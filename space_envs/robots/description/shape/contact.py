"""The contact shape of an arm: capsules around its links, and what they are checked against."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from space_envs.dynamics.capsules import box_distance
from space_envs.dynamics.rotations import exponential
from space_envs.robots.description.shape.clouds import Cloud
from space_envs.robots.description.shape.enclosing import Segment
from space_envs.robots.description.shape.grouping import link_capsules
from space_envs.robots.pose import Pose
from space_envs.robots.robot import ORIGIN, UNCHECKED, Anchor, Capsule, Link, Satellite, Vector3

END_EFFECTOR = "end_effector"
_SHARE, _THINNEST = 0.08, 0.02  # radius of links without geometry: of their length, and m at least
_SHORT = 1e-6  # m
_SAMPLES, _SEED = 256, 20  # configurations in which capsules and satellite are tested


class ContactShape(NamedTuple):
    """Anchors and capsules as of an `Arm`, and sentences about them."""

    anchors: tuple[Anchor, ...]
    capsules: tuple[Capsule, ...]
    notes: tuple[str, ...]


def contact_shape(
    links: Sequence[Link], tool: Vector3, solids: Sequence[Sequence[Cloud]], satellite: Satellite
) -> ContactShape:
    """Capsules around the links of an arm.

    Args:
        links: of the arm, the first in the satellite's frame. tool: in the last link's frame, m.
        solids: geometry of each link in its frame, or empty; a link without any has a capsule along its axis.
        satellite: that carries the arm.
    """
    ends = [link.position for link in links[1:]] + [tool]
    segments, bare = [], []
    rows = zip(links, solids or ((),) * len(links), ends, strict=True)
    for number, (link, clouds, end) in enumerate(rows, start=1):
        if clouds:
            segments += [(number, segment) for segment in link_capsules(clouds)]
        elif np.linalg.norm(end) > _SHORT:
            segments.append((number, _along(end)))
            bare.append(link.name)
    notes = [f"links without collision geometry have capsules along their axes: {', '.join(bare)}."]
    radii, more = _satellite_radii(links, segments, satellite)
    return ContactShape(*_capsules(links, tool, segments, radii), (*(notes if bare else []), *more))


def _along(end: Vector3) -> Segment:
    radius = max(_SHARE * float(np.linalg.norm(end)), _THINNEST)
    return Segment(np.array(ORIGIN), np.array(end), round(radius, 4))


def _capsules(
    links: Sequence[Link], tool: Vector3, segments: Sequence[tuple[int, Segment]], radii: Sequence[float]
) -> tuple[tuple[Anchor, ...], tuple[Capsule, ...]]:
    anchors: list[Anchor] = []
    capsules = []
    for place, ((number, segment), satellite) in enumerate(zip(segments, radii, strict=True), start=1):
        places = []
        for word, point in (("start", segment.start), ("end", segment.end)):
            anchor = Anchor(number, Pose.of(point).vector, f"capsule{place}_{word}")
            if number == len(links) and anchor.at == tool:
                anchor = Anchor(number, tool, END_EFFECTOR)
            places.append(len(anchors))
            anchors.append(anchor)
        start, end = places
        last = number == len(links)
        target = _target_radius(segment, tool) if last else segment.radius
        capsules.append(Capsule(number, start, end, segment.radius, satellite, target))
    return tuple(anchors), tuple(capsules)


def _target_radius(segment: Segment, tool: Vector3) -> float:
    """Radius of a capsule of the last link in checks against the target, which its gripper touches.

    The centre line alone; nothing if it runs past the tool, seen from the joint, into what is grasped.
    """
    point = np.array(tool)
    middle = (segment.start + segment.end) / 2
    toward = point if np.linalg.norm(point) > _SHORT else point - middle
    beyond = max((end - point) @ toward for end in (segment.start, segment.end))
    return UNCHECKED if beyond > 0.0 else 0.0


def _satellite_radii(
    links: Sequence[Link], segments: Sequence[tuple[int, Segment]], satellite: Satellite
) -> tuple[list[float], list[str]]:
    """Radius of each capsule in checks against the satellite, and notes.

    At most half the distance that the centre line has at some angles: a link next to the mount would touch
    the satellite, or nearly, in any configuration. Less where it would at home.
    """
    poses, centre = _link_poses(links), np.array(satellite.box_centre)
    radii, mounted, thin = [], [], []
    for number, segment in segments:
        start, end = (poses[number - 1].point(point) - centre for point in (segment.start, segment.end))
        distance = box_distance(start, end, np.array(satellite.box))
        near = distance[0] / 2 if distance[0] < segment.radius else np.inf
        radius = min(segment.radius, distance.max() / 2, near)
        radii.append(round(float(radius), 4) if radius > 0.0 else UNCHECKED)
        if radius <= 0.0:
            mounted.append(links[number - 1].name)
        elif radius < segment.radius:
            thin.append(links[number - 1].name)
    notes = {
        "links inside the satellite at home or at all angles are not checked against it": mounted,
        "links next to the satellite are checked against it with thinner capsules": thin,
    }
    return radii, [f"{words}: {', '.join(dict.fromkeys(names))}." for words, names in notes.items() if names]


def _link_poses(links: Sequence[Link]) -> list[Pose]:
    """Poses of the links at home and at random angles in the ranges, with a leading axis of samples."""
    rng = np.random.default_rng(_SEED)
    low, high = np.array([link.joint.range for link in links]).T
    home = np.array([link.joint.home for link in links])
    angles = np.concatenate([home[None], rng.uniform(low, high, (_SAMPLES, len(links)))])
    pose, poses = Pose.of(), []
    for link, angle in zip(links, angles.T, strict=True):
        hinge = Pose(np.zeros(3), exponential(angle[:, None] * np.array(link.joint.axis)))
        pose = pose @ Pose.of(link.position, link.orientation) @ hinge
        poses.append(pose)
    return poses
