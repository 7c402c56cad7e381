"""Every command with a robot that a user describes in a file: what it writes, finds again and refuses."""

import json
import pickle
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from any_robots import PLANAR_FOUR, SIX_JOINTS, TWO_SIX
from dataset_folders import run as make_dataset
from hypothesis import given
from hypothesis import strategies as st
from offenders import assert_refused
from synthetic_results import untimed
from training_runs import QUICK

from agents.commands import replay
from agents.commands.choice import choose_ids
from agents.commands.evaluate import main as evaluate
from agents.commands.train import main as train
from agents.demonstrations.__main__ import main as demonstrate
from agents.planners.common.robot_files import VARIABLE
from space_envs.errors import ConfigurationError
from space_envs.evaluation.datasets.card import read_card
from space_envs.evaluation.datasets.storage import Dataset
from space_envs.evaluation.play.entry import DIGITS
from space_envs.evaluation.play.episode_file import load_episodes
from space_envs.evaluation.records.storage import read_records
from space_envs.evaluation.results.folders import read_folder
from space_envs.registration import ENTRIES
from space_envs.robots.description.plain import robot_from_plain, to_plain
from space_envs.robots.export import main as export
from space_envs.robots.zoo import find_robot, register_robot

SINGLE, CLUTTERED, PLANAR, SPATIAL = ENTRIES
BRIEF = ["--policy", "gjm", "--episodes", "2", "--no-pictures", "--jobs", "1"]
FILE = "mine.toml"  # its robot is called six_joints
PPO = "--init none --num-envs 8 --n-steps 16 --batch-size 64 --steps 256 --hidden 16".split()
TRAIN = Path(__file__).parents[1] / "train.py"


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder: one of its own, with a robot's description; what is made for robots goes there."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(VARIABLE, str(tmp_path / "made"))
    Path(FILE).write_text(SIX_JOINTS)
    return tmp_path


def make_heavier() -> None:
    """Double the mass of the satellite in the description."""
    Path(FILE).write_text(SIX_JOINTS.replace("mass = 300.0", "mass = 600.0"))


def tetrahedron() -> bytes:
    """A mesh as a binary STL file."""
    corners = np.vstack([np.zeros(3), np.eye(3)]).astype("<f4")
    facets = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    triangles = [bytes(12) + corners[list(facet)].tobytes() + bytes(2) for facet in facets]
    return bytes(80) + len(facets).to_bytes(4, "little") + b"".join(triangles)


@pytest.mark.usefixtures("brief_reports")
def test_records_are_those_of_the_robot_however_it_is_named(here: Path, capsys) -> None:
    register_robot("commands_six", FILE)
    made = []
    for number, source in enumerate((FILE, str(here / FILE), f"./{FILE}", "commands_six")):
        more = ["--jobs", "2"] if number == 3 else []  # the other processes do not know the name
        assert evaluate([*BRIEF, *more, "--robot", source, "--output", str(number)]) == 0
        made.append(read_records(here / str(number) / "records.jsonl"))
    assert all(untimed(each) == untimed(made[0]) for each in made)
    digest = find_robot(FILE).digest
    assert {(each.robot, each.robot_digest) for each in made[0]} == {("six_joints", digest[:DIGITS])}
    summary = json.loads(Path("0/summary.json").read_text())
    (configuration,) = summary["provenance"]["configurations"].values()
    assert (configuration["robot"], configuration["robot_digest"]) == ("six_joints", digest)
    for name in ("leaderboard.md", "report.html"):
        assert "six_joints" in (here / "0" / name).read_text()
    capsys.readouterr()
    assert evaluate(["show", "0", "--task", "six_joints"]) == 0
    assert "six_joints" in capsys.readouterr().out
    assert evaluate(["show", "0", "--task", "six_joint"]) == 2
    assert "Did you mean 'six_joints'" in capsys.readouterr().err


@pytest.mark.usefixtures("brief_reports")
def test_two_robots_are_never_in_one_table(here: Path, capsys) -> None:
    """Here they even have the same name."""
    assert evaluate([*BRIEF, "--robot", FILE, "--output", "light"]) == 0
    light = find_robot(FILE).digest[:DIGITS]
    make_heavier()
    assert evaluate([*BRIEF, "--robot", FILE, "--output", "heavy"]) == 0
    heavy = find_robot(FILE).digest[:DIGITS]
    capsys.readouterr()
    assert evaluate(["compare", "light", "heavy", "--output", "both"]) == 2
    said = capsys.readouterr().err
    assert f"six_joints ({light})" in said and f"six_joints ({heavy})" in said and "--separate" in said
    assert not Path("both").exists()
    assert evaluate(["compare", "light", "heavy", "--output", "both", "--separate"]) == 0
    rows = json.loads(Path("both/summary.json").read_text())["rows"]
    assert {(row["robot_digest"], row["rank"]) for row in rows} == {(light, 1), (heavy, 1)}
    page = Path("both/report.html").read_text(encoding="utf-8")
    assert all(f"<b>six_joints</b> robot, digest {digest}" in page for digest in (light, heavy))
    recorded = [load_episodes(path) for path in (here / "both" / "episodes").iterdir()]
    assert {each.robot.satellite.inertial.mass for each in recorded} == {300.0, 600.0}


@pytest.mark.usefixtures("brief_reports")
def test_episodes_are_replayed_without_the_description(here: Path) -> None:
    Path(FILE).write_text(SIX_JOINTS.replace("[satellite]", '[satellite]\nmesh = "bus.stl"', 1))
    Path("bus.stl").write_bytes(tetrahedron())
    assert evaluate([*BRIEF, "--robot", FILE, "--output", "out"]) == 0
    robot = find_robot(FILE)
    Path(FILE).unlink()
    Path("bus.stl").unlink()
    folder = read_folder(here / "out")
    chosen = replay.recorded(folder, folder.records[1])
    assert chosen.task.robot.digest == robot.digest and chosen.task.robot.links == robot.links
    assert robot.satellite.visuals and not chosen.task.robot.satellite.visuals
    assert chosen.scene.shape[1] == chosen.task.render_model.nq
    assert evaluate(["compare", "out", "--output", "again"]) == 0


@pytest.mark.usefixtures("brief_reports")
def test_an_evaluation_is_not_resumed_with_another_robot(here: Path, capsys) -> None:
    words = [*BRIEF, "--robot", FILE, "--output", "out"]
    assert evaluate(words) == 0
    before = find_robot(FILE).digest
    make_heavier()
    capsys.readouterr()
    assert evaluate([*words, "--resume"]) == 2
    said = capsys.readouterr().err
    assert "holds another evaluation" in said
    assert before[:DIGITS] in said and find_robot(FILE).digest[:DIGITS] in said
    # What is only for people may change.
    Path(FILE).write_text(f"# Mine.\n{SIX_JOINTS}")
    assert evaluate([*words, "--resume"]) == 0


def test_all_ids_are_those_that_the_robot_fits(capsys) -> None:
    for robot, fitting in (({}, list(ENTRIES)), ({"robot": FILE}, [SINGLE, CLUTTERED])):
        assert choose_ids(["all"], robot) == fitting
        omitted = [env_id for env_id in ENTRIES if env_id not in fitting]
        notes = [line.partition(" needs ")[0] for line in capsys.readouterr().err.splitlines()]
        assert notes == [f"note: omitted, {env_id}" for env_id in omitted]
    Path("planar.toml").write_text("[[arm]]".join(PLANAR_FOUR.split("[[arm]]")[:2]))
    assert evaluate(["--env", "all", *BRIEF, "--robot", "planar.toml", "--output", "out"]) == 2
    assert f"the robot fits no id: {SINGLE} needs a robot with one arm in space" in capsys.readouterr().err
    assert evaluate(["--list"]) == 0
    assert "  panda  " in capsys.readouterr().out


def test_datasets_name_their_robot(here: Path, capsys) -> None:
    minari = pytest.importorskip("minari")
    words = ["--policy", "gjm", "--episodes", "2", "--robot", FILE, "--format", "npz", "minari"]
    assert make_dataset(here / "out", *words) == 0
    name = "space-capture/SingleArm-v0/gjm-mine-medium-train-v0"
    card, digest = read_card(here / "out" / name), find_robot(FILE).digest
    assert card is not None and card["request"]["robot"] == "six_joints"
    assert card["configuration"]["robot_digest"] == digest
    assert f"| robot | six_joints, {digest[:DIGITS]} |" in (here / "out" / name / "README.md").read_text()
    about = Dataset.load(here / "out" / name / "episodes.npz").about
    assert (about["robot"], about["robot_digest"]) == ("six_joints", digest[:DIGITS])
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("MINARI_DATASETS_PATH", str(here / "out"))
        dataset = minari.load_dataset(name)
        env = dataset.recover_environment()
    assert env.unwrapped.task.robot == find_robot(FILE)
    (first, *_) = dataset.storage.get_episode_metadata([0])
    seen, _ = env.reset(seed=first["seed"], options=first["options"])
    np.testing.assert_array_equal(seen, dataset[0].observations[0])
    make_heavier()
    capsys.readouterr()
    assert make_dataset(here / "out", *words) == 2
    assert "holds another dataset: robot_digest was" in capsys.readouterr().err


@pytest.mark.usefixtures("brief_reports")
def test_a_policy_is_trained_for_the_robot_alone(here: Path, capsys) -> None:
    for words in (["--robot", FILE], ["--env-kwargs", f"robot={FILE}"]):
        assert train([*PPO, *words, "--dry-run"]) == 0
        assert f'"robot" = "{here}/{FILE}"' in capsys.readouterr().out
    assert train([*PPO, *QUICK, "--robot", FILE, "--output", "run"]) == 0
    config = json.loads(Path("run/config.json").read_text())
    assert config["robot"]["digest"] == find_robot(FILE).digest
    assert train([*QUICK, "--resume", "run", "--steps", "512"]) == 0
    played = ["--policy", "run", *BRIEF[2:]]
    assert evaluate([*played, "--robot", FILE, "--output", "out"]) == 0
    assert {each.robot for each in read_records(here / "out" / "records.jsonl")} == {"six_joints"}
    capsys.readouterr()
    for other in ([], ["--robot", "ets_vii"]):
        assert evaluate([*played, *other, "--output", "none"]) == 2
        assert "the policy was trained for the robot six_joints" in capsys.readouterr().err
    make_heavier()
    command = [sys.executable, str(TRAIN), "--resume", "run", "--steps", "768"]
    done = subprocess.run(command, cwd=here, capture_output=True, text=True)
    assert done.returncode == 2 and "run was made for the robot six_joints (nominal," in done.stderr


def test_demonstrations_are_kept_by_robot(here: Path, capsys) -> None:
    assert demonstrate(["--robot", FILE, "--count", "3"]) == 0
    assert "3 demonstrations of six_joints" in capsys.readouterr().out
    (folder,) = (here / "made").iterdir()
    assert find_robot(FILE).digest.startswith(folder.name)
    assert demonstrate(["--robot", FILE, "--count", "3"]) == 2
    assert "--overwrite" in capsys.readouterr().err
    make_heavier()
    assert demonstrate(["--robot", FILE, "--count", "3"]) == 0
    assert len(list((here / "made").iterdir())) == 2


def test_models_of_the_robot_are_exported(capsys) -> None:
    for form, word in (("mjcf", 'joint name="joint6"'), ("urdf", 'robot name="six_joints"')):
        assert export(["--robot", FILE, "--format", form]) == 0
        assert word in capsys.readouterr().out


def test_environments_take_a_robot_and_travel_with_it() -> None:
    robot = replace(find_robot(FILE), name="an object")
    env = gym.make(SINGLE, robot=robot)
    assert env.spec is not None
    seen, _ = env.reset(seed=3)
    np.testing.assert_array_equal(gym.make(env.spec).reset(seed=3)[0], seen)
    vector = gym.make_vec(SINGLE, num_envs=2, robot=robot)
    Path(FILE).unlink()
    copy = pickle.loads(pickle.dumps(vector))
    assert copy.task.robot == robot and copy.task.robot is not robot
    for each in (vector, copy):
        np.testing.assert_array_equal(each.reset(seed=3)[0][0], seen)


@pytest.mark.slow
@pytest.mark.usefixtures("brief_reports")
@pytest.mark.parametrize(("name", "package"), [("ray", "ray"), ("dask", "distributed")])
def test_workers_on_other_machines_need_no_description(here: Path, name: str, package: str) -> None:
    pytest.importorskip(package)
    made = []
    for more in ([], ["--backend", name, "--jobs", "2"]):
        assert evaluate([*BRIEF, *more, "--robot", FILE, "--output", str(len(made))]) == 0
        made.append(untimed(read_records(here / str(len(made)) / "records.jsonl")))
    assert made[0] == made[1]


def test_mistakes_are_one_line(here: Path, capsys) -> None:
    Path("noise.toml").write_bytes(bytes(range(128, 256)))
    Path("empty.toml").touch()
    Path("two.toml").write_text(TWO_SIX)
    Path("folder.toml").mkdir()
    cases = {
        "pnada": "unknown robot 'pnada'; valid are",
        "pand": "Did you mean 'panda'",
        "mine": "Did you mean 'mine.toml'",
        "min.toml": f"there is no file '{here}/min.toml'. Did you mean '{here}/mine.toml'",
        "folder.toml": f"'{here}/folder.toml' is a folder, expected a description (TOML)",
        "noise.toml": f"{here}/noise.toml is no valid TOML",
        "empty.toml": f"{here}/empty.toml: a robot has one or two [[arm]] tables, got 0",
    }
    unfit = f"{SINGLE} needs a robot with one arm in space, 'two_six' has two arms in space"
    asked = [(["--env", SINGLE, "--robot", "two.toml"], unfit)]
    asked += [(["--robot", source], message) for source, message in cases.items()]
    asked += [
        (["--robot", FILE, "--env", SPATIAL], f"{SPATIAL} needs a robot with two arms in space"),
        (["--robot", FILE, "--variant", "real"], "unknown model variant 'real'; valid are 'nominal'"),
    ]
    assert_refused(lambda words: evaluate([*BRIEF, *words, "--output", "out"]), asked, capsys)
    assert_refused(lambda words: train([*words, "--output", "out"]), asked, capsys)
    assert_refused(lambda words: evaluate(["dataset", *words, "--output", "out"]), asked, capsys)
    assert not Path("out").exists()


def _places(value: Any, path: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths of all parts of plain values."""
    yield path
    parts = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else ()
    for key, part in parts:
        yield from _places(part, (*path, key))


def _replaced(value: Any, path: Sequence[Any], new: Any) -> Any:
    if not path:
        return new
    copy = dict(value) if isinstance(value, dict) else list(value)
    copy[path[0]] = _replaced(value[path[0]], path[1:], new)
    return copy


PLAIN = to_plain(find_robot("shah2013"))
WRONG = (None, True, "x", 1, -2.5, [], [1.0, 2.0, 3.0], {}, float("nan"), float("inf"), 10**400)


@given(st.sampled_from(list(_places(PLAIN))), st.sampled_from(WRONG))
def test_damaged_values_are_refused_or_are_another_robot(path: tuple[Any, ...], new: Any) -> None:
    damaged, message = _replaced(PLAIN, path, new), "robot"
    try:
        found = to_plain(robot_from_plain(damaged))
    except ConfigurationError as error:
        found, message = damaged, str(error)
    assert found == damaged and message.startswith("robot")
