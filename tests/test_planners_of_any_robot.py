"""Planners on other robots: arms of six and eight joints, two planar arms of four, two of six in space."""

import json
import shlex
from collections.abc import Callable
from functools import cache
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from agents.demonstrations import __main__ as demonstrations
from agents.demonstrations.optimal import __main__ as libraries
from agents.demonstrations.optimal import library as library_store
from agents.demonstrations.reactionless import __main__ as reactionless_libraries
from agents.demonstrations.reactionless import library as reactionless_store
from agents.planners.common.robot_files import robot_folder, shipped_robots
from agents.planners.single_arm.inequalities.braking import Braking
from agents.planners.single_arm.inequalities.satellite import SatelliteClearance
from agents.planners.single_arm.library import REACTIONLESS, Library
from agents.planners.single_arm.weights.weight_space import WeightSpace
from agents.policies.registry import make_policy, needs
from agents.policies.single_arm.optimal import drive_limits, reaches
from agents.policies.single_arm.weights import PrompOptimal
from promp import GaussianBasis
from space_envs.drives import braking_deceleration
from space_envs.dynamics.rotations import to_matrix
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, PolicyError
from space_envs.evaluation.play.steps import steps
from space_envs.policy import PolicyContext
from space_envs.robots.robot import Robot
from space_envs.robots.zoo import find_robot

ROBOTS = Path(__file__).parent / "data" / "robots"
SIX, EIGHT, FOUR_AND_FOUR, SIX_AND_SIX = (
    str(ROBOTS / f"{name}.toml")
    for name in ("six_joints", "eight_joints", "planar_four_and_four", "spatial_six_and_six")
)
SINGLE, PLANAR, SPATIAL = (
    f"SpaceCapture/{name}-v0" for name in ("SingleArm", "DualArmPlanar", "DualArmSpatial")
)


@cache
def environment(env_id: str, robot: str, count: int) -> CaptureVectorEnv:
    return CaptureVectorEnv(env_id, count, autoreset_mode="disabled", robot=robot)


def context(robot: str, env_id: str = SINGLE) -> PolicyContext:
    return PolicyContext.from_env(environment(env_id, robot, 4))


def captured(policy: str, env_id: str, robot: str, count: int = 4) -> np.ndarray:
    """Whether each of the first test goals is captured."""
    env = environment(env_id, robot, count)
    observation, _ = env.reset(seed=0, options={"split": "test", "index": np.arange(count)})
    found = np.zeros(count, dtype=bool)
    for step in steps(make_policy(policy, PolicyContext.from_env(env), 0), env, observation):
        found |= step.info["is_success"]
    return found


@pytest.mark.parametrize("policy", ["gjm", "minimum_jerk", "mpc", "promp_optimal"])
def test_six_joints_capture(policy: str) -> None:
    assert captured(policy, SINGLE, SIX).all()


def test_eight_joints_capture() -> None:
    assert captured("promp_optimal", SINGLE, EIGHT, 2).all()


def test_two_planar_arms_of_four_joints_capture() -> None:
    assert captured("reactionless_rate", PLANAR, FOUR_AND_FOUR, 2).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("policy", "env_id", "robot", "least"),
    [
        ("promp_optimal_kept", SINGLE, SIX, 0.7),
        ("nmpc", SINGLE, SIX, 0.9),
        ("reactionless_local", PLANAR, FOUR_AND_FOUR, 0.6),
        ("reactionless_ocp", PLANAR, FOUR_AND_FOUR, 0.6),
        ("reactionless_free", PLANAR, FOUR_AND_FOUR, 0.9),
        ("reactionless_rate", SPATIAL, SIX_AND_SIX, 0.3),  # one joint less than a rendezvous asks for
    ],
)
def test_most_goals_are_captured(policy: str, env_id: str, robot: str, least: float) -> None:
    assert captured(policy, env_id, robot, 6).mean() >= least


def test_plans_stay_within_the_limits_of_each_joint() -> None:
    here = context(SIX)
    observation, _ = environment(SINGLE, SIX, 4).reset(options={"split": "test", "index": np.arange(4)})
    limits = drive_limits(here)
    assert limits.rate is not None and limits.acceleration is not None
    for plan in PrompOptimal(here).plan(reaches(here, observation, False)):
        q, rate, acceleration = plan.sample(np.linspace(0.0, plan.time[-1], 201))
        assert (np.abs(rate) <= 1.01 * limits.rate).all()
        assert (np.abs(acceleration) <= 1.05 * limits.acceleration).all()
        assert here.contacts is not None
        assert here.contacts.satellite_gaps(here.contacts.points(here.arm, q)).min() > 0.0
    assert len(set(np.asarray(limits.rate).tolist())) > 1


@pytest.mark.parametrize("kind", ["braking", "satellite"])
def test_rows_agree_with_differences(kind: str) -> None:
    here = context(SIX)
    rest, rotation = np.zeros(6), to_matrix(np.array([1.0, 0.0, 0.0, 0.0]))
    space = WeightSpace(here.arm, GaussianBasis(), here.arm.home, rest, 4.0, np.ones(3), rotation, 1.0)
    rng = np.random.default_rng(3)
    y = 0.6 * rng.standard_normal((6, space.free))
    if kind == "braking":
        rows = Braking(space, braking_deceleration(here.robot), here.joint_limits)
    else:
        contacts = here.contacts
        assert contacts is not None
        rows = SatelliteClearance(space, lambda q: contacts.satellite_gaps(contacts.points(here.arm, q)))
    matrix, low, high = rows.linear(y, space.disturbance(y[None]), 1.0)
    assert len(matrix) > 3
    step = 1e-6 * rng.standard_normal(y.shape)
    moved, beyond, above = rows.linear(y + step, space.disturbance((y + step)[None]), 1.0)
    assert len(moved) == len(matrix)
    before, after = (
        np.where(np.isfinite(side), side, other) for side, other in ((low, high), (beyond, above))
    )
    change = before - after
    np.testing.assert_allclose(change, matrix @ step.ravel(), atol=2e-8)


# Files that are made for a robot


@pytest.fixture
def made(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("SPACE_ENVS_ROBOTS", str(tmp_path))
    return tmp_path


def command(words: str) -> list[str]:
    """Arguments of the command in the message of a policy that does not fit."""
    return shlex.split(words[words.index("`") + 1 : words.rindex("`")])


@pytest.mark.usefixtures("made")
def test_promp_works_after_the_command_that_it_names() -> None:
    (reason,) = needs("promp").missing(context(SIX))
    words = command(reason)
    assert words == ["python", "-m", "agents.demonstrations", "--robot", SIX]
    with pytest.raises(PolicyError, match="a ProMP of demonstrations of the robot 'six_joints'"):
        make_policy("promp", context(SIX), 0)
    assert demonstrations.main([*words[3:], "--count", "60"]) == 0
    assert not needs("promp").missing(context(SIX))
    assert captured("promp", SINGLE, SIX).all()
    origin = json.loads((robot_folder(find_robot(SIX)) / "promp_prior.json").read_text())
    assert origin["robot"] == described(find_robot(SIX)) and SIX in origin["command"]


def described(robot: Robot) -> dict[str, str]:
    return {"name": robot.name, "variant": robot.variant, "digest": robot.digest}


@pytest.mark.usefixtures("made")
def test_libraries_are_found_again_and_resumed(monkeypatch: pytest.MonkeyPatch) -> None:
    (reason,) = needs("promp_demonstrated").missing(context(SIX))
    words = command(reason)[3:]
    assert words[:2] == ["--robot", SIX]
    made = libraries.main, library_store, robot_folder(find_robot(SIX)) / "library_free_limited.npz"
    resumed_after_a_kill(monkeypatch, *made, words)
    assert not needs("promp_demonstrated").missing(context(SIX))


def test_reactionless_libraries_are_resumed(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    made = reactionless_libraries.main, reactionless_store, tmp_path / REACTIONLESS
    resumed_after_a_kill(monkeypatch, *made, ["--output", str(tmp_path)])


def resumed_after_a_kill(
    monkeypatch: pytest.MonkeyPatch,
    make: Callable[[list[str]], int],
    store: ModuleType,
    path: Path,
    words: list[str],
) -> None:
    """Make a library, lose a part and the result as a kill would, and make it again."""
    words, parts = [*words, "--goals", "4"], path.with_suffix("")
    monkeypatch.setattr(store, "CHUNK", 2)
    monkeypatch.setattr(store, "ROUNDS", 1)
    assert make(words) == 0
    first = Library.load(path)
    assert len(first.cost) > 2
    (parts / "1-00002.npz").unlink()
    path.unlink()
    kept = (parts / "1-00000.npz").stat().st_mtime_ns
    assert make(words) == 0
    assert (parts / "1-00000.npz").stat().st_mtime_ns == kept
    np.testing.assert_array_equal(Library.load(path).coordinates, first.coordinates)
    assert make([*words, "--seed", "1"]) == 2  # parts of another recipe


def test_files_of_another_robot_are_refused(made: Path, capsys: pytest.CaptureFixture[str]) -> None:
    six, eight = find_robot(SIX), find_robot(EIGHT)
    assert demonstrations.main(["--robot", SIX, "--count", "6"]) == 0
    robot_folder(six).rename(robot_folder(eight))
    with pytest.raises(ConfigurationError, match=r"made for the robot six_joints .*, not for eight_joints"):
        needs("promp").missing(context(EIGHT))
    capsys.readouterr()
    folder = robot_folder(eight) / "demonstrations"
    options = ["--output", str(folder), "--fit", str(made / "prior.npz"), "--count", "6"]
    assert demonstrations.main(["--robot", EIGHT, *options]) == 2
    assert "was made for the robot six_joints" in capsys.readouterr().err


def test_what_ships_is_for_the_robots_of_the_ids() -> None:
    for env_id in (SINGLE, PLANAR, SPATIAL):
        assert PolicyContext.from_env(CaptureVectorEnv(env_id)).robot.digest in shipped_robots()
    assert find_robot("shyam2020", "physical").digest in shipped_robots()


def test_learned_policies_are_for_their_own_robot() -> None:
    (reason,) = needs("bc").missing(context(SIX))
    assert "its weights are for the robot shyam2020" in reason and f"--robot {SIX}" in reason
