"""Time steps and acceleration limits of robots whose descriptions have none."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from robot_descriptions import SIX_JOINTS

from space_envs.codegen.cache import CACHE_VARIABLE
from space_envs.control import CONTROL_MODES
from space_envs.drives import STOP_MARGIN, Drive, JointStops
from space_envs.errors import ConfigurationError
from space_envs.robots.models import robot_model
from space_envs.robots.models.accelerations import default_acceleration, reduced_masses
from space_envs.robots.robot import Robot, StepLimits
from space_envs.robots.zoo import find_robot
from space_envs.simulation import Simulation
from space_envs.step_limits.measured import UNMEASURED, measured_steps
from space_envs.step_limits.motions import SimulationSettings, fast_starts, full_range_motion
from space_envs.step_limits.storage import read_steps

BUILT_IN = (
    *(("shyam2020", "paper"), ("shyam2020", "physical")),
    *(("shah2013", None), ("spatial_dual_arm", None)),
)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv(CACHE_VARIABLE, str(tmp_path / "cache"))
    return tmp_path / "cache"


def described(tmp_path: Path, text: str = SIX_JOINTS) -> Path:
    file = tmp_path / "six_joints.toml"
    file.write_text(text)
    return file


@pytest.fixture
def six_joints(tmp_path: Path) -> Robot:
    return find_robot(described(tmp_path))


@pytest.mark.parametrize(("name", "variant"), BUILT_IN)
def test_measured_steps_of_the_built_in_robots_are_those_of_their_long_tests_or_half(
    name: str, variant: str | None
) -> None:
    robot = find_robot(name, variant)
    measured = measured_steps(robot)
    for found, tested in zip(measured[:2], robot.steps[:2], strict=True):
        assert tested / 2 <= found <= tested
    assert measured.largest_control_period == 0.1 <= robot.steps.largest_control_period


@pytest.mark.parametrize("mode", CONTROL_MODES)
def test_longer_motions_with_measured_steps_keep_the_bound(six_joints: Robot, mode: str) -> None:
    steps = measured_steps(six_joints)
    settings = SimulationSettings(mode, steps.largest_control_period, steps.largest_timestep)
    motion = full_range_motion(six_joints, settings, 20.0, 30, seed=1)
    assert motion.drift <= 1e-6
    assert motion.stop_distance > 0.5 * STOP_MARGIN
    assert motion.peak_rate < 1.5
    assert np.abs(motion.qvel[..., 6:]).max() > 0.9 * 0.4  # it really moved


def test_a_description_without_steps_is_measured_once(tmp_path: Path, cache: Path) -> None:
    calls = []

    def measure(robot: Robot) -> StepLimits:
        calls.append(robot)
        return measured_steps(robot)

    file = described(tmp_path, SIX_JOINTS.replace("mass = 150.0", "mass = 151.0"))
    robot = find_robot(file, measure=measure)
    assert robot.steps == measured_steps(robot) and len(calls) == 1
    key = replace(robot, steps=UNMEASURED).digest
    assert read_steps(key) == robot.steps
    [stored] = (cache / "steps").iterdir()
    stored.write_text("{}")
    assert read_steps(key) is None


def test_faster_motions_take_smaller_steps(six_joints: Robot) -> None:
    fast = with_joints(six_joints, rate_limit=2.0, acceleration_limit=4.0)
    slow, steps = measured_steps(six_joints), measured_steps(fast)
    assert steps.largest_timestep < slow.largest_timestep
    assert steps.largest_control_period < slow.largest_control_period


def test_a_robot_that_no_time_step_suits_is_an_error(
    six_joints: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("space_envs.step_limits.measured.DRIFT", 1e-20)
    with pytest.raises(ConfigurationError, match="'six_joints' cannot be simulated with any time step"):
        measured_steps(with_joints(six_joints, rate_limit=0.1))


def with_joints(robot: Robot, **limits: float) -> Robot:
    """The robot with other values of all joints."""
    arms = [
        replace(
            arm,
            links=tuple(replace(link, joint=replace(link.joint, **limits)) for link in arm.links),
        )
        for arm in robot.arms
    ]
    return replace(robot, arms=tuple(arms))


def test_fast_starts_can_just_be_braked(six_joints: Robot) -> None:
    robot = replace(six_joints, steps=UNMEASURED)
    position, velocity = fast_starts(robot, 60, np.random.default_rng(0))
    stops = JointStops(robot)
    low, high = stops.rates(position)
    assert ((velocity >= low) & (velocity <= high)).all()
    assert (np.abs(velocity) > 0.99 * 0.4).any()


# Default accelerations


@pytest.mark.parametrize(("name", "variant"), BUILT_IN)
def test_torques_give_the_default_acceleration_to_all_joints_in_any_direction(
    name: str, variant: str | None
) -> None:
    robot = find_robot(name, variant)
    acceleration = np.array(default_acceleration(robot))
    masses = reduced_masses(robot)
    signs = np.sign(np.random.default_rng(0).uniform(-1, 1, (64, robot.n_joints)))
    torques = masses[:, None] @ (signs * acceleration)[..., None]
    assert np.abs(torques[..., 0] / robot.torque_limit).max() <= 1.0 + 1e-12
    assert (acceleration <= robot.rate_limit / 1.0).all() and len(acceleration) == robot.n_joints


def test_reduced_masses_are_those_of_the_drives() -> None:
    robot = find_robot("shyam2020", "physical")
    simulation = Simulation(robot_model(robot), 1)
    simulation.reset(np.arange(1))
    simulation.refresh()
    drive = Drive(simulation, 0.1, robot)
    drive.reset(np.arange(1))
    drive.begin()
    wanted = np.full((1, 7), 1e-3)
    np.testing.assert_allclose(drive.accelerate(wanted)[0], reduced_masses(robot)[0] @ wanted[0], rtol=1e-9)


def test_a_description_without_accelerations_says_what_is_assumed(tmp_path: Path) -> None:
    robot = find_robot(described(tmp_path))
    assert robot.acceleration_limit.tolist() == pytest.approx([0.4] * 6)
    assert any("joint 6 have no acceleration limits and get 0.4 rad/s^2" in note for note in robot.notes)
    given = described(tmp_path, SIX_JOINTS.replace("rate = 0.4", "rate = 0.4\nacceleration = 0.2"))
    assert find_robot(given).acceleration_limit.tolist() == [0.2] * 6
    assert not any("acceleration" in note for note in find_robot(given).notes)
