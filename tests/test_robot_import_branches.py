"""Two arms in one robot file: branches of one robot, with names that a prefix completes."""

from pathlib import Path

import numpy as np
import pytest
from imported_arms import imported, mechanics

from space_envs.errors import ConfigurationError
from space_envs.robots.description.reading import read_robot

INERTIAL = (
    '<inertial><origin xyz="0 0 0.1" rpy="0.3 0.2 0.1"/><mass value="{}"/>'
    '<inertia ixx="0.04" iyy="0.03" izz="0.02" ixy="0.002" ixz="0" iyz="0.001"/></inertial>'
)
LIMIT = '<limit lower="-2" upper="2" effort="30" velocity="1"/>'


def joint(name: str, kind: str, parent: str, child: str, more: str = "") -> str:
    return (
        f'<joint name="{name}" type="{kind}"><origin xyz="0.1 0.2 0.3" rpy="0.5 0.4 0.3"/>'
        f'<parent link="{parent}"/><child link="{child}"/><axis xyz="0 1 0"/>{LIMIT}{more}</joint>'
    )


def link(name: str, mass: float) -> str:
    return f'<link name="{name}">{INERTIAL.format(mass)}</link>'


def arm(side: str) -> str:
    names = ["torso", *(f"{side}_{part}" for part in ("upper", "fore", "hand"))]
    joints = (
        joint(f"{side}_{word}", "revolute", parent, child)
        for word, parent, child in zip(("shoulder", "elbow", "wrist"), names, names[1:], strict=False)
    )
    return "".join(link(name, 2.0) for name in names[1:]) + "".join(joints)


MIMIC = '<mimic joint="grip" multiplier="2"/>'
FILE = (
    f'<robot name="two">{link("world", 0)}{link("base", 10)}{link("torso", 5)}{link("head", 1)}'
    f"{joint('mount', 'fixed', 'world', 'base')}{joint('lift', 'prismatic', 'base', 'torso')}"
    f"{joint('nod', 'revolute', 'torso', 'head')}{arm('left')}{arm('right')}"
    f"{link('finger', 0.5)}{link('other_finger', 0.5)}{joint('grip', 'prismatic', 'left_hand', 'finger')}"
    f"{joint('other_grip', 'prismatic', 'left_hand', 'other_finger', MIMIC)}"
    "</robot>"
)
LIMITS = {"acceleration": 0.5, "rate": {"elbow": 0.3}}


def table(side: str, **more: object) -> dict[str, object]:
    home = {"shoulder": 0.1, "elbow": 0.2, "wrist": 0.3}
    common = {"file": "two.urdf", "prefix": f"{side}_", "tool": "hand", "capsules": [], "lock": {"lift": 0.5}}
    return {**common, "home": home, "limits": LIMITS, **more}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "two.urdf").write_text(FILE)
    return tmp_path


def test_what_both_arms_share_counts_once(folder):
    left, right = imported(table("left"), table("right"), folder=folder)
    assert left.root is not None and right.root is None
    assert left.root.mass == pytest.approx(16.0)  # base, torso, head
    assert [each.name for each in left.links] == ["left_upper", "left_fore", "left_hand"]
    assert [each.joint.rate_limit for each in right.links] == [1.0, 0.3, 1.0]
    assert [each.joint.home for each in right.links] == [0.1, 0.2, 0.3]
    notes = " ".join(left.notes)
    assert "locked joints: lift at 0.5." in notes
    assert "not between root and tool are fixed: nod at 0, grip at 0, other_grip at 0." in notes


def test_a_follower_is_locked_where_its_leader_takes_it(folder):
    lock = {"lift": 0.5, "grip": 0.1}
    left, _ = imported(table("left", lock=lock), table("right"), folder=folder)
    same = {"lift": 0.5, "grip": 0.1, "other_grip": 0.2}
    assert imported(table("left", lock=same), table("right"), folder=folder)[0].links == left.links


def test_an_arm_alone_carries_the_other_one_as_a_part_of_its_root(folder):
    """At zero angles of the other arm, the whole robot is the same."""
    both = imported(table("left"), table("right"), folder=folder)
    (alone,) = imported(table("left"), folder=folder)
    q = np.array([0.3, -0.4, 0.5])
    one, _ = mechanics([alone]).momentum_matrices(q)
    two, _ = mechanics(both).momentum_matrices(np.concatenate([q, np.zeros(3)]))
    np.testing.assert_allclose(one, two, atol=1e-9)


def test_a_root_on_the_way_leaves_out_what_is_before_it(folder):
    (left,) = imported(table("left", root="torso", lock={}), folder=folder)
    assert left.root is not None
    assert left.root.mass == pytest.approx(5.0 + 1.0 + 6.0)  # torso, head, the other arm
    assert "the joint lift above it is left out" in " ".join(left.notes)


def test_two_arms_of_one_file_are_one_robot_or_two_copies(folder):
    mounts = [{"position": [0.0, 0.0, 0.5]}, {"position": [0.0, 0.0, -0.5]}]
    copies = imported(table("left", mount=mounts[0]), table("right", mount=mounts[1]), folder=folder)
    assert copies[1].root is not None
    with pytest.raises(ConfigurationError, match="write the same mount for both"):
        imported(table("left", mount=mounts[0]), table("right"), folder=folder)


ARM = """
[[arm]]
file = "two.urdf"
prefix = "SIDE_"
tool = "hand"
lock = ["lift"]
mount = { position = [0.0, 0.0, 0.5] }
home = [SHOULDER, 0.2, 0.3]
limits = { acceleration = 0.5 }
"""


def test_a_robot_of_two_branches_has_the_mass_of_its_file(folder):
    sides = {"left": "0.9", "right": "-0.9"}
    arms = "".join(ARM.replace("SIDE", side).replace("SHOULDER", angle) for side, angle in sides.items())
    (folder / "robot.toml").write_text(f"[satellite]\nmass = 100.0\nsize = 1.0\n{arms}")
    robot = read_robot(folder / "robot.toml")
    assert robot.satellite.inertial.mass == pytest.approx(116.0)
    assert sum(each.inertial.mass for each in robot.links) == pytest.approx(13.0)


PLANAR = "planar = true\n[satellite]\nmass = 100.0\nsize = 1.0\nreachable = false\n"
FLAT = """
[[arm]]
file = "flat.urdf"
mount = { position = [0.5, 0.0, HEIGHT] }
home = [0.1, 0.2, 0.3]
limits = { acceleration = 0.5 }
"""


def flat(axis: str, height: str, folder: Path) -> None:
    names = ["root", "upper", "fore", "hand"]
    chain = "".join(
        joint(child, "revolute", parent, child) for parent, child in zip(names, names[1:], strict=False)
    )
    text = f'<robot name="flat">{"".join(link(name, 2.0) for name in names)}{chain}</robot>'
    text = text.replace('xyz="0.1 0.2 0.3" rpy="0.5 0.4 0.3"', 'xyz="0.5 0 0" rpy="0 0 0.4"')
    text = text.replace('xyz="0 0 0.1" rpy="0.3 0.2 0.1"', 'xyz="0.1 0 0"')
    (folder / "flat.urdf").write_text(text.replace('axis xyz="0 1 0"', f'axis xyz="{axis}"'))
    (folder / "flat.toml").write_text(PLANAR + FLAT.replace("HEIGHT", height))


def test_a_planar_robot_lies_in_the_plane(tmp_path):
    flat("0 0 -1", "0.0", tmp_path)
    assert read_robot(tmp_path / "flat.toml").planar
    flat("0 1 0", "0.0", tmp_path)
    with pytest.raises(ConfigurationError, match=r"'upper' is along .*, 0.0\]: turn the mount"):
        read_robot(tmp_path / "flat.toml")
    flat("0 0 1", "0.2", tmp_path)
    with pytest.raises(ConfigurationError, match="joint 'upper' is at z = 0.196.* m: change the mount"):
        read_robot(tmp_path / "flat.toml")
