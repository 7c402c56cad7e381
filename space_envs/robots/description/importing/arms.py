"""Arms from URDF and MJCF files, normalised to the numbers of a `Robot`."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from space_envs.errors import ConfigurationError
from space_envs.robots.description.importing.chain import Chain, find_chain, lock_values
from space_envs.robots.description.importing.files.document import read_document
from space_envs.robots.description.importing.files.mjcf import read_mjcf
from space_envs.robots.description.importing.files.packages import Packages
from space_envs.robots.description.importing.files.tree import FileTree
from space_envs.robots.description.importing.files.urdf import read_urdf
from space_envs.robots.description.importing.geometry import drawings
from space_envs.robots.description.importing.limits import joint_limits
from space_envs.robots.description.importing.links import arm_of
from space_envs.robots.description.importing.plausible import inertia_problem
from space_envs.robots.description.importing.rigid import Assembly, assemble
from space_envs.robots.description.importing.source import ArmSource, ImportedArms
from space_envs.robots.inertia import lumped, moved
from space_envs.robots.pose import Pose
from space_envs.robots.robot import Arm, Inertial, Vector3, Visual


def import_arms(sources: Sequence[ArmSource], box: Vector3) -> ImportedArms:
    """Read one or two arms.

    Two arms of the same file, root and mount are two branches of one robot: what is fixed to its root counts
    once. Otherwise, each is a copy of its own.

    Args:
        sources: of the arms. box: half sides of the satellite, around the origin of its frame, m.

    Raises:
        ConfigurationError: for files that cannot be read and robots that are none of this suite; the message
            says what was found, where, and what to write.
    """
    arms: dict[int, Arm] = {}
    fixed: list[Inertial] = []
    visuals: list[Visual] = []
    notes: list[str] = []
    for places in _together(sources):
        group = [sources[place] for place in places]
        with _in_file(group[0].file):
            found = _import_group(group, box)
        arms |= dict(zip(places, found.arms, strict=True))
        fixed.append(found.fixed)
        visuals += found.visuals
        notes += [f"{group[0].file.name}: {note}" for note in found.notes]
    ordered = tuple(arms[place] for place in range(len(sources)))
    return ImportedArms(ordered, lumped(fixed), tuple(visuals), tuple(dict.fromkeys(notes)))


@contextmanager
def _in_file(file: Path) -> Iterator[None]:
    """Name the file in errors that do not."""
    try:
        yield
    except ConfigurationError as error:
        if str(file) in str(error):
            raise
        raise ConfigurationError(f"{file}: {error}") from None


def _together(sources: Sequence[ArmSource]) -> list[list[int]]:
    """Places of the sources that are branches of one robot."""
    groups: dict[object, list[int]] = {}
    for place, source in enumerate(sources):
        key = (source.file.resolve(), source.root, source.position, source.orientation)
        groups.setdefault(key, []).append(place)
    return [*groups.values()]


def _import_group(sources: Sequence[ArmSource], box: Vector3) -> ImportedArms:
    """Arms that are branches of one robot."""
    tree = read_robot_file(sources[0].file, sources[0].packages)
    chains = [find_chain(tree, source) for source in sources]
    _check_disjoint(chains)
    values = {name: value for source in sources for name, value in lock_values(tree, source).items()}
    moving = [joint.name for chain in chains for joint in chain.joints]
    assembly = assemble(tree, chains[0].root, moving, values)
    notes = [*tree.notes, *_structure_notes(assembly, moving, values), *_inertia_notes(assembly)]
    arms, problems = [], []
    for chain, source in zip(chains, sources, strict=True):
        joints, more = joint_limits(tree, chain, source)
        arm, others = arm_of(assembly, chain, joints, source, box)
        arms.append(arm)
        notes += more + others
    mount = Pose.of(sources[0].position, sources[0].orientation)
    visuals, problems = drawings(assembly.shapes(chains[0].root))
    placed = tuple(_placed(mount, visual) for visual in visuals)
    return ImportedArms(
        tuple(arms), moved(assembly.inertial(chains[0].root), mount), placed, (*notes, *problems)
    )


def read_robot_file(file: Path, packages: Packages) -> FileTree:
    """The robot of a URDF or MJCF file.

    Raises:
        ConfigurationError: if it cannot be read.
    """
    kind, root = read_document(file)
    return read_urdf(file, root, packages) if kind == "urdf" else read_mjcf(file)


def _check_disjoint(chains: Sequence[Chain]) -> None:
    count = Counter(joint.name for chain in chains for joint in chain.joints)
    if shared := [name for name, number in count.items() if number > 1]:
        names = ", ".join(shared)
        raise ConfigurationError(
            f"both arms have the joints {names}: give them two tools, a mount each, or lock the joints that "
            f"they share (lock = {{ {shared[0]} = 0.0 }})"
        )


def _structure_notes(assembly: Assembly, moving: Sequence[str], values: Mapping[str, float]) -> list[str]:
    """Sentences about joints that are fixed and links without mass."""
    tree, notes = assembly.tree, []
    still = [
        joint
        for body in assembly.placed
        if body != assembly.root
        for joint in tree.bodies[body].joints
        if joint.name not in moving
    ]
    if locked := [f"{j.name} at {assembly.value(j):g}" for j in still if j.name in values]:
        notes.append(f"locked joints: {', '.join(locked)}.")
    if other := [f"{j.name} at {assembly.value(j):g}" for j in still if j.name not in values]:
        notes.append(f"joints that are not between root and tool are fixed: {', '.join(other)}.")
    bodies = [tree.bodies[body] for body in assembly.placed]
    if bare := [body.name for body in bodies if body.inertial is None and any(s.solid for s in body.shapes)]:
        notes.append(f"links without inertia count as massless: {', '.join(bare)}.")
    return notes


def _inertia_notes(assembly: Assembly) -> list[str]:
    """Sentences about inertias that no body has, in parts that are physical as a whole; errors of others."""
    notes = []
    for carrier in (assembly.root, *assembly.frames):
        found = [assembly.tree.bodies[body] for body, _ in assembly.members(carrier)]
        problems = [problem for body in found if (problem := inertia_problem(body.name, body.inertial))]
        whole = inertia_problem(assembly.tree.bodies[carrier].name, assembly.inertial(carrier))
        if whole is not None:
            raise ConfigurationError(problems[0] if problems else whole)
        notes += [
            f"{problem}. It is used, since with what is fixed to it, it is possible." for problem in problems
        ]
    return notes


def _placed(mount: Pose, visual: Visual) -> Visual:
    pose = mount @ Pose.of(visual.position, visual.orientation)
    return replace(visual, position=pose.vector, orientation=pose.quaternion)
