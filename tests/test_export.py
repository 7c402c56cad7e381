"""Exported models, read back by MuJoCo and by Pinocchio."""

import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
import pytest

from space_envs.errors import ConfigurationError
from space_envs.robots.export import _roll_pitch_yaw, export, main
from space_envs.robots.models import SceneOptions, robot_model
from space_envs.robots.robot import Robot
from space_envs.robots.zoo import find_robot

VARIANTS = ("paper", "physical")
DUAL_ARMS = ("shah2013", "spatial_dual_arm")
END_EFFECTORS = ("end_effector1", "end_effector2")


def mass_matrix(model: mujoco.MjModel, data: mujoco.MjData) -> np.ndarray:
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    return mass


def random_state(model: mujoco.MjModel, generator: np.random.Generator) -> mujoco.MjData:
    data = mujoco.MjData(model)
    data.qpos[:] = generator.uniform(-3, 3, model.nq)
    for joint in range(model.njnt):
        if int(model.jnt_type[joint]) == int(mujoco.mjtJoint.mjJNT_FREE):
            start = int(model.jnt_qposadr[joint]) + 3
            quaternion = generator.normal(size=4)
            data.qpos[start : start + 4] = quaternion / np.linalg.norm(quaternion)
    mujoco.mj_forward(model, data)
    return data


def dual_arm(name: str, mount: tuple[float, float]) -> Robot:
    """A robot with two arms; in the plane, with another place of the first one."""
    robot = find_robot(name)
    return robot.mounted_at((mount, (-0.5, -0.1))) if robot.planar else robot


@pytest.mark.parametrize("visual", [False, True])
@pytest.mark.parametrize("name", [*VARIANTS, *DUAL_ARMS])
def test_mjcf_reads_back_as_the_same_model(name: str, visual: bool) -> None:
    robot = find_robot("shyam2020", name) if name in VARIANTS else dual_arm(name, (0.5, 1 / 3))
    ours = robot_model(robot, SceneOptions(visual=visual))
    theirs = mujoco.MjModel.from_xml_string(export("mjcf", robot, visual))
    for name in ("nq", "nv", "nu", "nmocap", "nsensordata", "ngeom", "ncam", "nlight", "nkey", "nsite"):
        assert getattr(ours, name) == getattr(theirs, name), name
    for name in ("body_mass", "body_inertia", "body_ipos", "body_iquat", "body_pos", "body_quat", "key_qpos"):
        np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), rtol=0, atol=1e-14)
    for name in (
        "jnt_range",
        "dof_armature",
        "actuator_ctrlrange",
        "actuator_forcerange",
        "site_pos",
        "site_quat",
    ):
        np.testing.assert_allclose(getattr(theirs, name), getattr(ours, name), rtol=0, atol=1e-14)
    assert int(theirs.opt.integrator) == int(mujoco.mjtIntegrator.mjINT_RK4)
    assert not theirs.opt.gravity.any()
    generator = np.random.default_rng(0)
    for _ in range(20):
        mine = random_state(ours, generator)
        other = mujoco.MjData(theirs)
        other.qpos[:] = mine.qpos
        mujoco.mj_forward(theirs, other)
        expected = mass_matrix(ours, mine)
        np.testing.assert_allclose(mass_matrix(theirs, other), expected, rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(other.sensordata, mine.sensordata, rtol=0, atol=1e-12)


@pytest.mark.parametrize("variant", VARIANTS)
def test_urdf_agrees_with_mujoco_in_pinocchio(variant: str) -> None:
    ours = find_robot("shyam2020", variant)
    model = robot_model(ours)
    robot = pin.buildModelFromXML(export("urdf", ours), pin.JointModelFreeFlyer())
    assert list(robot.names)[2:] == [f"joint{number}" for number in range(1, 8)]
    np.testing.assert_allclose(robot.lowerPositionLimit[7:], model.jnt_range[1:, 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(robot.upperPositionLimit[7:], model.jnt_range[1:, 1], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(robot.upperEffortLimit[6:], np.full(7, 60.0))
    np.testing.assert_array_equal(robot.upperVelocityLimit[6:], np.full(7, 0.3))
    numbers = robot.createData()
    frame = robot.getFrameId("end_effector")
    generator = np.random.default_rng(1)
    for _ in range(50):
        data = random_state(model, generator)
        w, x, y, z = data.qpos[3:7]
        q = np.array([*data.qpos[:3], x, y, z, w, *data.qpos[7:]])  # Pinocchio's quaternion ends with w
        upper = np.triu(pin.crba(robot, numbers, q))
        mass = upper + np.triu(upper, 1).T
        # Pinocchio's base velocity is in body axes, MuJoCo's linear one in world axes.
        axes = np.eye(13)
        axes[:3, :3] = data.body("satellite").xmat.reshape(3, 3).T
        expected = mass_matrix(model, data) - np.diag(model.dof_armature)  # URDF has no rotor inertia
        np.testing.assert_allclose(axes.T @ mass @ axes, expected, rtol=1e-12, atol=1e-10)
        pin.framesForwardKinematics(robot, numbers, q)
        pose, site = numbers.oMf[frame], data.site("end_effector")
        np.testing.assert_allclose(pose.translation, site.xpos, rtol=0, atol=1e-10)
        np.testing.assert_allclose(pose.rotation, site.xmat.reshape(3, 3), rtol=0, atol=1e-10)


def in_pinocchio(robot: Robot) -> pin.Model:
    floating = pin.JointModelPlanar() if robot.planar else pin.JointModelFreeFlyer()
    return pin.buildModelFromXML(export("urdf", robot), floating)


@pytest.mark.parametrize("name", DUAL_ARMS)
def test_urdf_of_two_arms_agrees_with_mujoco_in_pinocchio(name: str) -> None:
    ours = dual_arm(name, (0.4, 1 / 3))
    model = robot_model(ours)
    robot = in_pinocchio(ours)
    first = 3 if ours.planar else 6  # of the joints, among MuJoCo's and Pinocchio's velocities
    size = first + model.nu
    names = [f"arm{arm}_joint{number}" for arm in (1, 2) for number in range(1, model.nu // 2 + 1)]
    assert list(robot.names)[2:] == names == [model.actuator(i).name for i in range(model.nu)]
    limits = model.jnt_range[[model.joint(name).id for name in names]]
    np.testing.assert_allclose(robot.lowerPositionLimit[-model.nu :], limits[:, 0], rtol=0, atol=1e-15)
    np.testing.assert_allclose(robot.upperPositionLimit[-model.nu :], limits[:, 1], rtol=0, atol=1e-15)
    np.testing.assert_array_equal(robot.upperEffortLimit[first:], np.full(model.nu, 60.0))
    np.testing.assert_array_equal(robot.upperVelocityLimit[first:], np.full(model.nu, 0.3))
    numbers = robot.createData()
    generator = np.random.default_rng(2)
    for _ in range(30):
        data = random_state(model, generator)
        data.qvel[:] = generator.normal(size=model.nv)
        mujoco.mj_forward(model, data)
        mujoco.mj_subtreeVel(model, data)
        turn = data.body("satellite").xmat.reshape(3, 3)
        # Pinocchio's base velocity is in body axes, MuJoCo's linear one in world axes.
        axes = np.eye(size)
        axes[: first - 3, : first - 3] = turn.T[: first - 3, : first - 3]
        if ours.planar:
            axes[:2, :2] = turn.T[:2, :2]
            q = np.array([*data.qpos[:2], np.cos(data.qpos[2]), np.sin(data.qpos[2]), *data.qpos[3:9]])
        else:
            w, x, y, z = data.qpos[3:7]
            q = np.array([*data.qpos[:3], x, y, z, w, *data.qpos[7:21]])
        upper = np.triu(pin.crba(robot, numbers, q))
        mass = upper + np.triu(upper, 1).T
        expected = (mass_matrix(model, data) - np.diag(model.dof_armature))[:size, :size]
        np.testing.assert_allclose(axes.T @ mass @ axes, expected, rtol=1e-12, atol=1e-10)
        pin.computeCentroidalMomentum(robot, numbers, q, axes @ data.qvel[:size])
        satellite = model.body("satellite").id
        momentum = [
            model.body_subtreemass[satellite] * data.subtree_linvel[satellite],
            data.subtree_angmom[satellite],
        ]
        np.testing.assert_allclose(numbers.hg.vector, np.concatenate(momentum), rtol=0, atol=1e-10)
        pin.framesForwardKinematics(robot, numbers, q)
        for name in END_EFFECTORS:
            pose, site = numbers.oMf[robot.getFrameId(name)], data.site(name)
            np.testing.assert_allclose(pose.translation, site.xpos, rtol=0, atol=1e-10)
            np.testing.assert_allclose(pose.rotation, site.xmat.reshape(3, 3), rtol=0, atol=1e-10)


def test_roll_pitch_yaw_where_two_of_them_turn_about_one_axis() -> None:
    generator = np.random.default_rng(3)
    for pitch in (*generator.uniform(-1.5, 1.5, 20), np.pi / 2, -np.pi / 2, np.pi / 2 - 1e-7):
        roll, yaw = generator.uniform(-3.0, 3.0, 2)
        wanted = pin.rpy.rpyToMatrix(roll, pitch, yaw)
        x, y, z, w = pin.Quaternion(wanted).coeffs()
        found = pin.rpy.rpyToMatrix(*_roll_pitch_yaw(np.array([w, x, y, z])))
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-14)


def test_command_prints_without_a_file(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--format", "urdf", "--variant", "physical"]) == 0
    assert ET.fromstring(capsys.readouterr().out).attrib["name"] == "shyam2020"


@pytest.mark.parametrize("name", DUAL_ARMS)
def test_command_exports_every_robot(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--robot", name, "--format", "urdf"]) == 0
    assert ET.fromstring(capsys.readouterr().out).attrib["name"] == name
    assert main(["--robot", name, "--visual"]) == 0
    assert mujoco.MjModel.from_xml_string(capsys.readouterr().out).ngeom > 100


def test_command_writes_a_file(tmp_path: Path) -> None:
    target = tmp_path / "new" / "arm.xml"
    command = [sys.executable, "-m", "space_envs.robots.export", "--visual", "-o", str(target)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert done.stdout == done.stderr == ""
    assert mujoco.MjModel.from_xml_path(str(target)).ngeom > 100
    assert [path.name for path in target.parent.iterdir()] == ["arm.xml"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--format", "urfd"], "unknown model format 'urfd'; valid are 'mjcf', 'urdf'. Did you mean 'urdf'?"),
        (["--robot", "shah2012"], "Did you mean 'shah2013'?"),
        (["--robot", "shah2013", "--variant", "paper"], "unknown model variant 'paper'; valid are 'nominal'"),
        (["--robot", "none.toml"], "there is no file"),
        (["--robot", "spatial_dual_arm", "--format", "urdf", "--visual"], "URDF is exported without"),
        (["--variant", "x"], "unknown model variant 'x'; valid are 'paper', 'physical'."),
        (["--format", "urdf", "--visual"], "URDF is exported without geometry"),
        (["-o", "/dev/null/arm.xml"], "/dev/null"),
    ],
)
def test_command_says_in_one_line_what_is_wrong(
    arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    printed = capsys.readouterr()
    assert printed.out == ""
    assert message in printed.err
    assert printed.err.startswith("python -m space_envs.robots.export: ")
    assert printed.err.count("\n") == 1


def test_unknown_format_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="unknown model format"):
        export("sdf", find_robot("shyam2020"))
