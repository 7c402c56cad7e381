"""Links and joints of a URDF document as a tree, with the errors of one that is none."""

import xml.etree.ElementTree as ET
from collections import Counter
from dataclasses import dataclass

from space_envs.errors import ConfigurationError, unknown_name

JOINT_TYPES = ("revolute", "continuous", "prismatic", "fixed", "floating", "planar")


@dataclass(frozen=True)
class Structure:
    """The tree of a URDF document.

    Attributes:
        links: elements by name. order: names of links, parents before their children.
        parent: link that carries each link but the root. joint_above: the joint between them.
    """

    links: dict[str, ET.Element]
    order: list[str]
    parent: dict[str, str]
    joint_above: dict[str, ET.Element]


def structure_of(root: ET.Element) -> Structure:
    """The tree of links of a URDF document.

    Raises:
        ConfigurationError: for duplicate names, joints without links, closed chains and several roots.
    """
    links = _named(root, "link")
    if not links:
        raise ConfigurationError("it has no <link>")
    parent, above = _joints(_named(root, "joint"), links)
    return Structure(links, _order(links, parent), parent, above)


def _named(root: ET.Element, tag: str) -> dict[str, ET.Element]:
    elements = root.findall(tag)
    names = [element.get("name", "") for element in elements]
    if "" in names:
        raise ConfigurationError(f"<{tag}> number {names.index('') + 1} has no name")
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise ConfigurationError(f"{_counted(tag, twice)} defined more than once: names must be unique")
    return dict(zip(names, elements, strict=True))


def _joints(
    joints: dict[str, ET.Element], links: dict[str, ET.Element]
) -> tuple[dict[str, str], dict[str, ET.Element]]:
    """Parents of the links, and the joints between."""
    parent: dict[str, str] = {}
    above: dict[str, ET.Element] = {}
    for name, joint in joints.items():
        if joint.get("type") not in JOINT_TYPES:
            raise unknown_name(f"type of joint {name!r}", joint.get("type"), JOINT_TYPES)
        upper, lower = (_end(name, joint, tag, links) for tag in ("parent", "child"))
        if lower in parent:
            other = above[lower].get("name")
            raise ConfigurationError(
                f"link {lower!r} has two parents: joint {other!r} hangs it on {parent[lower]!r}, joint "
                f"{name!r} on {upper!r}. This is a closed chain; a robot here is a tree: remove one of the "
                "two joints"
            )
        parent[lower], above[lower] = upper, joint
    return parent, above


def _end(name: str, joint: ET.Element, tag: str, links: dict[str, ET.Element]) -> str:
    element = joint.find(tag)
    link = None if element is None else element.get("link")
    if not link:
        raise ConfigurationError(f'joint {name!r} has no <{tag} link="..."/>')
    if link not in links:
        raise unknown_name(f"{tag} link of joint {name!r}:", link, links)
    return link


def _order(links: dict[str, ET.Element], parent: dict[str, str]) -> list[str]:
    """Links, parents before their children; in depth, as in the file."""
    roots = [name for name in links if name not in parent]
    if len(roots) > 1:
        raise ConfigurationError(
            f"it has {len(roots)} root links, {', '.join(map(repr, roots))}: nothing connects them. Add the "
            "missing <joint>, or remove the links that belong to no robot"
        )
    children: dict[str, list[str]] = {}
    for lower, upper in parent.items():
        children.setdefault(upper, []).append(lower)
    order, waiting = [], roots
    while waiting:
        order.append(waiting.pop())
        waiting.extend(reversed(children.get(order[-1], [])))
    if loop := [name for name in links if name not in order]:
        raise ConfigurationError(
            f"{_counted('link', loop)} part of a closed chain that no root carries; a robot here is a tree"
        )
    return order


def _counted(tag: str, names: list[str]) -> str:
    """Subject and verb of a sentence about one or several names."""
    one = len(names) == 1
    return f"{tag}{'' if one else 's'} {', '.join(map(repr, names))} {'is' if one else 'are'}"
