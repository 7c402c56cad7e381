"""Arms from URDF and MJCF files, normalised to the numbers of a `Robot`."""

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace

from space_envs.errors import ConfigurationError
from space_envs.robots.description.arms import DescribedArm
from space_envs.robots.description.importing.chain import JointChain, find_chain, lock_values
from space_envs.robots.description.importing.files.document import read_document
from space_envs.robots.description.importing.files.mjcf import read_mjcf
from space_envs.robots.description.importing.files.packages import Packages
from space_envs.robots.description.importing.files.tree import FileTree
from space_envs.robots.description.importing.files.urdf import read_urdf
from space_envs.robots.description.importing.geometry import drawings
from space_envs.robots.description.importing.joints import file_limits, joints_of
from space_envs.robots.description.importing.links import described_arm
from space_envs.robots.description.importing.notes import assembly_notes, drawing_notes
from space_envs.robots.description.importing.rigid import RigidParts, assemble
from space_envs.robots.description.importing.source import ArmSource, arm_source
from space_envs.robots.description.tables import DescriptionTable


def imported_arms(tables: Sequence[DescriptionTable], packages: Packages) -> list[DescribedArm]:
    """The arms of tables with `file`, in their order.

    Two arms with the same file, root and mount are two branches of one robot: what is fixed to its root comes
    with the first. Otherwise, each is a copy of its own.

    Args:
        tables: of one or two arms. packages: where `package://NAME` lies, by name.

    Raises:
        ConfigurationError: for files that cannot be read and robots that are none of this suite; the message
            says what was found, where, and what to write.
    """
    sources = [arm_source(table, packages) for table in tables]
    if len(sources) == 2 and sources[1].is_branch_of(sources[0]):
        return _branches(sources)
    return [arm for source in sources for arm in _branches([source])]


def _branches(sources: Sequence[ArmSource]) -> list[DescribedArm]:
    """Arms that are branches of one robot."""
    with _named(sources[0]):
        tree = read_robot_file(sources[0])
    chains, values = [], {}
    for source in sources:
        with _named(source):
            chains.append(find_chain(tree, source))
            values |= lock_values(tree, source)
    with _named(sources[0]):
        _check_disjoint(chains)
        moving = [joint.name for chain in chains for joint in chain.joints]
        parts = assemble(tree, chains[0].root, moving, values)
        shared = [*tree.notes, *assembly_notes(parts)]
    arms = [_arm(parts, chain, source) for chain, source in zip(chains, sources, strict=True)]
    visuals, problems = drawings(parts.shapes(parts.root))
    first = replace(
        arms[0],
        root=parts.inertial(parts.root),
        root_visuals=visuals,
        notes=(*shared, *drawing_notes(problems), *arms[0].notes),
    )
    return [first, *arms[1:]]


def _arm(parts: RigidParts, chain: JointChain, source: ArmSource) -> DescribedArm:
    """An arm, without what is fixed to its root."""
    with _named(source):
        defaults = file_limits(parts.tree, chain)
    joints, notes = joints_of(chain, defaults, source)
    with _named(source):
        arm = described_arm(parts, chain, joints, "capsules" not in source.table)
    return replace(arm, notes=(*notes, *arm.notes))


@contextmanager
def _named(source: ArmSource) -> Iterator[None]:
    """Name the table and the file in errors."""
    try:
        yield
    except ConfigurationError as error:
        text = str(error) if str(source.file) in str(error) else f"{source.file}: {error}"
        raise source.table.error(text) from None


def read_robot_file(source: ArmSource) -> FileTree:
    """The robot of a URDF or MJCF file.

    Raises:
        ConfigurationError: if it cannot be read.
    """
    kind, root = read_document(source.file)
    tree = read_urdf(source.file, root, source.packages) if kind == "urdf" else read_mjcf(source.file)
    tree.check_numbers()
    return tree


def _check_disjoint(chains: Sequence[JointChain]) -> None:
    count = Counter(joint.name for chain in chains for joint in chain.joints)
    if shared := [name for name, number in count.items() if number > 1]:
        names = ", ".join(shared)
        raise ConfigurationError(
            f"both arms have the joints {names}: give them two tools, a mount each, or lock the joints that "
            f"they share (lock = {{ {shared[0]} = 0.0 }})"
        )
