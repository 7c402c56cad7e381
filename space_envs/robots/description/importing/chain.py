"""The chain of joints from the root to the tool of an arm, and what the other joints are fixed at."""

from collections.abc import Iterable
from typing import NamedTuple

from space_envs.checks import number
from space_envs.errors import ConfigurationError, unknown_name
from space_envs.robots.description.importing.files.tree import HINGE, SLIDE, FileJoint, FileTree, Frame
from space_envs.robots.description.importing.source import ArmSource
from space_envs.robots.pose import Pose

_SHOWN = 8  # names of possible tools


class JointChain(NamedTuple):
    """An arm in a file.

    Attributes:
        root: place of the body that is fixed to the satellite. tool: the end-effector's frame.
        moving: places of the bodies with the arm's joints, outwards. joints: those joints.
    """

    root: int
    tool: Frame
    moving: tuple[int, ...]
    joints: tuple[FileJoint, ...]


def find_chain(tree: FileTree, source: ArmSource) -> JointChain:
    """The arm that a source asks for.

    Raises:
        ConfigurationError: for names that the file does not have, a tool that the root does not carry, and
            joints that no arm here can have.
    """
    names = [body.name for body in tree.bodies]
    root = (
        names.index(found_name("root link", source.root, names, source.prefix))
        if source.root is not None
        else _default_root(tree)
    )
    tool = _named_tool(tree, source) if source.tool is not None else _only_tool(tree, root, source.prefix)
    path = tree.path_to(tool.body)
    if root not in path:
        raise ConfigurationError(
            f"the tool {source.tool!r} is not carried by the root {names[root]!r}; what carries it is "
            f"{' > '.join(names[body] for body in path)}"
        )
    locked = set(lock_values(tree, source))
    moving, joints = [], []
    for body in path[path.index(root) + 1 :]:
        free = [joint for joint in tree.bodies[body].joints if joint.name not in locked]
        if len(free) > 1:
            raise ConfigurationError(
                f"body {names[body]!r} has {len(free)} joints, {', '.join(j.name for j in free)}; a link "
                "here has one: put a body with mass between them, or lock all but one"
            )
        for joint in free:
            _check_joint(tree, joint)
            moving.append(body)
            joints.append(joint)
    if not moving:
        raise ConfigurationError(
            f"no joint moves the tool {_tool_name(tree, tool, source)!r} against the root {names[root]!r}: "
            "they are fixed to each other, or every joint between them is locked"
        )
    _check_couplings(tree, path[path.index(root) + 1 :])
    return JointChain(root, tool, tuple(moving), tuple(joints))


def lock_values(tree: FileTree, source: ArmSource) -> dict[str, float]:
    """Values of the joints that a source locks, rad or m.

    Raises:
        ConfigurationError: for unknown joints and values outside of a joint's range.
    """
    joints = tree.joints
    values = {}
    for name, value in source.lock.items():
        joint = joints[found_name("joint in lock", name, joints, source.prefix)]
        values[joint.name] = number(f"lock of joint {joint.name!r}", value)
        low, high = joint.range or (-float("inf"), float("inf"))
        if not low - 1e-9 <= values[joint.name] <= high + 1e-9:
            raise ConfigurationError(
                f"joint {joint.name!r} is locked at {values[joint.name]:g}, outside of its range "
                f"{low:g} to {high:g}"
            )
        if joint.kind not in (HINGE, SLIDE) and values[joint.name]:
            raise ConfigurationError(
                f"joint {joint.name!r} is {joint.kind}; it can be locked at 0 only, got {value}"
            )
    return values


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


def _tool_name(tree: FileTree, tool: Frame, source: ArmSource) -> str:
    return source.tool or tree.bodies[tool.body].name


def _check_joint(tree: FileTree, joint: FileJoint) -> None:
    """Reject a joint between root and tool that is not a hinge of its own."""
    if joint.mimic is not None:
        raise ConfigurationError(
            f"joint {joint.name!r} mimics {joint.mimic.leader!r}; a joint between root and tool moves by "
            f"itself. Lock it (lock = {{ {joint.name} = 0.0 }}), or remove <mimic> from the file"
        )
    if joint.kind == "floating":
        raise ConfigurationError(
            f"joint {joint.name!r} between root and tool is floating: the file has a floating base above the "
            "arm. Name the link below it as root: it is fixed to the satellite, which floats"
        )
    if joint.kind != HINGE:
        raise ConfigurationError(
            f"joint {joint.name!r} between root and tool is {joint.kind}, and arms here have hinges only. "
            f"Lock it (lock = {{ {joint.name} = 0.0 }}), or choose a root or tool without it in between"
        )
    if joint.name in tree.coupled:
        raise ConfigurationError(
            f"an equality constraint couples joint {joint.name!r} with another; a joint between root and "
            "tool moves by itself. Remove the constraint, or lock the joint"
        )


def _check_couplings(tree: FileTree, bodies: list[int]) -> None:
    for body in bodies:
        name = tree.bodies[body].name
        if name in tree.coupled:
            raise ConfigurationError(
                f"an equality constraint ({tree.coupled[name]}) closes a chain at body {name!r}, between "
                "root and tool; a robot here is a tree: remove the constraint"
            )
