"""Robots from description files: what is read, how it is assembled, and what is refused."""

from pathlib import Path

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from space_envs import register_robot
from space_envs.dynamics.rotations import rotate
from space_envs.errors import ConfigurationError
from space_envs.robots.description.reading import read_robot
from space_envs.robots.inertias import combined, matrix, moved, principal
from space_envs.robots.kinematics import tool_poses
from space_envs.robots.models import robot_model
from space_envs.robots.robot import Inertial, Robot
from space_envs.robots.zoo import find_robot, robot_names

ARM = """
[[arm]]
mount = { position = [0.0, 0.0, 0.5] }
home = [0.1, -0.7, 1.1, 0.3, 0.9, 0.0]
radius = 0.05
links = [
    { alpha = 1.5707963267948966, d = 0.3, mass = 4.0 },
    { a = 0.8, mass = 6.0 },
    { a = 0.7, mass = 5.0 },
    { alpha = 1.5707963267948966, d = 0.1, mass = 2.0 },
    { alpha = -1.5707963267948966, d = 0.1, mass = 2.0 },
    { d = 0.2, mass = 1.0 },
]

[arm.limits]
rate = 0.3
acceleration = 0.2
torque = 30.0
range = [[-3, 3], [-3, 3], [-3, 3], [-3, 3], [-3, 3], [-3, 3]]
"""
SATELLITE = """
[satellite]
mass = 120.0
size = [0.8, 1.0, 1.0]
"""

URDF = """
<robot name="arm">
  <link name="root">
    <inertial>
      <origin xyz="0 0 0.25"/> <mass value="30"/>
      <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <link name="link">
    <inertial>
      <mass value="2"/> <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <joint name="hinge" type="revolute">
    <parent link="root"/> <child link="link"/> <axis xyz="0 0 1"/>
    <limit lower="-2" upper="2" velocity="0.3" effort="20"/>
  </joint>
  <link name="tool"/>
  <joint name="end" type="fixed"> <parent link="link"/> <child link="tool"/> <origin xyz="0 0 0.4"/> </joint>
</robot>
"""
ON_A_HEAVY_ROOT = """
[[arm]]
file = "arm.urdf"
mount = { position = [0.1, 0.2, 0.5] }
home = [0.0]
"""


def written(folder: Path, text: str) -> Path:
    file = folder / "arm.toml"
    file.write_text(text, encoding="utf-8")
    return file


def read(folder: Path, text: str = SATELLITE + ARM, variant: str | None = None) -> Robot:
    return read_robot(written(folder, text), variant)


def test_a_description_is_the_robot_that_it_says(tmp_path: Path) -> None:
    robot = read(tmp_path)
    assert (robot.name, robot.variant, robot.n_joints, robot.planar) == ("arm", "nominal", 6, False)
    np.testing.assert_allclose(robot.satellite.inertial.moments, [20.0, 16.4, 16.4], rtol=1e-15)
    np.testing.assert_array_equal(robot.torque_limit, np.full(6, 30.0))
    np.testing.assert_array_equal(robot.home, [0.1, -0.7, 1.1, 0.3, 0.9, 0.0])
    model = robot_model(robot)
    assert [model.jnt(n).name for n in range(1, 7)] == [f"joint{n}" for n in range(1, 7)]
    assert model.body_mass.sum() == 140.0
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_kinematics(model, data)
    np.testing.assert_allclose(
        tool_poses(robot, robot.home)[0].position, data.site("end_effector").xpos, atol=1e-14
    )


def test_the_end_effector_may_be_displaced_from_the_tool(tmp_path: Path) -> None:
    tool = read(tmp_path)
    half = "[0.7071067811865476, 0.0, 0.7071067811865475, 0.0]"
    offset = ARM.replace(
        "radius", f"tool_offset = {{ position = [0.0, 0.0, 0.1], quaternion = {half} }}\nradius", 1
    )
    end = read(tmp_path, SATELLITE + offset)
    (before,), (after,) = (tool_poses(robot, tool.home) for robot in (tool, end))
    along, across = (
        rotate(before.orientation, np.array(axis)) for axis in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0))
    )
    np.testing.assert_allclose(after.position, before.position + 0.1 * along, atol=1e-14)
    np.testing.assert_allclose(rotate(after.orientation, np.array([0.0, 0.0, 1.0])), across, atol=1e-14)


def test_values_of_joints_are_one_number_a_list_or_a_table(tmp_path: Path) -> None:
    text = SATELLITE + ARM
    for value in ("30.0", "[30, 30, 30, 30, 30, 30]"):
        same = text.replace("torque = 30.0", f"torque = {value}")
        assert read(tmp_path, same).digest == read(tmp_path).digest
    table = ", ".join(f'"joint {n}" = {10.0 * n}' for n in range(1, 7))
    robot = read(tmp_path, text.replace("torque = 30.0", f"torque = {{ {table} }}"))
    np.testing.assert_array_equal(robot.torque_limit, 10.0 * np.arange(1, 7))


def test_digest_follows_what_is_simulated_alone(tmp_path: Path) -> None:
    text = SATELLITE + ARM
    plain = read(tmp_path).digest
    assert read(tmp_path, f'name = "other"\n{text}').digest == plain
    cameras = [f"{name} = {{ position = [1, 2, 3], toward = [0, 0, 0] }}" for name in ("overview", "chase")]
    view = "\n".join(["[view]", *cameras])
    assert read(tmp_path, text + view).digest == plain
    for old, new in (
        ("mass = 120.0", "mass = 120.5"),
        ("rate = 0.3", "rate = 0.31"),
        ("0.9, 0.0]", "0.9, 0.1]"),
    ):
        assert read(tmp_path, text.replace(old, new)).digest != plain


def test_variants_change_the_tables_that_they_name(tmp_path: Path) -> None:
    text = f"""variant = "light"\n{SATELLITE}{ARM}
[variants.heavy]
satellite = {{ mass = 240.0 }}
arm = [{{ rotor_inertia = 0.5 }}]
"""
    light, heavy = (read(tmp_path, text, name) for name in ("light", "heavy"))
    assert read(tmp_path, text).variant == "light"
    assert (light.satellite.inertial.mass, heavy.satellite.inertial.mass) == (120.0, 240.0)
    assert [joint.rotor_inertia for joint in heavy.joints] == [0.5] * 6
    assert [link.inertial for link in light.links] == [link.inertial for link in heavy.links]
    with pytest.raises(ConfigurationError, match="unknown model variant 'hevy'; .* Did you mean 'heavy'"):
        read(tmp_path, text, "hevy")


def test_the_mesh_of_a_satellite_has_one_scale_or_three_and_may_be_in_a_package(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    bus = tmp_path / "models" / "bus.obj"
    bus.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n")
    mesh, packages = 'mesh = "package://bus_models/bus.obj"\n', '[packages]\nbus_models = "models"\n'
    for scale, expected in (("0.001", [0.001] * 3), ("[1.0, 2.0, 3.0]", [1.0, 2.0, 3.0])):
        satellite = f"{SATELLITE}{mesh}mesh_scale = {scale}\n"
        visual = read(tmp_path, satellite + packages + ARM).satellite.visuals[0]
        assert visual.mesh == bus and list(visual.size) == expected
    with pytest.raises(ConfigurationError, match="no package 'bus_models'"):
        read(tmp_path, SATELLITE + mesh + ARM)
    with pytest.raises(ConfigurationError, match="mesh_scale must be positive, got -1"):
        read(tmp_path, f"{SATELLITE}{mesh}mesh_scale = -1\n" + packages + ARM)
    for name, damaged in (("bus.obj", "nonsense"), ("bus.dae", "<COLLADA/>")):
        bus.with_name(name).write_text(damaged)
        with pytest.raises(ConfigurationError, match=rf"\[satellite\] .*{name}: "):
            read(tmp_path, SATELLITE + mesh.replace("bus.obj", name) + packages + ARM)


def test_robots_are_found_by_name_file_and_value(tmp_path: Path) -> None:
    file = written(tmp_path, SATELLITE + ARM)
    robot = find_robot(file)
    assert find_robot(str(file)) is robot
    assert find_robot(robot) is robot
    register_robot("test_description_arm", file)
    assert find_robot("test_description_arm").digest == robot.digest
    assert {"shyam2020", "shah2013", "spatial_dual_arm", "test_description_arm"} <= set(robot_names())
    with pytest.raises(ConfigurationError, match="unknown robot 'shyam2021'.* Did you mean 'shyam2020'"):
        find_robot("shyam2021")
    with pytest.raises(ConfigurationError, match="registered already"):
        register_robot("shyam2020", file)
    with pytest.raises(ConfigurationError, match="no file"):
        find_robot(tmp_path / "none.toml")
    (tmp_path / "arm.urdf").touch()
    for arm in (tmp_path / "arm.urdf", f"{tmp_path}/arm.urdf"):
        with pytest.raises(ConfigurationError, match=r"TOML.*\[\[arm\]\] file = 'arm.urdf'"):
            find_robot(arm)
    with pytest.raises(ConfigurationError, match="there is no file .*none.xml"):
        find_robot("none.xml")
    file.write_text((SATELLITE + ARM).replace("120.0", "130.0"))
    assert find_robot(file).satellite.inertial.mass == 130.0


REFUSED = {
    "unknown key": ("mass = 120.0", "mas = 120.0", "[satellite] unknown key 'mas'", "Did you mean 'mass'"),
    "no satellite": (SATELLITE, "", "lacks 'satellite'", ""),
    "no arm": (ARM, "", "one or two [[arm]] tables, got 0", ""),
    "one arm": ("[[arm]]", "[arm]", "arm must be a list of tables, got {'mount'", "write [[arm]]"),
    "long name": (SATELLITE, f'name = "{"x" * 101}"\n{SATELLITE}', "name must be", "at most 100"),
    "two lines": (SATELLITE, f'name = "x\\ny"\n{SATELLITE}', "name must be", "printable"),
    "no mass": (", mass = 6.0", "", "[arm 1.links 2] lacks 'mass', in kg", ""),
    "negative mass": ("mass = 6.0", "mass = -6.0", "mass must be a finite positive number", "-6.0"),
    "text for a number": ("a = 0.8", 'a = "0.8"', "[arm 1.links 2] a must be a finite number", ""),
    "nan": ("a = 0.8", "a = nan", "a must be a finite number, got nan", ""),
    "no limits": ("torque = 30.0", "", "there is no torque of 'joint 1', 'joint 2'", "limits.torque"),
    "zero rate": ("rate = 0.3", "rate = 0.0", "rate of 'joint 1' must be positive", ""),
    "length": ("home = [0.1, -0.7,", "home = [0.1,", "home must be a number, a list of 6 numbers", ""),
    "home outside": ("home = [0.1,", "home = [4.0,", "home of 'joint 1' is outside its range", "4.0"),
    "range": ("[[-3, 3], [-3, 3]", "[[3, -3], [-3, 3]", "range of 'joint 1' must be [least, largest]", ""),
    "ranges": ("[[-3, 3], ", "[", "range must be 6 pairs", ""),
    "quaternion": ("0.5] }", "0.5], quaternion = [1, 1, 0, 0] }", "quaternion must be a unit one", ""),
    "both": ("home =", 'file = "x.urdf"\nhome =', "needs either 'file'", ""),
    "target": (SATELLITE, SATELLITE + "[target]\nmass = 1.0\n", "this robot has one arm", ""),
    "no rod": ("{ a = 0.8, mass = 6.0 }", "{ a = 0.8, d = 0.3, mass = 6.0 }", "lacks 'inertia'", "0.8"),
    "triangle": (
        "mass = 6.0",
        "mass = 6.0, inertia = [1.0, 1.0, 2.5]",
        "inertia breaks the triangle inequality",
        "[1.0, 1.0, 2.5]",
    ),
    "satellite's inertia": (
        "mass = 120.0",
        "mass = 120.0\ninertia = [1, 1, 1, 5, 0, 0]",
        "belongs to no body",
        "",
    ),
    "size": ("size = [0.8, 1.0, 1.0]", "size = [0.8, -1.0, 1.0]", "size must be positive", ""),
    "no toml": ("[satellite]", "[satellite", "is no valid TOML", ""),
    "step": (
        SATELLITE,
        SATELLITE + "[simulation]\ntimestep = -1\n",
        "timestep must be a finite positive",
        "",
    ),
    "steps": (
        SATELLITE,
        SATELLITE + "[simulation]\ntimestep = 0.02\nlargest_timestep = 0.01\n",
        "timestep must be at most largest_timestep",
        "",
    ),
    "long step": (
        SATELLITE,
        SATELLITE + "[simulation]\ntimestep = 1.0\n",
        "[simulation] largest_timestep must be at most largest_control_period",
        "1.0",
    ),
    "list of links": ("links = [", "links = 3\nother = [", "unknown key 'other'", ""),
    "mesh": ("mass = 120.0", 'mass = 120.0\nmesh = "bus.stl"', "there is no mesh", "bus.stl"),
    "capsule": (
        "radius = 0.05",
        'radius = 0.05\ncapsules = [{ link = 1, start = "link9", end = "tool", radius = 0.1 }]',
        "unknown point 'link9'",
        "valid are 'link1'",
    ),
}


@pytest.mark.parametrize("case", REFUSED)
def test_mistakes_are_explained(case: str, tmp_path: Path) -> None:
    old, new, *words = REFUSED[case]
    text = SATELLITE + ARM
    assert old in text
    with pytest.raises(ConfigurationError) as refusal:
        read(tmp_path, text.replace(old, new, 1))
    for word in (*words, "arm.toml"):
        assert word in str(refusal.value)


vectors = st.lists(st.floats(-2.0, 2.0), min_size=3, max_size=3).map(np.array)


@st.composite
def bodies(draw: st.DrawFn) -> Inertial:
    """A body made of four point masses."""
    points = np.array([draw(vectors) for _ in range(4)]) + 0.1 * np.array(
        [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]
    )
    mass = np.array([draw(st.floats(0.1, 5.0)) for _ in range(4)])
    centre = mass @ points / mass.sum()
    away = points - centre
    inertia = np.einsum("i,ij,ik->jk", mass, away, away)
    inertia = np.trace(inertia) * np.eye(3) - inertia
    return principal(float(mass.sum()), centre, inertia)


def moments(body: Inertial) -> tuple[float, np.ndarray, np.ndarray]:
    """Zeroth, first and second moment of mass about the frame's origin."""
    centre = np.array(body.centre)
    inertia = matrix(body) + body.mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
    return body.mass, body.mass * centre, inertia


@given(bodies(), bodies(), vectors)
def test_combined_bodies_keep_the_moments_of_their_mass(one: Inertial, two: Inertial, by: np.ndarray) -> None:
    other = moved(two, by, [0.5, 0.5, 0.5, 0.5])
    whole = moments(combined([one, other]))
    for got, first, second in zip(whole, moments(one), moments(other), strict=True):
        np.testing.assert_allclose(got, first + second, rtol=1e-9, atol=1e-9)


def test_the_frame_of_a_satellite_is_at_the_centre_of_mass_of_all_that_is_fixed_to_it(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(URDF)
    robot = read(tmp_path, SATELLITE + ON_A_HEAVY_ROOT)
    box, root = np.array(robot.satellite.box_centre), np.array([0.1, 0.2, 0.5 + 0.25])
    assert robot.satellite.inertial.mass == 120.0 + 30.0
    np.testing.assert_allclose(120.0 * box + 30.0 * (box + root), 0.0, atol=1e-9)
    # The arm stands where it is mounted on the box.
    np.testing.assert_allclose(np.array(robot.links[0].position) - box, [0.1, 0.2, 0.5], atol=1e-12)
