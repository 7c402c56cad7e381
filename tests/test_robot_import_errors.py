"""Damaged and odd robot files: each ends in one clear sentence, which says where and what to write."""

import re
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from imported_arms import imported

from space_envs.errors import ConfigurationError

INERTIAL = (
    '<inertial><origin xyz="0 0 0.2"/><mass value="3"/>'
    '<inertia ixx="0.04" iyy="0.04" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial>'
)
LIMIT = '<limit lower="-2" upper="2" effort="30" velocity="1"/>'


def link(name: str, inertial: str = INERTIAL, more: str = "") -> str:
    return f'<link name="{name}">{inertial}{more}</link>'


def joint(number: int, kind: str = "revolute", limit: str = LIMIT, more: str = "") -> str:
    """Joint j{number}, which hangs l{number} on the link before it."""
    return (
        f'<joint name="j{number}" type="{kind}"><origin xyz="0 0 0.4"/><parent link="l{number - 1}"/>'
        f'<child link="l{number}"/><axis xyz="{number % 2} {1 - number % 2} 0"/>{limit}{more}</joint>'
    )


LINKS = [link(f"l{number}") for number in range(4)]
JOINTS = [joint(number) for number in range(1, 4)]
GOOD = f'<robot name="arm">{"".join(LINKS)}{"".join(JOINTS)}</robot>'
ARM = {"file": "arm.urdf", "home": [0.1, 0.2, 0.3], "limits": {"acceleration": 0.5}, "capsules": []}
MESH = '<collision><geometry><mesh filename="{}"/></geometry></collision>'

MJCF_LINKS = "".join(
    f'<body name="l{number}" pos="0 0 0.4"><inertial pos="0 0 0.2" mass="3" diaginertia="0.04 0.04 0.01"/>'
    f'<joint name="j{number}" axis="0 1 0" range="-2 2" actuatorfrcrange="-30 30"/>'
    for number in range(1, 4)
)
GOOD_MJCF = (
    '<mujoco><compiler angle="radian" autolimits="true"/><worldbody><body name="l0">'
    f"{MJCF_LINKS}{'</body>' * 4}</worldbody></mujoco>"
)
MJCF_ARM = {**ARM, "file": "arm.xml", "limits": {"acceleration": 0.5, "rate": 1.0}}


BODY2 = '<body name="l2" pos="0 0 0.4">'


def changed(old: str, new: str) -> str:
    """The good MJCF with another piece of text."""
    return replaced(old, new, GOOD_MJCF)


def replaced(old: str, new: str, text: str = GOOD) -> str:
    """A robot with another piece of text."""
    assert old in text
    return text.replace(old, new, 1)


def fixed(parent: str, child: str) -> str:
    return f'<joint name="j9" type="fixed"><parent link="{parent}"/><child link="{child}"/></joint>'


def added(more: str) -> str:
    """The good robot with more elements."""
    return replaced("</robot>", f"{more}</robot>")


def without(number: int, new: str) -> str:
    """The good robot with another joint."""
    return replaced(JOINTS[number - 1], new)


# What is wrong -> text of the URDF, changes of the arm's table, and what the message says (a pattern).
URDF: dict[str, tuple[str, dict[str, Any], str]] = {
    "empty file": ("", {}, r"not well-formed XML: no element found"),
    "cut off": (GOOD[:-30], {}, r"not well-formed XML: .*line 1"),
    "not XML": ("name = 'arm'", {}, r"not well-formed XML"),
    "binary": ("\x00\x01\x02", {}, r"not well-formed XML"),
    "SDF": ("<sdf><model/></sdf>", {}, r"<sdf>; expected <robot> \(URDF\) or <mujoco>"),
    "expanding entities": (
        '<!DOCTYPE r [<!ENTITY a "aaaaaaaa"><!ENTITY b "&a;&a;&a;&a;">]><robot name="&b;"/>',
        {},
        r"has a DOCTYPE.*remove it",
    ),
    "xacro": (
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="a"/></robot>',
        {},
        r"xacro arm.urdf > arm_expanded.urdf",
    ),
    "unexpanded expression": (replaced('mass value="3"', 'mass value="${m}"'), {}, r"is a xacro file"),
    "nested too deeply": ("<robot>" + "<a>" * 300 + "</a>" * 300 + "</robot>", {}, r"nested more than 200"),
    "no links": ('<robot name="arm"/>', {}, r"has no <link>"),
    "link without a name": (replaced('<link name="l2">', "<link>"), {}, r"<link> number 3 has no name"),
    "duplicate link": (replaced('name="l2"', 'name="l1"'), {}, r"link 'l1' is defined more than once"),
    "duplicate joint": (replaced('name="j2"', 'name="j1"'), {}, r"joint 'j1' is defined more than once"),
    "unknown joint type": (without(2, joint(2, "revolut")), {}, r"type of joint 'j2'.*mean 'revolute'"),
    "unknown parent": (replaced('parent link="l1"', 'parent link="l1x"'), {}, r"parent link of joint 'j2'"),
    "joint without a child": (replaced('<child link="l2"/>', ""), {}, r"'j2' has no <child link"),
    "two roots": (replaced(JOINTS[1], ""), {}, r"2 root links, 'l0', 'l2': nothing connects them"),
    "two parents": (
        added(fixed("l0", "l3")),
        {},
        r"'l3' has two parents: joint 'j3' hangs it on 'l2', joint 'j9' on 'l0'.*closed chain",
    ),
    "ring": (
        replaced('<child link="l3"/>', '<child link="l1"/>').replace(JOINTS[0], ""),
        {},
        r"root links|closed chain",
    ),
    "ring without a root": (
        added(fixed("l3", "l0")),
        {},
        r"part of a closed chain",
    ),
    "mimic on the chain": (
        without(2, joint(2, more='<mimic joint="j1" multiplier="2"/>')),
        {},
        r"'j2' mimics 'j1'.*lock = \{ j2 = 0.0 \}",
    ),
    "prismatic on the chain": (without(2, joint(2, "prismatic")), {}, r"'j2'.*is prismatic.*hinges only"),
    "planar on the chain": (without(2, joint(2, "planar")), {}, r"'j2'.*is planar"),
    "floating base": (without(1, joint(1, "floating")), {}, r"'j1'.*floating base.*Name the link below it"),
    "no inertia": (
        replaced(LINKS[2], link("l2", "")),
        {},
        r"'l2', which joint 'j2' moves, has no mass.*<mass",
    ),
    "no mass element": (replaced('<mass value="3"/>', ""), {}, r"<inertial> of link 'l0' has no <mass>"),
    "zero mass": (
        replaced(LINKS[3], link("l3", INERTIAL.replace('"3"', '"0"'))),
        {},
        r"'l3', which joint 'j3' moves, has no mass",
    ),
    "negative mass": (replaced('mass value="3"', 'mass value="-3"'), {}, r"mass of link 'l0' is -3 kg"),
    "mass in grams": (replaced('mass value="3"', 'mass value="3e6"'), {}, r"is it in grams"),
    "mass not a number": (
        replaced('mass value="3"', 'mass value="nan"'),
        {},
        r"value must be a number",
    ),
    "zero inertia": (
        replaced(LINKS[3], link("l3", re.sub(r'i(..)="[\d.]+"', r'i\1="0"', INERTIAL))),
        {},
        r"principal moments of inertia of 0, 0, 0 kg m\^2: all three must be positive",
    ),
    "triangle inequality": (replaced('izz="0.01"', 'izz="0.1"'), {}, r"'l0' breaks the triangle inequality"),
    "not positive definite": (replaced('ixy="0"', 'ixy="0.05"'), {}, r"'l0' is not positive definite"),
    "inertia in g mm^2": (
        GOOD.replace('"0.04"', '"40000"').replace('izz="0.01"', 'izz="10000"'),
        {},
        r"is it in g mm\^2",
    ),
    "inertia incomplete": (replaced('izz="0.01"', ""), {}, r"<inertia> has no izz"),
    "axis without length": (
        replaced('axis xyz="1 0 0"', 'axis xyz="0 0 0"'),
        {},
        r"'j1'.*axis has no length",
    ),
    "axis of two numbers": (
        replaced('axis xyz="1 0 0"', 'axis xyz="1 0"'),
        {},
        r"xyz must be 3 numbers",
    ),
    "lengths in mm": (replaced('xyz="0 0 0.4"', 'xyz="0 0 400"'), {}, r"'j1' is 400 m from.*in millimetres"),
    "position beyond all measure": (
        replaced('xyz="0 0 0.4"', 'xyz="0 0 1e308"'),
        {},
        r"of body 'l1' is no number",
    ),
    "position that is no number": (
        replaced('xyz="0 0 0.4"', 'xyz="0 0 nan"'),
        {},
        r"of body 'l1' is no number",
    ),
    "no range": (
        without(2, joint(2, limit='<limit effort="30" velocity="1"/>')),
        {},
        r"no range of 'j2': write limits.range",
    ),
    "empty range": (
        without(2, joint(2, limit='<limit lower="0" upper="0" effort="30" velocity="1"/>')),
        {},
        r"no range of 'j2'",
    ),
    "range the wrong way": (
        without(2, joint(2, limit='<limit lower="2" upper="-2" effort="30" velocity="1"/>')),
        {},
        r"range of joint 'j2' is 2 to -2 rad: lower must be below upper",
    ),
    "no limits": (without(2, joint(2, "continuous", "")), {}, r"no rate of 'j2': write limits.rate"),
    "no effort": (
        without(2, joint(2, limit=LIMIT.replace("30", "0"))),
        {},
        r"no torque of 'j2': write limits.torque.*N m",
    ),
    "negative velocity": (
        without(2, joint(2, limit=LIMIT.replace('velocity="1"', 'velocity="-1"'))),
        {},
        r"velocity of joint 'j2' is -1",
    ),
    "limit not a number": (
        without(2, joint(2, limit=LIMIT.replace('"30"', '"inf"'))),
        {},
        r"'j2': <limit>: effort must be a number of at most 1e\+09, got 'inf'",
    ),
    "home outside": (GOOD, {"home": [0.0, 3.0, 0.0]}, r"home of 'j2' is outside its range"),
    "home too short": (GOOD, {"home": [0.0, 0.1]}, r"home must be .* list of 3 numbers"),
    "home of an unknown joint": (GOOD, {"home": {"j9": 0.0}}, r"unknown joint 'j9'"),
    "no home": (GOOD, {"home": {"j1": 0.0, "j2": 0.0}}, r"no home of 'j3'"),
    "unknown tool": (GOOD, {"tool": "l33"}, r"unknown tool 'l33'.*mean 'l3'"),
    "unknown root": (GOOD, {"root": "l00"}, r"unknown root link 'l00'.*mean 'l0'"),
    "tool below the root": (
        GOOD,
        {"root": "l3", "tool": "l1"},
        r"'l1' is not carried by the root 'l3'.*l0 > l1",
    ),
    "tool on the root": (GOOD, {"tool": "l0"}, r"no joint moves the tool 'l0' against the root 'l0'"),
    "two candidate tools": (
        added('<link name="l9"/>' + fixed("l2", "l9")),
        {},
        r"several links are last in their branches: 'l3', 'l9'",
    ),
    "lock of an unknown joint": (GOOD, {"lock": ["j7"]}, r"unknown joint in lock 'j7'"),
    "lock outside of the range": (GOOD, {"lock": {"j3": 9.0}}, r"'j3' is locked at 9, outside of its range"),
    "lock that is no number": (GOOD, {"lock": {"j3": "open"}}, r"lock of joint 'j3' must be a finite number"),
    "everything locked": (GOOD, {"lock": ["j1", "j2", "j3"]}, r"no joint moves the tool"),
    "mesh not found": (
        replaced(LINKS[2], link("l2", more=MESH.format("arm.stl"))),
        {"contacts": True},
        r"collision geometry of link 'l2': there is no mesh file .*arm.stl",
    ),
    "mesh of another type": (
        replaced(LINKS[2], link("l2", more=MESH.format("arm.blend"))),
        {"contacts": True},
        r"type .blend; .stl, .obj, .msh, .dae can be read",
    ),
    "mesh that is none": (
        replaced(LINKS[2], link("l2", more=MESH.format("arm.urdf.stl"))),
        {"contacts": True},
        r"arm.urdf.stl: MuJoCo cannot read the mesh",
    ),
    "package not found": (
        replaced(LINKS[2], link("l2", more=MESH.format("package://no_such_arm/a.stl"))),
        {"contacts": True},
        r"no package 'no_such_arm' in the table \[packages\].*ROS_PACKAGE_PATH.*AMENT_PREFIX_PATH",
    ),
    "shape of negative size": (
        replaced(
            LINKS[2], link("l2", more='<collision><geometry><box size="1 -1 1"/></geometry></collision>')
        ),
        {},
        r"link 'l2': MuJoCo cannot read its shapes: .*size",
    ),
}


@pytest.mark.parametrize("case", URDF)
def test_a_urdf_that_is_refused(case, tmp_path):
    text, changes, words = URDF[case]
    (tmp_path / "arm.urdf").write_text(text)
    (tmp_path / "arm.urdf.stl").write_text("no triangles")
    refuse(ARM, changes, words, tmp_path)


def refuse(arm: dict[str, Any], changes: dict[str, Any], words: str, folder: Path) -> None:
    """The arm is refused in one paragraph that names the description, and has the words."""
    table = {**arm, **changes}
    if table.pop("contacts", False):
        del table["capsules"]
    with pytest.raises(ConfigurationError) as caught:
        imported(table, folder=folder)
    text = str(caught.value)
    assert re.search(words, text), text
    assert "robot.toml: [arm 1" in text
    assert "\n" not in text


# The same for MJCF.
MJCF: dict[str, tuple[str, dict[str, Any], str]] = {
    "unknown element": (changed("<worldbody>", "<wordbody/><worldbody>"), {}, r"MuJoCo cannot read it"),
    "duplicate body": (changed('body name="l2"', 'body name="l1"'), {}, r"MuJoCo.*repeated name 'l1'"),
    "no inertia": (
        changed('<inertial pos="0 0 0.2" mass="3" diaginertia="0.04 0.04 0.01"/>', ""),
        {},
        r"MuJoCo cannot read it.*mass and inertia of moving bodies.*Write its <inertial",
    ),
    "position beyond all measure": (changed('pos="0 0 0.4"', 'pos="0 0 1e308"'), {}, r"of body 'l1' is no"),
    "two joints on a body": (
        changed('<joint name="j2"', '<joint name="j9" axis="1 0 0" range="-1 1"/><joint name="j2"'),
        {},
        r"body 'l2' has 2 joints, j9, j2",
    ),
    "slide": (changed('name="j2"', 'name="j2" type="slide"'), {}, r"'j2'.*is prismatic"),
    "ball": (
        changed('name="j2" axis="0 1 0" range="-2 2" actuatorfrcrange="-30 30"', 'name="j2" type="ball"'),
        {},
        r"'j2'.*is ball",
    ),
    "coupled joints": (
        changed("</mujoco>", '<equality><joint joint1="j1" joint2="j2"/></equality></mujoco>'),
        {},
        r"equality constraint couples joint 'j1'",
    ),
    "closed chain": (
        changed("</mujoco>", '<equality><connect body1="l3" body2="l1" anchor="0 0 0"/></equality></mujoco>'),
        {},
        r"constraint \(connect\) closes a chain at body 'l1'",
    ),
    "several robots": (
        changed("</worldbody>", '<body name="other"><joint/><geom size="1"/></body></worldbody>'),
        {},
        r"several robots, 'l0', 'other': write which: root",
    ),
    "no rate": (GOOD_MJCF, {"limits": {"acceleration": 0.5}}, r"no rate of 'j1', 'j2', 'j3'"),
    "no torque": (
        GOOD_MJCF.replace(' actuatorfrcrange="-30 30"', ""),
        {},
        r"no torque of 'j1', 'j2', 'j3'",
    ),
    "no home": (GOOD_MJCF, {"home": {}}, r"no home of 'j1', 'j2', 'j3'"),
    "unknown tool": (GOOD_MJCF, {"tool": "hand"}, r"unknown tool 'hand'; valid are"),
    "include that is not there": (
        changed("<worldbody>", '<include file="more.xml"/><worldbody>'),
        {},
        r"MuJoCo cannot read it.*more.xml",
    ),
    "mesh that is not there": (
        changed("<worldbody>", '<asset><mesh name="m" file="m.stl"/></asset><worldbody>').replace(
            BODY2, f'{BODY2}<geom type="mesh" mesh="m"/>'
        ),
        {},
        r"MuJoCo cannot read it.*m.stl",
    ),
}


@pytest.mark.parametrize("case", MJCF)
def test_an_mjcf_that_is_refused(case, tmp_path):
    text, changes, words = MJCF[case]
    (tmp_path / "arm.xml").write_text(text)
    refuse(MJCF_ARM, changes, words, tmp_path)


def test_files_that_are_not_there_or_no_files(tmp_path):
    (tmp_path / "arm.urdf").write_text(GOOD)
    (tmp_path / "folder.urdf").mkdir()
    refuse(ARM, {"file": "amr.urdf"}, r"no robot file .*Did you mean .*arm.urdf", tmp_path)
    refuse(ARM, {"file": "folder.urdf"}, r"cannot be read|not a regular file", tmp_path)
    refuse(ARM, {"file": "package://no_such_arm/arm.urdf"}, r"no package 'no_such_arm'", tmp_path)
    refuse(ARM, {"lock": 3}, r"lock must be a table of joints and their values, or a list", tmp_path)


def test_the_robots_that_the_cases_change_are_fine(tmp_path):
    (tmp_path / "arm.urdf").write_text(GOOD)
    (tmp_path / "arm.xml").write_text(GOOD_MJCF)
    for arm in (ARM, MJCF_ARM):
        (found,) = imported(arm, folder=tmp_path)
        assert [each.joint.name for each in found.links] == ["j1", "j2", "j3"]


def test_two_arms_with_the_same_joints(tmp_path):
    (tmp_path / "arm.urdf").write_text(GOOD)
    with pytest.raises(ConfigurationError, match="both arms have the joints j1, j2, j3: give them two tools"):
        imported(ARM, ARM, folder=tmp_path)


VALUES = ["0", "-1", "nan", "inf", "1e308", "1e-320", "0 0", "l1", "l3", "j1", "x", "", "-0.3", "9" * 400]


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(place=st.integers(0, 10**6), value=st.sampled_from(VALUES), removed=st.booleans(), mjcf=st.booleans())
def test_a_changed_file_is_read_or_refused(tmp_path, place, value, removed, mjcf):
    """One attribute has another value, or one element is gone."""
    text, arm = (GOOD_MJCF, MJCF_ARM) if mjcf else (GOOD, ARM)
    found = list(re.finditer(r"<[^<>]*/>" if removed else r'(?<==")[^"]*', text))
    start, end = found[place % len(found)].span()
    (tmp_path / arm["file"]).write_text(text[:start] + ("" if removed else value) + text[end:])
    with suppress(ConfigurationError):
        imported(arm, folder=tmp_path)
