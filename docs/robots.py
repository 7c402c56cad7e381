"""Tables of the papers' robots."""

from collections.abc import Sequence
from math import atan2, pi

from docs.reading import number, table
from space_envs.robots.robot import Arm, Inertial
from space_envs.robots.zoo import find_robot

FRAME = ("body", "alpha, rad", "a, m", "d, m")
_TITLE = {1: "link {}", 2: "link {} of each arm"}  # by the number of arms


def links() -> str:
    """Tables I and II of shyam2020, and the inertias of the physical variant."""
    header = (*FRAME, "mass, kg", "`paper` inertia, kg m^2", "`physical` inertia, kg m^2")
    return table(header, _rows("shyam2020", "paper", "physical"))


def planar_links() -> str:
    """Table I of shah2013."""
    robot = find_robot("shah2013")
    base = robot.satellite.inertial
    rows = [("satellite", "", number(base.mass), number(base.moments[2]))]
    for i, (link, frame) in enumerate(zip(robot.arms[0].links, _frames(robot.arms[0]), strict=True), start=1):
        inertial = link.inertial
        row = frame[1], number(inertial.mass), number(inertial.moments[2])
        rows.append((f"link {i} of each arm", *row))
    return table(("body", "length, m", "mass, kg", "Izz, kg m^2"), rows)


def spatial_links() -> str:
    """Links of the spatial dual-arm robot."""
    return table((*FRAME, "mass, kg", "inertia, kg m^2"), _rows("spatial_dual_arm", None))


def _rows(name: str, *variants: str | None) -> list[Sequence[str]]:
    """Denavit-Hartenberg parameters, masses and inertias of a robot's bodies, those of each variant."""
    robots = [find_robot(name, variant) for variant in variants]
    arms = [robot.arms[0] for robot in robots]
    rows: list[Sequence[str]] = [
        ("satellite", "", "", "", *_inertias([robot.satellite.inertial for robot in robots]))
    ]
    bodies = zip(*(arm.links for arm in arms), strict=True)
    for i, (frame, body) in enumerate(zip(_frames(arms[0]), bodies, strict=True), start=1):
        title = _TITLE[len(robots[0].arms)].format(i)
        rows.append((title, *frame, *_inertias([link.inertial for link in body])))
    return rows


def _inertias(variants: Sequence[Inertial]) -> list[str]:
    """Mass of a body, kg, and its principal inertias in each variant, kg m^2."""
    return [number(variants[0].mass), *(number(list(inertial.moments)) for inertial in variants)]


def _frames(arm: Arm) -> list[tuple[str, str, str]]:
    """Denavit-Hartenberg parameters alpha, a and d of each link: the pose of the next one in its frame."""
    poses = [(link.position, link.orientation) for link in arm.links[1:]]
    poses.append((arm.tool_position, arm.tool_orientation))
    return [(f"{2 * atan2(x, w) / pi:+g} pi", number(a), number(d)) for (a, _, d), (w, x, *_) in poses]
