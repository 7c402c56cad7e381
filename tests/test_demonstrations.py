"""Demonstrations: what they must be, and that files of them are repeatable, resumable and checked."""

import dataclasses
import hashlib
import json
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest

from agents.demonstrations import storage as store
from agents.demonstrations.__main__ import main
from agents.demonstrations.controller import Demonstrations, demonstrate
from agents.demonstrations.elastic_bands import (
    BandObstacles,
    end_effector_path,
    joint_detour,
    relax,
    straight_path,
    task_detour,
)
from agents.demonstrations.prior import fit_prior
from agents.demonstrations.variations import BANDS, KINDS, DemonstratorConfig
from agents.policies.single_arm.promp import prior_of
from promp import ProMP
from space_envs.dynamics import roll_out_base, trajectory_cost
from space_envs.dynamics.rotations import angle_between, from_matrix, multiply, rotate
from space_envs.errors import ConfigurationError, PlanningError
from space_envs.robots.zoo import find_robot
from space_envs.tasks.single_arm import SingleArmTask

CONFIG = DemonstratorConfig()
ROBOT = find_robot("shyam2020")


def equal(a: Demonstrations, b: Demonstrations) -> bool:
    return all(np.array_equal(getattr(a, f.name), getattr(b, f.name)) for f in dataclasses.fields(a))


@pytest.fixture(scope="module", params=BANDS)
def made(request: pytest.FixtureRequest) -> Demonstrations:
    return demonstrate(ROBOT, dataclasses.replace(CONFIG, bands=request.param), 0, 0, 30)


def test_demonstrations_go_from_home_to_their_goals_and_rest(made: Demonstrations) -> None:
    task = SingleArmTask()
    np.testing.assert_allclose(made.time, np.arange(101) * 0.1)
    np.testing.assert_allclose(made.position[:, 0], np.tile(task.mechanics.home, (30, 1)), atol=1e-12)
    assert np.abs(made.velocity[:, 0]).max() < 1e-12
    assert np.abs(made.velocity[:, -1]).max() < CONFIG.rest
    goals = task.goals("train", made.goal_index)
    position, quaternion = roll_out_base(task.mechanics, made.position, made.velocity, 0.1)
    local, rotation = task.mechanics.end_effector_pose(made.position[:, -1])
    at = position[:, -1] + rotate(quaternion[:, -1], local)
    assert np.linalg.norm(at - goals.position, axis=1).max() < 1e-4
    turned = multiply(quaternion[:, -1], from_matrix(rotation))
    assert np.rad2deg(angle_between(turned, goals.quaternion)).max() < 0.01
    assert (np.abs(made.velocity) < ROBOT.rate_limit).all()
    assert (np.abs(np.diff(made.velocity, axis=1)) / 0.1 < ROBOT.acceleration_limit).all()
    np.testing.assert_array_equal(
        made.cost, trajectory_cost(task.mechanics, made.position, made.velocity, 0.1)
    )


def test_velocities_are_the_slopes_of_positions(made: Demonstrations) -> None:
    moved = np.diff(made.position, axis=1)
    expected = 0.05 * (made.velocity[:, 1:] + made.velocity[:, :-1])
    # Exact for the controlled motion; the detours are smooth curves, for which it is the trapezoidal rule.
    assert np.abs(moved - expected)[made.kind != KINDS.index("elastic_band")].max() < 1e-4
    assert np.abs(moved - expected).max() < 1e-3


def test_every_goal_is_reached_in_different_ways(made: Demonstrations) -> None:
    assert (made.kind == np.arange(30) % len(KINDS)).all()
    assert len(np.unique(made.goal_index)) == 10
    for first in range(0, 30, 3):
        assert len(set(made.goal_index[first : first + 3].tolist())) == 1
        ways = made.position[first : first + 3]
        for a, b in ((0, 1), (0, 2), (1, 2)):
            assert np.abs(ways[a] - ways[b]).max() > 0.02


def test_goals_spread_over_the_train_split() -> None:
    index = (np.arange(540) // CONFIG.per_goal * 1597) % 4096
    assert len(np.unique(index)) == 180
    # No large part of the split is left out.
    assert np.diff(np.sort(index)).max() < 60


@pytest.mark.parametrize("bands", BANDS)
def test_a_demonstration_is_the_same_alone(bands: str) -> None:
    config = dataclasses.replace(CONFIG, bands=bands)
    together = demonstrate(ROBOT, config, 0, 12, 3)
    for number in (12, 13, 14):
        alone = demonstrate(ROBOT, config, 0, number, 1)
        np.testing.assert_array_equal(alone.position[0], together.position[number - 12])
    assert np.abs(demonstrate(ROBOT, config, 1, 12, 1).position - together.position[:1]).max() > 1e-3


def test_bands_in_task_space_vary_the_elastic_band_kind_alone() -> None:
    """The paper's obstacles lie between the end-effector's points; those of the shipped prior do not."""
    joint, task = (demonstrate(ROBOT, dataclasses.replace(CONFIG, bands=bands), 0, 0, 9) for bands in BANDS)
    apart = np.abs(task.position - joint.position).max(axis=(1, 2))
    assert (apart[joint.kind != KINDS.index("elastic_band")] == 0).all()
    assert (apart[joint.kind == KINDS.index("elastic_band")] > 0.02).all()


def test_what_cannot_be_drawn_is_an_error() -> None:
    with pytest.raises(PlanningError, match=r"\[0, 1\].*failed"):
        demonstrate(ROBOT, dataclasses.replace(CONFIG, rest=1e-12), 0, 0, 2)
    with pytest.raises(ConfigurationError, match="Did you mean 'medium'"):
        DemonstratorConfig(difficulty="medum")
    with pytest.raises(ConfigurationError, match="unknown space of elastic bands 'tsk'.*Did you mean 'task'"):
        DemonstratorConfig(bands="tsk")


def nearest(path: np.ndarray, centre: np.ndarray) -> np.ndarray:
    return np.linalg.norm(path - centre[:, None], axis=-1).min(axis=1)


PROGRESS = np.linspace(0, 1, 101) ** 2 * (3 - 2 * np.linspace(0, 1, 101))


def test_bands_keep_away_from_obstacles() -> None:
    rng = np.random.default_rng(0)
    start, goal = rng.uniform(-0.5, 0.5, (2, 20, 7))
    centre = 0.5 * (start + goal) + 0.05 * rng.standard_normal((20, 7))
    obstacles = BandObstacles(centre, np.full(20, 0.6))
    straight = straight_path(start, goal)
    band = relax(straight, obstacles)
    np.testing.assert_array_equal(band[:, 0], start)
    np.testing.assert_allclose(band[:, -1], goal, atol=1e-15)
    assert (nearest(band, centre) > nearest(straight, centre) + 0.02).all()
    # Without an obstacle the band is straight, and there is no detour.
    none = BandObstacles(centre, np.zeros(20))
    np.testing.assert_allclose(relax(straight, none), straight, atol=1e-12)
    off = joint_detour(start, goal, obstacles, PROGRESS, 0.1)
    for end in (0, -1):
        assert np.abs(off.position[:, end]).max() < 1e-12 and np.abs(off.velocity[:, end]).max() < 1e-12
    slope = np.gradient(off.position, 0.1, axis=1)
    np.testing.assert_allclose(off.velocity[:, 1:-1], slope[:, 1:-1], atol=5e-3)


def test_bands_in_task_space_lead_the_end_effector_around_spheres() -> None:
    arm, rng = SingleArmTask().mechanics, np.random.default_rng(1)
    start = np.tile(arm.home, (12, 1))
    goal = start + rng.uniform(-0.6, 0.6, (12, 7))
    straight = straight_path(start, goal)
    way = end_effector_path(arm, straight)
    spheres = BandObstacles(way[:, 10] + 0.05 * rng.standard_normal((12, 3)), np.full(12, 0.4))
    off = task_detour(arm, start, goal, spheres, np.linspace(0.0, 1.0, len(straight[0])), 0.5)
    around = end_effector_path(arm, straight + off.position)
    # The end-effector is on the relaxed band, farther from the sphere than without it, and ends alike.
    band = relax(way, spheres)
    np.testing.assert_allclose(around, band, atol=2e-3)
    assert (nearest(around, spheres.centre) > nearest(way, spheres.centre) + 0.03).all()
    np.testing.assert_allclose(around[:, [0, -1]], way[:, [0, -1]], atol=1e-12)
    none = BandObstacles(spheres.centre, np.zeros(12))
    assert np.abs(task_detour(arm, start, goal, none, PROGRESS, 0.1).position).max() < 1e-9


# Files


@pytest.fixture
def small_parts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "CHUNK", 3)


@pytest.mark.usefixtures("small_parts")
def test_jobs_and_interruptions_change_nothing(tmp_path: Path) -> None:
    serial = store.generate(tmp_path / "serial", ROBOT, 7, seed=5)
    parallel = store.generate(tmp_path / "parallel", ROBOT, 7, seed=5, jobs=2)
    assert equal(serial, parallel)
    parts = sorted((tmp_path / "serial" / "parts").iterdir())
    assert [part.name for part in parts] == ["000000-003.npz", "000003-003.npz", "000006-001.npz"]
    assert not [path for path in tmp_path.rglob("*") if path.name.startswith(".")]
    kept = parts[0].stat().st_mtime_ns
    parts[1].unlink()
    assert equal(store.generate(tmp_path / "serial", ROBOT, 7, seed=5), serial)
    assert parts[0].stat().st_mtime_ns == kept
    # More of the same goes on from what is there.
    more = store.generate(tmp_path / "serial", ROBOT, 9, seed=5)
    assert parts[0].stat().st_mtime_ns == kept
    np.testing.assert_array_equal(more.position[:7], serial.position)
    loaded, origin = store.load(tmp_path / "serial" / "demonstrations.npz")
    assert equal(loaded, more)
    assert origin["seed"] == 5 and origin["config"]["difficulty"] == "medium"
    assert origin["command"] == (
        "python -m agents.demonstrations --robot shyam2020 --count 9 --seed 5 --difficulty medium"
    )


def test_files_that_were_changed_are_refused(tmp_path: Path) -> None:
    store.generate(tmp_path, ROBOT, 1)
    path = next((tmp_path / "parts").iterdir())
    whole = path.read_bytes()
    changed = bytearray(whole)
    changed[len(changed) // 2] ^= 1
    for content in (bytes(changed), whole[:-100], b"", b"not an npz"):
        path.write_bytes(content)
        with pytest.raises(ConfigurationError, match=path.name):
            store.load(path)
        with pytest.raises(ConfigurationError, match=path.name):
            store.generate(tmp_path, ROBOT, 1)
    # A whole archive whose numbers are others than those that were written.
    path.write_bytes(whole)
    with np.load(path) as archive:
        arrays = dict(archive)
    arrays["position"] = arrays["position"] + 1e-9
    np.savez(path, **arrays)
    with pytest.raises(ConfigurationError, match="checksum"):
        store.load(path)
    np.savez(path, **{**arrays, "kind": np.array([{}], dtype=object)}, allow_pickle=True)
    with pytest.raises(ConfigurationError, match=path.name):
        store.load(path)
    np.savez(path, position=np.zeros(3))
    with pytest.raises(ConfigurationError, match="expected space-capture-demonstrations"):
        store.load(path)
    assert len(store.generate(tmp_path, ROBOT, 1, resume=False).kind) == 1


def test_parts_of_another_recipe_are_refused(tmp_path: Path) -> None:
    store.generate(tmp_path, ROBOT, 1)
    with pytest.raises(ConfigurationError, match="another seed or config"):
        store.generate(tmp_path, ROBOT, 1, seed=1)
    with pytest.raises(ConfigurationError, match="another seed or config"):
        store.generate(tmp_path, ROBOT, 1, config=DemonstratorConfig(difficulty="easy"))
    for wrong in ({"count": 0}, {"seed": -1}, {"jobs": 0}, {"count": 1.5}):
        with pytest.raises(ConfigurationError, match=next(iter(wrong))):
            store.generate(tmp_path, ROBOT, **{"count": 1, **wrong})  # type: ignore[arg-type]


def test_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder, prior = tmp_path / "out", tmp_path / "prior.npz"
    common = ["--output", str(folder), "--count", "3"]
    assert main([*common, "--fit", str(prior)]) == 0
    assert "3 demonstrations of shyam2020 in" in capsys.readouterr().out
    assert ProMP.load(prior).n_dof == 7
    origin = json.loads(prior.with_suffix(".json").read_text())
    assert origin["sha256"] == hashlib.sha256(prior.read_bytes()).hexdigest()
    assert str(tmp_path) not in prior.with_suffix(".json").read_text()
    assert main([*common, "--seed", "3"]) == 2
    assert "another seed or config" in capsys.readouterr().err


def test_shipped_prior_is_what_its_command_makes(tmp_path: Path) -> None:
    data = files("agents") / "data"
    origin = json.loads((data / "promp_prior.json").read_text())
    assert origin["sha256"] == hashlib.sha256((data / "promp_prior.npz").read_bytes()).hexdigest()
    assert origin["config"] == CONFIG.as_dict()
    made = store.generate(tmp_path, ROBOT, jobs=2, seed=origin["seed"])
    assert origin["command"] == store.provenance(ROBOT, CONFIG, origin["seed"], len(made.kind))["command"]
    # All kinds are among them, and few had to be drawn anew.
    assert np.bincount(made.kind).tolist() == [180, 180, 180]
    assert (made.attempt > 0).mean() < 0.3
    again, shipped = fit_prior(made), prior_of(ROBOT)
    np.testing.assert_allclose(again.mean, shipped.mean, atol=1e-4)
    np.testing.assert_allclose(again.covariance, shipped.covariance, atol=1e-4)
