"""Laws of imported arms: frames, lumping and locking change no motion, and capsules enclose their links."""

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from imported_arms import imported, mechanics

from space_envs.robots.description.importing.meshes.converted import converted
from space_envs.robots.description.importing.meshes.reading import MeshFile, mesh_vertices
from space_envs.robots.description.reading import read_robot
from space_envs.robots.description.shape.clouds import Cloud, cloud_of
from space_envs.robots.description.shape.enclosing import enclosing_capsule, reach
from space_envs.robots.description.shape.grouping import link_capsules
from space_envs.robots.export import urdf
from space_envs.robots.inertias import matrix
from space_envs.robots.robot import UNCHECKED, Robot, Visual
from space_envs.robots.zoo import find_robot

SEEDS = st.integers(0, 2**32 - 1)
LIMITS = {"rate": 0.5, "acceleration": 0.5, "torque": 50.0}


def numbers(values: np.ndarray) -> str:
    return " ".join(map(repr, map(float, values)))


def body(rng: np.random.Generator, name: str, joint: str, inside: str) -> str:
    """A body of MJCF at a random pose, with random mass properties."""
    a, b, c = rng.uniform(0.01, 0.2, 3)
    return (
        f'<body name="{name}" pos="{numbers(rng.normal(size=3) / 3)}" quat="{numbers(rng.normal(size=4))}">'
        f'<inertial mass="{rng.uniform(0.5, 5)}" pos="{numbers(rng.uniform(-0.3, 0.3, 3))}" '
        f'quat="{numbers(rng.normal(size=4))}" diaginertia="{numbers(np.array([a + b, b + c, c + a]))}"/>'
        f"{joint}{inside}</body>"
    )


def hinge(rng: np.random.Generator, name: str, kind: str = "hinge") -> str:
    """A joint whose axis does not pass through the origin of its body's frame."""
    return (
        f'<joint name="{name}" type="{kind}" axis="{numbers(rng.normal(size=3))}" range="-3 3" '
        f'pos="{numbers(rng.uniform(-0.3, 0.3, 3))}" ref="{rng.uniform(-0.5, 0.5)}"/>'
    )


def random_arm(rng: np.random.Generator) -> str:
    """MJCF of a floating arm of four joints, with fixed bodies and two joints to lock next to it."""
    gripper = body(rng, "finger", hinge(rng, "slide", "slide"), body(rng, "pad", hinge(rng, "knuckle"), ""))
    inside = gripper + '<site name="tool" pos="0.1 0.2 0.3" quat="1 1 0 0"/>'
    for number in range(4, 0, -1):
        plate = body(rng, f"plate{number}", "", "")
        inside = plate + body(rng, f"link{number}", hinge(rng, f"joint{number}"), inside)
    base = body(rng, "base", "<freejoint/>", inside)
    return f'<mujoco><compiler angle="radian"/><worldbody>{base}</worldbody></mujoco>'


@settings(max_examples=25, deadline=None)
@given(seed=SEEDS)
def test_momentum_is_that_of_the_file_in_mujoco(seed, tmp_path_factory):
    """Frames are moved onto the axes, and what does not move is lumped: the mass matrix stays the same."""
    rng = np.random.default_rng(seed)
    text, lock = random_arm(rng), {"slide": 0.1, "knuckle": -0.7}
    folder = tmp_path_factory.mktemp("arm")
    (folder / "arm.xml").write_text(text)
    arm = {"file": "arm.xml", "tool": "tool", "lock": lock, "home": 0.0, "limits": LIMITS, "capsules": []}
    arms = imported(arm, folder=folder)
    robot = mechanics(arms)
    model = mujoco.MjModel.from_xml_string(text)
    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    q = rng.uniform(-2.0, 2.0, 4)
    data.qpos[:7] = [0, 0, 0, 1, 0, 0, 0]
    joints = [f"joint{number}" for number in range(1, 5)]
    for name, value in {**lock, **dict(zip(joints, q, strict=True))}.items():
        data.joint(name).qpos = value
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    columns = [int(model.joint(name).dofadr[0]) for name in joints]
    base, coupling = robot.momentum_matrices(q)
    np.testing.assert_allclose(base, mass[:6, :6], atol=1e-9)
    np.testing.assert_allclose(coupling, mass[:6, columns], atol=1e-9)
    place = robot.kinematics(q)
    tool = place.position[-1] + place.rotation[-1] @ np.array(arms[0].tool_position)
    np.testing.assert_allclose(tool, data.site("tool").xpos, atol=1e-10)


@pytest.mark.parametrize("name", ["shyam2020", "spatial_dual_arm"])
def test_an_exported_robot_is_imported_as_the_same(name, tmp_path):
    robot: Robot = find_robot(name)
    (tmp_path / "robot.urdf").write_text(urdf(robot))
    ends = ["end_effector"] if len(robot.arms) == 1 else ["end_effector1", "end_effector2"]
    homes = [[link.joint.home for link in arm.links] for arm in robot.arms]
    tables = [
        {"file": "robot.urdf", "tool": tool, "home": home, "limits": {"acceleration": 1.0}, "capsules": []}
        for tool, home in zip(ends, homes, strict=True)
    ]
    arms = imported(*tables, folder=tmp_path)
    joints = [link.joint for arm in arms for link in arm.links]
    np.testing.assert_allclose([joint.range for joint in joints], robot.joint_range)
    np.testing.assert_allclose([joint.rate_limit for joint in joints], robot.rate_limit)
    np.testing.assert_allclose([joint.torque_limit for joint in joints], robot.torque_limit)
    masses = [robot.satellite.inertial.mass, *(link.inertial.mass for link in robot.links)]
    np.testing.assert_allclose(mechanics(arms).mass, masses)
    for link, other in zip(robot.links, [link for arm in arms for link in arm.links], strict=True):
        np.testing.assert_allclose(other.position, link.position, atol=1e-12)
        np.testing.assert_allclose(matrix(other.inertial), matrix(link.inertial), atol=1e-9)


FUSED = """<robot name="arm">
<mujoco><compiler fusestatic="true" balanceinertia="false"/></mujoco>
<link name="base"/>
<link name="a"><inertial><origin xyz="0.1 0 0.2"/><mass value="2"/>
  <inertia ixx="0.03" iyy="0.04" izz="0.02" ixy="0.001" ixz="0" iyz="0.002"/></inertial></link>
<link name="b"><inertial><origin xyz="0 0.3 0" rpy="0.1 0.2 0.3"/><mass value="5"/>
  <inertia ixx="0.06" iyy="0.05" izz="0.08" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="tool"/>
<joint name="j" type="revolute"><parent link="base"/><child link="a"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
<joint name="f" type="fixed"><origin xyz="0.2 0.1 0.4" rpy="1 0.5 0.2"/><parent link="a"/>
  <child link="b"/></joint>
<joint name="g" type="fixed"><origin xyz="0 0 0.3"/><parent link="b"/><child link="tool"/></joint>
</robot>"""


def test_fixed_links_are_lumped_as_mujoco_does(tmp_path):
    (tmp_path / "arm.urdf").write_text(FUSED)
    arms = imported({"file": "arm.urdf", "home": [0.0], "limits": LIMITS, "capsules": []}, folder=tmp_path)
    link = arms[0].links[0].inertial
    model = mujoco.MjModel.from_xml_string(FUSED)
    assert model.nbody == 2
    np.testing.assert_allclose(link.mass, model.body_mass[1])
    np.testing.assert_allclose(link.centre, model.body_ipos[1], atol=1e-12)
    np.testing.assert_allclose(np.sort(link.moments), np.sort(model.body_inertia[1]), rtol=1e-9)


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS)
def test_a_capsule_encloses_its_cloud_and_little_more(seed):
    rng = np.random.default_rng(seed)
    cloud = Cloud(rng.normal(size=(rng.integers(1, 30), 3)) * rng.uniform(0.01, 1.0, 3), np.zeros(1))
    cloud = Cloud(cloud.centres, rng.uniform(0.0, 0.1, len(cloud.centres)))
    capsule = enclosing_capsule(cloud)
    assert reach(cloud, capsule.start, capsule.end) <= capsule.radius
    # A sphere around the middle is a capsule too, and this one is hardly larger.
    middle = (cloud.centres.max(axis=0) + cloud.centres.min(axis=0)) / 2
    sphere = (np.linalg.norm(cloud.centres - middle, axis=1) + cloud.radii).max()
    assert capsule.volume <= 1.15 * 4.0 / 3.0 * np.pi * sphere**3 + 1e-6


def test_a_capsule_of_a_capsule_is_that_capsule():
    shape = Visual("capsule", (0.05, 0.3, 0.0), (0.1, 0.2, 0.3), (np.cos(0.4), 0.0, np.sin(0.4), 0.0))
    capsule = enclosing_capsule(cloud_of(shape))
    assert capsule.radius == pytest.approx(0.05, abs=1e-3)
    assert np.linalg.norm(capsule.end - capsule.start) == pytest.approx(0.6, abs=2e-2)


def test_parts_far_from_each_other_keep_their_own_capsules():
    rod = Visual("cylinder", (0.05, 0.4, 0.0))
    about_y = (np.sqrt(0.5), 0.0, np.sqrt(0.5), 0.0)
    across = Visual("cylinder", (0.05, 0.4, 0.0), (0.45, 0.0, 0.4), about_y)
    inside = Visual("sphere", (0.04, 0.0, 0.0), (0.0, 0.0, 0.1))
    assert len(link_capsules([cloud_of(shape) for shape in (rod, across, inside)])) == 2


COLLADA = """<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema">
<asset><unit meter="0.001"/></asset>
<library_effects><effect id="e"><profile_COMMON><technique><lambert><diffuse><color>1 0 0 1</color></diffuse>
</lambert></technique></profile_COMMON></effect></library_effects>
<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
<library_geometries><geometry id="g"><mesh>
<source id="p"><float_array>0 0 0 1000 0 0 1000 1000 0 0 1000 0 0 0 1000</float_array></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<polylist material="red"><input semantic="VERTEX" source="#v" offset="0"/><vcount>4 3</vcount>
<p>0 1 2 3 0 1 4</p></polylist>
<triangles><input semantic="VERTEX" source="#v" offset="0"/><input semantic="NORMAL" source="#n" offset="1"/>
<p>0 0 2 0 4 0</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s"><node><translate>0 0 500</translate><node>
<rotate>0 0 1 90</rotate>
<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="red" target="#m"/>
</technique_common></bind_material></instance_geometry></node></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""


def test_collada_is_read_with_its_nodes_units_and_colours(tmp_path, monkeypatch):
    monkeypatch.setenv("SPACE_ENVS_CACHE", str(tmp_path / "cache"))
    file = tmp_path / "mesh.dae"
    file.write_text(COLLADA)
    vertices = np.unique(np.round(mesh_vertices(MeshFile(file, (1.0, 1.0, 2.0))), 9), axis=0)
    expected = [[-1, 0, 1], [-1, 1, 1], [0, 0, 1], [0, 0, 3], [0, 1, 1]]
    np.testing.assert_allclose(vertices, expected, atol=1e-9)
    (red,) = converted(file)  # a part of a single triangle is left out: MuJoCo reads no such file
    assert red.colour == (1.0, 0.0, 0.0, 1.0)
    again = mesh_vertices(MeshFile(red.path, (1.0, 1.0, 2.0)))
    np.testing.assert_allclose(np.unique(np.round(again, 6), axis=0), expected, atol=1e-6)
    changed = red.path.stat().st_mtime_ns
    assert converted(file)[0].path.stat().st_mtime_ns == changed


HOME = (0.1, 0.2, 0.3)
MODEL = """<mujoco model="arm"><compiler angle="radian" autolimits="true"/>
<asset><mesh name="wedge" vertex="0 0 0  .1 0 0  0 .1 0  0 0 .4"/></asset>
<worldbody><geom type="plane" size="1 1 1"/>
<body name="one" pos="0 0 0.1"><joint name="yaw" axis="0 0 1" damping="1" armature="0.2"/>
  <geom type="box" size=".1 .1 .2"/>
  <body name="two" pos="0 0 0.5"><joint name="elbow" axis="0 1 0" range="-2 2" frictionloss="0.1"/>
    <geom type="mesh" mesh="wedge"/>
    <body name="three" pos="0 0 0.5"><joint name="wrist" axis="0 1 0" range="-1 1"/>
      <geom type="capsule" size=".05 .1" group="3"/>
      <geom type="sphere" size=".06" contype="0" conaffinity="0"/>
      <site name="tool" pos="0 0 0.2"/></body></body></body></worldbody>
<actuator><motor joint="yaw" ctrlrange="-4 4" gear="10"/><position joint="elbow" forcerange="-30 30"/>
<motor joint="wrist" ctrlrange="-1 1"/></actuator>
<keyframe><key name="home" qpos="0.1 0.2 0.3"/></keyframe></mujoco>"""
DESCRIPTION = """
[satellite]
mass = 100.0
size = 1.0
[[arm]]
file = "arm.xml"
tool = "tool"
mount = { position = [0.0, 0.0, 0.5] }
limits = { rate = 0.5, acceleration = 0.5 }
"""


def described(folder: Path, text: str = DESCRIPTION) -> Robot:
    (folder / "arm.xml").write_text(MODEL)
    (folder / "robot.toml").write_text(text)
    return read_robot(folder / "robot.toml")


def test_an_mjcf_arm_brings_its_home_limits_and_shapes(tmp_path):
    robot = described(tmp_path)
    np.testing.assert_allclose(robot.home, [0.1, 0.2, 0.3])
    np.testing.assert_allclose(robot.torque_limit, [40.0, 30.0, 1.0])
    np.testing.assert_allclose(robot.joint_range[0], [-2 * np.pi, 2 * np.pi])
    assert [joint.rotor_inertia for joint in robot.joints] == [0.2, 0.0, 0.0]
    assert robot.links[0].inertial.mass == pytest.approx(1000 * 0.2 * 0.2 * 0.4)
    capsules = robot.arms[0].capsules
    assert [capsule.link for capsule in capsules] == [1, 2, 3]
    assert capsules[0].satellite == UNCHECKED != capsules[1].satellite
    assert capsules[2].radius == pytest.approx(0.05, abs=1e-3)
    assert [visual.kind for visual in robot.links[2].visuals] == ["sphere"]
    assert replace(robot, notes=()).digest == robot.digest
    text = " ".join(robot.notes)
    for words in (
        "damping of joints is not simulated: yaw.",
        "friction of joints is not simulated: elbow.",
        "3 actuators of the file are not used",
        "inertias computed from geometry by MuJoCo: one, two, three.",
        "may rotate by 360 deg to either side: yaw.",
        "links inside the satellite at home or at all angles are not checked against it: one.",
    ):
        assert words in text


def test_packages_are_found_where_they_are_looked_for(tmp_path, monkeypatch):
    for folder in ("ros/my_arm", "ament/share/my_arm", "elsewhere/my_arm_v2"):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "arm.xml").write_text(MODEL)
    (tmp_path / "work").mkdir()
    text = DESCRIPTION.replace("arm.xml", "package://my_arm/arm.xml")
    digest = described(tmp_path).digest
    monkeypatch.setenv("ROS_PACKAGE_PATH", str(tmp_path / "ros"))
    assert described(tmp_path / "work", text).digest == digest
    monkeypatch.delenv("ROS_PACKAGE_PATH")
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "ament"))
    assert described(tmp_path / "work", text).digest == digest
    monkeypatch.delenv("AMENT_PREFIX_PATH")
    table = '\n[packages]\nmy_arm = "../elsewhere/my_arm_v2"\n'
    assert described(tmp_path / "work", text + table).digest == digest


SCENE = MODEL.replace(
    "</worldbody>",
    '<body name="table" pos="1 0 0"><geom type="box" size=".5 .5 .5"/></body><body name="cube" pos="0 0 9">'
    '<freejoint/><geom type="box" size=".1 .1 .1"/></body></worldbody>',
).replace("<asset>", '<asset><texture name="t" type="2d" file="lost.png"/><material name="m" texture="t"/>')


def test_scenery_and_images_of_an_mjcf_file_are_left_out(tmp_path):
    arm = {"file": "arm.xml", "tool": "tool", "limits": LIMITS}
    (tmp_path / "arm.xml").write_text(MODEL)
    alone = imported(arm, folder=tmp_path)[0]
    (tmp_path / "arm.xml").write_text(SCENE)
    (there,) = imported({**arm, "home": list(HOME)}, folder=tmp_path)
    assert there.links == alone.links
    assert there.root is None
    assert there.root_visuals == ()
