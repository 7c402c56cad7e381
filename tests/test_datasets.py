"""Datasets: nothing is written that its actions do not bring about again, and a card says what it is."""

import json
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from dataset_folders import CHEAP, SINGLE, contents, folder, run
from evaluated_tasks import evaluated

from agents.policies.resolve import resolve_policy
from space_envs.envs import CaptureEnv
from space_envs.errors import ConfigurationError
from space_envs.evaluation.datasets import minari as datasets_minari
from space_envs.evaluation.datasets.card import plain, read_card, write_card
from space_envs.evaluation.datasets.recording import check, record
from space_envs.evaluation.datasets.storage import Dataset
from space_envs.evaluation.datasets.trajectory import first_difference
from space_envs.evaluation.play.chunks import Chunk


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    """Two episodes of a cheap expert on every id, in both formats."""
    pytest.importorskip("minari")
    root = tmp_path_factory.mktemp("datasets")
    formats = ["--format", "npz", "minari"]
    assert (
        run(root, "--env", "all", "--policy", *sorted(set(CHEAP.values())), "--episodes", "2", *formats) == 0
    )
    return root


@pytest.fixture(scope="module")
def chunk() -> Chunk:
    return Chunk(resolve_policy("gjm"), *evaluated(SINGLE, split="train"), 0, 3, (7, 4000))


@pytest.fixture(scope="module")
def recorded(chunk):
    result = record(chunk)
    assert not result.omitted
    return result.trajectories


# Replay ------------------------------------------------------------------------------------------


def test_replay_finds_what_was_changed(chunk, recorded):
    env = CaptureEnv(**chunk.environment)
    one = recorded[1]
    assert (one.episode, one.index, one.seed) == (4, 4000, 4)
    assert check(one, env) is None
    action = one.actions.copy()
    action[17, 2] = np.nextafter(action[17, 2], np.float32(0.0))
    assert "observations differ from row 18 on" in str(check(replace(one, actions=action), env))
    reward = one.rewards.copy()
    reward[-1] += 1e-12
    row = len(reward) - 1
    assert f"rewards differ from row {row} on" in str(check(replace(one, rewards=reward), env))
    assert "outcome is captured, was timeout" in str(check(replace(one, outcome="timeout"), env))
    assert "observations differ from row 0" in str(check(replace(one, index=4001), env))
    longer = np.concatenate([one.actions, one.actions[-1:]])
    n = len(one.actions)
    assert f"there are {n} actions, there were {n + 1}" in str(check(replace(one, actions=longer), env))
    shorter = replace(one, actions=one.actions[:-1])
    assert "outcome is running, was captured" in str(check(shorter, env))


def test_what_is_recorded_is_what_was_acted_on(tmp_path):
    assert run(tmp_path, "--policy", "dataset_folders:Wild", "--episodes", "2") == 0
    data = Dataset.load(folder(tmp_path, policy="dataset_folders-Wild") / "episodes.npz")
    assert data.actions.dtype == np.float32
    assert data.actions.min() == -1.0
    env = CaptureEnv(difficulty="medium", split="train")
    observation, _ = env.reset(seed=0, options={"index": int(data.index[0])})
    np.testing.assert_array_equal(observation, data.observations[0])
    assert data.observations[1:, :7].any()


# Files ------------------------------------------------------------------------------------------


def test_npz_round_trip(tmp_path, recorded):
    data = Dataset.of({"env_id": SINGLE, "split": "train"}, recorded)
    data.save(tmp_path / "a.npz")
    data.save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()
    again = Dataset.load(tmp_path / "a.npz")
    assert again.about == data.about
    assert len(again) == 2
    for k, one in enumerate(recorded):
        assert first_difference(one, again.trajectory(k)) is None
    assert again.lengths.tolist() == [len(one.rewards) for one in recorded]
    with pytest.raises(ConfigurationError, match="there are 2 episodes"):
        again.trajectory(2)


def test_npz_needs_no_project_to_be_read(made):
    """As docs/datasets.md says: the arrays alone tell the episodes apart."""
    with np.load(folder(made) / "episodes.npz", allow_pickle=False) as file:
        data = dict(file)
    assert int(data["schema"]) == 1
    for k in range(2):
        begin, end = data["step_start"][k : k + 2]
        first, last = data["observation_start"][k : k + 2]
        assert last - first == end - begin + 1
        ended = (data["terminations"] | data["truncations"])[begin:end]
        assert ended.sum() == 1
        assert ended[-1]
        time = data["observations"][first:last, -1]
        np.testing.assert_allclose(time, 0.1 * np.arange(len(time)), atol=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": np.int64(2)}, "schema 2, this version reads 1"),
        ({"about": np.array([{"a": 1}], dtype=object)}, "holds objects of Python"),
        ({"actions": np.full((3, 7), 2.0, dtype=np.float32)}, "actions must have length"),
        ({"step_start": np.array([0, 5, 6])}, "do not divide the arrays"),
        ({"captured": np.array([True, False])}, "captured and outcome disagree"),
        ({"rewards": np.zeros(4, dtype=np.float32)}, "rewards must be float64"),
        ({"extra": np.zeros(1)}, "extra"),
    ],
)
def test_other_files_are_refused(tmp_path, recorded, change, message):
    Dataset.of({"env_id": SINGLE}, recorded).save(tmp_path / "good.npz")
    with np.load(tmp_path / "good.npz") as file:
        arrays = dict(file)
    np.savez(tmp_path / "bad.npz", allow_pickle=True, **(arrays | change))
    with pytest.raises(ConfigurationError, match=message) as error:
        Dataset.load(tmp_path / "bad.npz")
    assert "bad.npz" in str(error.value)


def test_an_episode_that_does_not_end_is_refused(recorded):
    cut = {
        name: getattr(recorded[0], name)[:-1]
        for name in ("actions", "rewards", "terminations", "truncations")
    }
    whole = recorded[0]
    with pytest.raises(ConfigurationError, match="each episode must end once"):
        Dataset.of({}, [replace(whole, observations=whole.observations[:-1], **cut)])
    at_the_horizon = replace(whole, truncations=whole.terminations)  # a capture in the last step there is
    assert len(Dataset.of({}, [at_the_horizon])) == 1


@pytest.mark.filterwarnings("ignore:Package space-capture is not installed")
def test_minari_round_trip(made):
    minari = pytest.importorskip("minari")
    names = {env: folder(made, env, CHEAP[env]).relative_to(made).as_posix() for env in CHEAP}
    with datasets_minari.datasets_path(made):
        assert sorted(minari.list_local_datasets()) == sorted(names.values())
        sets = {env: minari.load_dataset(name) for env, name in names.items()}
    for env_id, dataset in sets.items():
        plain = Dataset.load(folder(made, env_id, CHEAP[env_id]) / "episodes.npz")
        env = dataset.recover_environment()
        assert env.unwrapped.vector.env_id == env_id
        assert dataset.observation_space == env.observation_space
        metadata = list(dataset.storage.get_episode_metadata(dataset.episode_indices))
        for k, episode in enumerate(dataset.iterate_episodes()):
            wanted = plain.trajectory(k)
            for name in ("observations", "actions", "rewards", "terminations", "truncations"):
                np.testing.assert_array_equal(getattr(episode, name), getattr(wanted, name))
                assert getattr(episode, name).dtype == getattr(wanted, name).dtype
            assert metadata[k]["outcome"] == wanted.outcome
            assert metadata[k]["captured"] == wanted.captured
            observation, info = env.reset(seed=metadata[k]["seed"], options=metadata[k]["options"])
            assert info["index"] == wanted.index
            for step, action in enumerate(episode.actions):
                np.testing.assert_array_equal(observation, episode.observations[step])
                observation, *_, info = env.step(action)
            assert info["outcome"] == wanted.outcome


# Cards ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("env_id", CHEAP)
def test_card_says_what_made_it(made, env_id):
    place = folder(made, env_id, CHEAP[env_id])
    card = json.loads((place / "dataset.json").read_text())
    env = CaptureEnv(env_id=env_id)
    assert card["files"] == {"episodes.npz": sha256((place / "episodes.npz").read_bytes()).hexdigest()}
    size = env.task.split_size("train")
    assert card["goal_indices"] == np.random.default_rng(0).permutation(size)[:2].tolist()
    columns = [at for field in card["observation"] for at in range(field["start"], field["stop"])]
    assert columns == list(range(env.observation_space.shape[0]))
    assert card["action"]["control_mode"] == "joint_velocity"
    assert card["action"]["scale"] == env.task.robot.rate_limit.tolist()
    data = Dataset.load(place / "episodes.npz")
    told = card["episodes"]
    assert (told["asked"], told["written"], told["steps"]) == (2, 2, len(data.rewards))
    assert sum(told["outcomes"].values()) == 2
    assert told["captured"] == told["outcomes"].get("captured", 0)
    assert card["provenance"]["versions"]["numpy"] == np.__version__
    assert card["configuration"]["reward"] == "dense"
    text = (place / "README.md").read_text()
    assert card["provenance"]["command"] in text
    assert all(field["name"] in text for field in card["observation"])
    assert str(made) not in text + json.dumps(card)


def test_the_card_command_makes_the_same_dataset(made, tmp_path):
    card = json.loads((folder(made) / "dataset.json").read_text())
    words = card["provenance"]["command"].split()
    assert words[:2] == ["evaluate.py", "dataset"]
    assert run(tmp_path, *words[2:]) == 0
    assert contents(folder(tmp_path)) == contents(folder(made))


def test_cells_hold_any_text():
    assert plain("a | b `c`\n<img>") == "a / b 'c' &lt;img>"


def test_card_comes_last(made, tmp_path):
    """Its JSON is what makes a folder complete."""
    (tmp_path / "README.md").mkdir()  # so that it cannot be written
    with pytest.raises(OSError, match="README"):
        write_card(tmp_path, read_card(folder(made)) or {})
    assert not (tmp_path / "dataset.json").exists()
