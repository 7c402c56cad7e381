"""The chain of joints from the root to the tool of an arm, and what the other joints are fixed at."""

from typing import NamedTuple

from space_envs.checks import number
from space_envs.errors import ConfigurationError
from space_envs.robots.description.importing.ends import found_name, root_of, tool_of
from space_envs.robots.description.importing.files.tree import HINGE, SLIDE, FileJoint, FileTree, Frame
from space_envs.robots.description.importing.source import ArmSource


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
    root = root_of(tree, source)
    tool = tool_of(tree, root, source)
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
