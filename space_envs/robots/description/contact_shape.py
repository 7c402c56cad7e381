"""The contact shape of an arm that its description gives explicitly: capsules between named points."""

from typing import Any

from space_envs.errors import shown, unknown_name
from space_envs.robots.description.tables import DescriptionTable
from space_envs.robots.models.bodies import END_EFFECTOR
from space_envs.robots.robot import UNCHECKED, Anchor, Capsule, Vector3

POINT_KEYS = ("link", "at")
CAPSULE_KEYS = ("link", "start", "end", "radius", "satellite", "target")
TOOL = "tool"
_UNCHECKED_WORD = "unchecked"


def explicit_shape(
    arm: DescriptionTable, links: int, tool: Vector3
) -> tuple[tuple[Anchor, ...], tuple[Capsule, ...]]:
    """Anchors and capsules from the keys `points` and `capsules` of an arm.

    Ends of capsules are named: `link3` is the origin of a link's frame, `tool` the end-effector, and other
    names are those of `points`.

    Args:
        arm: its table. links: number of links. tool: (3,) position of the end-effector in the last link, m.

    Raises:
        ConfigurationError: for an unknown point, link or key, or an invalid radius.
    """
    names = {f"link{number}": Anchor(number) for number in range(1, links + 1)}
    names[TOOL] = Anchor(links, tool, END_EFFECTOR)
    points = arm.get("points", {})
    for name, value in points.items() if isinstance(points, dict) else ():
        point = DescriptionTable(value, arm.file, f"{arm.name}.points.{name}", POINT_KEYS)
        names[name] = Anchor(_link(point, links), point.vector("at", 3), name)
    anchors: list[Anchor] = []
    capsules = []
    for row in arm.tables("capsules", CAPSULE_KEYS):
        start, end = (_place(row, key, names, anchors) for key in ("start", "end"))
        radius = UNCHECKED if row.get("radius") == _UNCHECKED_WORD else row.positive("radius")
        satellite, target = (_radius(row, key, radius) for key in ("satellite", "target"))
        capsules.append(Capsule(_link(row, links), start, end, radius, satellite, target))
    if not capsules:
        raise arm.error("capsules must be a list of tables, got an empty list")
    return tuple(anchors), tuple(capsules)


def _link(row: DescriptionTable, links: int) -> int:
    value = row.get("link")
    if not isinstance(value, int) or isinstance(value, bool) or not 1 <= value <= links:
        raise row.error(f"link must be a whole number from 1 to {links}, got {shown(value)}")
    return value


def _place(row: DescriptionTable, key: str, names: dict[str, Anchor], anchors: list[Anchor]) -> int:
    """Place of a named point among the anchors, to which it is added at its first use."""
    name = row.text(key)
    if name not in names:
        raise row.error(f"{key}: {unknown_name('point', name, names)}")
    if names[name] not in anchors:
        anchors.append(names[name])
    return anchors.index(names[name])


def _radius(row: DescriptionTable, key: str, default: float) -> float:
    """Radius in checks against a body: a number of at least 0, or the word `unchecked`."""
    value: Any = row.get(key, default)
    if value in (_UNCHECKED_WORD, UNCHECKED):
        return UNCHECKED
    radius = row.number(key, default)
    if radius < 0.0:
        raise row.error(f"{key} must be at least 0 m or {_UNCHECKED_WORD!r}, got {shown(value)}")
    return radius
