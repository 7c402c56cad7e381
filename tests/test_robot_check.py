"""The check of a robot: its figures against MuJoCo, every rule of what is implausible, and the command."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
from robot_descriptions import SIX_JOINTS

from space_envs.errors import SpaceEnvsError
from space_envs.robots.__main__ import main
from space_envs.robots.check.figures.conditioning import conditioning, scaled_jacobian
from space_envs.robots.check.figures.contacts import home_gaps
from space_envs.robots.check.figures.goals import goal_problem
from space_envs.robots.check.figures.masses import mass_figures, torque_figures
from space_envs.robots.check.figures.robot_figures import RobotFigures, robot_figures
from space_envs.robots.check.implausible import RULES, implausible
from space_envs.robots.check.pictures import stretched
from space_envs.robots.check.planners import planner_figures
from space_envs.robots.check.verification import verify
from space_envs.robots.description.reading import read_robot
from space_envs.robots.models import robot_model
from space_envs.robots.models.mechanics import robot_mechanics
from space_envs.robots.robot import Inertial, Link, Robot, StepLimits
from space_envs.robots.zoo import find_robot
from space_envs.step_limits.measured import measured_steps


def described(folder: Path, text: str = SIX_JOINTS) -> Path:
    file = folder / "six_joints.toml"
    file.write_text(text)
    return file


@pytest.fixture(scope="module")
def figures(tmp_path_factory: pytest.TempPathFactory) -> RobotFigures:
    """Of a plausible robot of six joints."""
    return robot_figures(read_robot(described(tmp_path_factory.mktemp("robot")), measure=measured_steps))


# Figures


@pytest.mark.parametrize("name", ["shyam2020", "shah2013", "spatial_dual_arm"])
def test_masses_are_those_of_mujoco(name: str) -> None:
    robot = find_robot(name)
    found, model = mass_figures(robot), robot_model(robot)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    root = model.body("satellite").id
    assert found.total == pytest.approx(model.body_subtreemass[root])
    np.testing.assert_allclose(found.centre, data.subtree_com[root], atol=1e-12)
    inertia = np.zeros((3, 3))
    for body in range(model.nbody):
        if model.body_rootid[body] == root:
            turn, arm = data.ximat[body].reshape(3, 3), data.xipos[body] - data.subtree_com[root]
            own = turn @ np.diag(model.body_inertia[body]) @ turn.T
            inertia += own + model.body_mass[body] * (arm @ arm * np.eye(3) - np.outer(arm, arm))
    np.testing.assert_allclose(found.moments, np.linalg.eigvalsh(inertia), rtol=1e-9)


def test_conditioning_is_that_of_the_maps_in_use() -> None:
    robot = find_robot("spatial_dual_arm")
    found, tree = conditioning(robot), robot_mechanics(robot)
    jacobian = scaled_jacobian(robot, robot.home)
    assert jacobian.shape == (12, 14)
    rotations = jacobian[[3, 4, 5, 9, 10, 11]]
    np.testing.assert_allclose(rotations[:3], tree.generalized_jacobian(robot.home, 0)[3:])
    assert found.condition.home == pytest.approx(np.linalg.cond(jacobian))
    assert found.null_space == 14 - 3 and found.null_spaces == (11, 11) and found.rank == 12
    assert conditioning(find_robot("shah2013")).null_space == 6 - 1
    spread = found.smallest
    assert 0.0 < spread.low < spread.median < spread.high


def test_a_simulation_keeps_what_the_suite_promises(figures: RobotFigures) -> None:
    assert [mode.mode for mode in figures.modes] == [
        *("joint_velocity", "joint_torque", "end_effector_velocity", "reactionless"),
    ]
    assert 0.0 < figures.drift <= 1e-6 and 0.5 < figures.rate < 1.5
    assert figures.tracking.rate < 0.01 and figures.tracking.position < 1e-3
    assert np.rad2deg(figures.attitude.reactionless) < 0.05 < np.rad2deg(figures.attitude.joint_velocity)
    assert implausible(figures) == ()


def test_a_stretched_arm_is_as_long_as_its_links() -> None:
    robot = find_robot("shah2013")
    position, _ = robot_mechanics(robot).end_effector_pose(stretched(robot), 0)
    mount = np.array(robot.arms[0].links[0].position)
    assert np.linalg.norm(position - mount) == pytest.approx(robot.arms[0].length, abs=1e-3)


# Rules


def with_links(robot: Robot, change: Callable[[Link], Link], number: int) -> Robot:
    """The robot with one link, numbered from 1, changed."""
    [arm] = robot.arms
    links = [change(link) if place == number else link for place, link in enumerate(arm.links, start=1)]
    return replace(robot, arms=(replace(arm, links=tuple(links)),))


def with_joint(robot: Robot, number: int = 3, **values: Any) -> Robot:
    return with_links(robot, lambda link: replace(link, joint=replace(link.joint, **values)), number)


def with_inertial(robot: Robot, number: int = 2, **values: Any) -> Robot:
    return with_links(robot, lambda link: replace(link, inertial=replace(link.inertial, **values)), number)


def with_satellite(robot: Robot, **values: Any) -> Robot:
    return replace(robot, satellite=replace(robot.satellite, **values))


def at_home(robot: Robot, *home: float) -> Robot:
    for number, angle in enumerate(home, start=1):
        robot = with_joint(robot, number, home=angle)
    return robot


FAULTS: dict[str, Callable[[Robot], Robot]] = {
    "reach": lambda robot: with_links(robot, lambda link: replace(link, position=(600.0, 0.0, 0.0)), 3),
    "link mass": lambda robot: with_inertial(robot, mass=0.1),
    "link inertia": lambda robot: with_inertial(robot, moments=(0.2, 25.0, 25.0)),
    "link centre of mass": lambda robot: with_inertial(robot, centre=(3.0, 0.0, 0.0)),
    "satellite mass": lambda robot: with_satellite(robot, inertial=Inertial(20.0, (2.0, 2.0, 2.0))),
    "satellite inertia": lambda robot: with_satellite(robot, inertial=Inertial(150.0, (900.0, 900.0, 900.0))),
    "weak drive": lambda robot: with_joint(robot, 1, torque_limit=0.5),
    "weak brakes": lambda robot: with_joint(robot, 1, torque_limit=0.2),
    "rotor inertia": lambda robot: with_joint(robot, 6, rotor_inertia=0.0),
    "joint rate": lambda robot: with_joint(robot, rate_limit=6.0, acceleration_limit=6.0),
    "joint range": lambda robot: with_joint(robot, range=(1.3, 3.0)),
    "singular home": lambda robot: at_home(robot, 0.0, 1.2, 0.0, -1.2, 0.0, 0.0),
    "goals": lambda robot: at_home(robot, 0.0, -1.2, 0.3, 0.0, 0.9, 0.0),
    "contact at home": lambda robot: at_home(robot, 0.0, -1.2, 0.3, 0.0, 0.9, 0.0),
}


@pytest.mark.parametrize("rule", FAULTS)
def test_a_planted_fault_is_found(figures: RobotFigures, rule: str) -> None:
    robot = FAULTS[rule](figures.robot)
    faulty = replace(
        figures,
        robot=robot,
        masses=mass_figures(robot),
        conditioning=conditioning(robot),
        torques=torque_figures(robot),
        gaps=home_gaps(robot),
        goals=goal_problem(robot),
    )
    found = implausible(faulty)
    assert rule in {finding.rule for finding in found}
    for finding in found:
        assert any(digit in finding.text for digit in "0123456789")


def test_a_joint_that_starts_at_once_or_near_its_end_is_found(figures: RobotFigures) -> None:
    for robot, text in (
        (with_joint(figures.robot, acceleration_limit=100.0), "joint 3 .* reaches its rate limit in 0.004 s"),
        (with_joint(figures.robot, home=-2.9), r"joint 3 .* is 0\.1 rad from the end of its range"),
    ):
        findings = implausible(replace(figures, robot=robot))
        assert any(re.search(text, finding.text) for finding in findings)


@pytest.mark.parametrize(
    ("rule", "measured", "drift"),
    [
        ("control period", StepLimits(0.01, 0.0125, 0.05), 1e-8),
        ("time step", StepLimits(0.0025, 0.003125, 0.1), 1e-8),
        ("momentum", StepLimits(0.01, 0.0125, 0.1), 3e-6),
    ],
)
def test_a_simulation_that_is_hard_is_found(
    figures: RobotFigures, rule: str, measured: StepLimits, drift: float
) -> None:
    modes = tuple(replace(mode, drift=drift) for mode in figures.modes)
    [finding] = implausible(replace(figures, measured=measured, modes=modes))
    assert finding.rule == rule


def test_every_rule_has_a_fault() -> None:
    assert {*FAULTS, "control period", "time step", "momentum"} == {*RULES}


# Command


def test_the_command_prints_the_figures_tests_the_robot_and_writes_the_page(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    described(tmp_path, SIX_JOINTS.replace("mass = 150.0", "mass = 15.0"))
    assert main(["check", "six_joints.toml", "--test", "--no-planners", "--no-pictures"]) == 0
    out = capsys.readouterr().out
    outcomes = [
        found[1] for line in out.splitlines() if (found := re.search(r"  (passed|FAILED|not run)  ", line))
    ]
    assert outcomes == ["passed"] * (4 + 4 + 1 + 3)
    for text in ("Masses", "Conditioning", "Momentum and drives", "Tracking and attitude", "Page: "):
        assert text in out
    assert "Implausible (satellite mass): the satellite has 15 kg, less than the 22.5 kg of its arm" in out
    [page] = tmp_path.glob("*_check.html")
    text = page.read_text()
    assert "<h2>What looks implausible</h2>" in text and "less than the 22.5 kg" in text
    assert "python -m space_envs.robots check six_joints.toml --test --no-planners" in text
    assert "have no acceleration limits and get" in text


def test_a_robot_without_goals_gets_its_page_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    without = {", 0.0]\nlinks": "]\nlinks", "  { d = 0.15, mass = 1.5 },\n": "", ", 10.0]": "]"}
    five = SIX_JOINTS.replace(", [-3.0, 3.0]]", "]")
    for text, instead in without.items():
        five = five.replace(text, instead)
    described(tmp_path, five)
    assert main(["check", "six_joints.toml", "--no-pictures"]) == 0
    assert "Implausible (goals): no task takes robot" in capsys.readouterr().out
    assert (tmp_path / "six_joints_check.html").is_file()


def test_what_is_wrong_with_the_command_line_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments, message in (
        (["check", "pandda"], "Did you mean 'panda'?"),
        (["check", str(tmp_path / "no.toml")], "there is no file"),
        (["check", "panda", "--goals", "0"], "--goals must be a positive integer"),
    ):
        assert main(arguments) == 2
        assert message in capsys.readouterr().err


def test_a_robot_that_fails_a_test_ends_the_command_with_status_1(
    figures: RobotFigures, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    coarse = replace(figures.robot, steps=StepLimits(0.1, 0.1, 0.5))
    failed = next(verify(coarse, "SpaceCapture/SingleArm-v0"))
    assert failed.name == "momentum, joint_velocity" and failed.passed is False
    monkeypatch.setattr("space_envs.robots.check.command.verify", lambda *_: iter([failed]))
    options = ["--no-planners", "--no-pictures", "--output", str(tmp_path / "page.html")]
    assert main(["check", str(described(tmp_path)), "--test", *options]) == 1
    assert re.search(r"momentum, joint_velocity +FAILED +relative drift", capsys.readouterr().out)


def test_planners_are_measured_as_evaluate_py_does(tmp_path: Path) -> None:
    found = planner_figures(str(described(tmp_path)), "SpaceCapture/SingleArm-v0", 2, ["gjm", "hold"])
    assert [(one.policy, one.captured, one.goals) for one in found] == [("gjm", 2, 2), ("hold", 0, 2)]
    assert 0.0 < found[0].score < 1.0 < found[0].peak_attitude and found[1].score == 0.0
    assert found[0].failure == "" < found[1].failure and np.isnan(found[1].final_attitude)
    with pytest.raises(SpaceEnvsError, match="evaluate.py ended with status 2"):
        planner_figures("no_robot", "SpaceCapture/SingleArm-v0", 2)
