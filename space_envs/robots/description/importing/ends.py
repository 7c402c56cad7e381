"""Root and tool of an arm in a robot file, by their names or as the only ones that can be meant."""

from collections.abc import Iterable

from space_envs.errors import ConfigurationError, unknown_name
from space_envs.robots.description.importing.files.tree import HINGE, SLIDE, FileTree, Frame
from space_envs.robots.description.importing.source import ArmSource
from space_envs.robots.pose import Pose

_SHOWN = 8  # names of possible tools


def root_of(tree: FileTree, source: ArmSource) -> int:
    """Place of the body that a source fixes to the satellite.

    Raises:
        ConfigurationError: for an unknown name, or several robots in the world of MJCF.
    """
    if source.root is None:
        return _default_root(tree)
    names = [body.name for body in tree.bodies]
    return names.index(found_name("root link", source.root, names, source.prefix))


def tool_of(tree: FileTree, root: int, source: ArmSource) -> Frame:
    """The end-effector's frame of a source.

    Raises:
        ConfigurationError: for an unknown name, or several links that can be meant.
    """
    return _only_tool(tree, root, source.prefix) if source.tool is None else _named_tool(tree, source)


def found_name(kind: str, name: str, valid: Iterable[str], prefix: str) -> str:
    """The name in a file that is meant: itself, or with the prefix.

    Raises:
        ConfigurationError: with the nearest name.
    """
    known = list(valid)
    for candidate in (name, f"{prefix}{name}"):
        if candidate in known:
            return candidate
    raise unknown_name(kind, name, known)


def _default_root(tree: FileTree) -> int:
    """The root of a URDF; in MJCF, what carries the only robot: its base, or the world."""
    if tree.format == "urdf":
        return 0
    tops = [top for top in tree.children(0) if _has_arm(tree, top)]
    if len(tops) > 1:
        names = ", ".join(repr(tree.bodies[top].name) for top in tops)
        raise ConfigurationError(f'the world carries several robots, {names}: write which: root = "..."')
    if not tops or _has_single_joint(tree, tops[0]):
        return 0
    return tops[0]


def _has_arm(tree: FileTree, top: int) -> bool:
    """Whether a body of the world carries hinges or slides; others are scenery."""
    return any(_has_single_joint(tree, body) for body in _subtree(tree, top))


def _has_single_joint(tree: FileTree, body: int) -> bool:
    return any(joint.kind in (HINGE, SLIDE) for joint in tree.bodies[body].joints)


def _subtree(tree: FileTree, top: int) -> list[int]:
    found = [top]
    for place in range(top + 1, len(tree.bodies)):
        if tree.bodies[place].parent in found:
            found.append(place)
    return found


def _named_tool(tree: FileTree, source: ArmSource) -> Frame:
    bodies = {body.name: Frame(place, Pose.of()) for place, body in enumerate(tree.bodies)}
    frames = {**bodies, **tree.frames}
    return frames[found_name("tool", str(source.tool), frames, source.prefix)]


def _only_tool(tree: FileTree, root: int, prefix: str) -> Frame:
    below = [place for place in _subtree(tree, root) if tree.bodies[place].name.startswith(prefix)]
    leaves = {place: _moving_between(tree, root, place) for place in below if not tree.children(place)}
    moved = [place for place, count in leaves.items() if count]
    if len(moved) == 1:
        return Frame(moved[0], Pose.of())
    farthest = sorted(moved or leaves, key=lambda place: -leaves[place])
    names = ", ".join(repr(tree.bodies[place].name) for place in farthest[:_SHOWN])
    more = f" and {len(farthest) - _SHOWN} others" if len(farthest) > _SHOWN else ""
    raise ConfigurationError(
        f"the tool must be named, since several links are last in their branches: {names}{more}. Write one "
        "of "
        'the links as tool = "..."'
    )


def _moving_between(tree: FileTree, root: int, body: int) -> int:
    """Number of joints between the root and a body."""
    path = tree.path_to(body)
    return sum(len(tree.bodies[place].joints) for place in path[path.index(root) + 1 :])
