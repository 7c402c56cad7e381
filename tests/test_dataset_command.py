"""`evaluate.py dataset`: what it leaves out, skips and refuses; the number of processes changes nothing."""

import json

import numpy as np
import pytest
from dataset_folders import CHEAP, CLUTTERED, contents, folder, run
from offenders import assert_refused

from agents.commands.choice import choose_policies, experts_for
from agents.commands.dataset import main
from agents.commands.recording import making, request
from agents.policies.registry import policies_for
from space_envs.envs import CaptureEnv
from space_envs.evaluation.datasets import minari as datasets_minari
from space_envs.evaluation.datasets import recording as datasets_recording
from space_envs.evaluation.datasets.card import read_card
from space_envs.evaluation.datasets.storage import Dataset
from space_envs.registration import ENTRIES


def test_episodes_that_do_not_come_out_again_are_omitted(tmp_path, monkeypatch, capsys):
    played = datasets_recording.roll_out

    def tampered(*arguments, **keywords):
        rollout = played(*arguments, **keywords)
        rollout.action[1, 5] *= 0.5
        return rollout

    monkeypatch.setattr(datasets_recording, "roll_out", tampered)
    assert run(tmp_path, "--policy", "gjm", "--episodes", "3") == 0
    said = capsys.readouterr().out
    assert "episode 1 (goal 865): the replay from its actions differs: observations differ from row 6" in said
    card = read_card(folder(tmp_path))
    assert card is not None
    assert [one["episode"] for one in card["episodes"]["omitted"]] == [1]
    assert Dataset.load(folder(tmp_path) / "episodes.npz").episode.tolist() == [0, 2]
    assert "| 1 | 865 | the replay from its actions differs" in (folder(tmp_path) / "README.md").read_text()


def test_a_policy_that_raises_loses_its_own_episodes_only(tmp_path, capsys):
    assert (
        run(tmp_path, "--policy", "harness_policies:Raises", "harness_policies:NaNs", "--episodes", "6") == 0
    )
    said = capsys.readouterr().out
    for path in sorted(tmp_path.rglob("dataset.json")):
        card = json.loads(path.read_text())
        lost = {one["index"] for one in card["episodes"]["omitted"]}
        kept = set(card["goal_indices"])
        assert lost and kept and len(lost) + len(kept) == 6
        # Both dislike goals on one side.
        start = CaptureEnv(difficulty="medium", split="train")
        for index in lost | kept:
            observation, _ = start.reset(options={"index": index})
            assert (start.task.layout.read(observation, "goal_position")[0] > 0.0) == (index in lost)
    assert "it raised ValueError: a goal that I do not like (step 3)" in said
    assert "the action held NaN or infinity at step 3" in said


def test_another_control_mode_and_variant_are_another_dataset(tmp_path):
    words = ("--policy", "random", "--episodes", "2", "--difficulty", "easy")
    assert run(tmp_path, *words) == 0
    assert run(tmp_path, *words, "--control-mode", "joint_torque", "--variant", "physical") == 0
    usual, other = sorted(path.parent for path in tmp_path.rglob("dataset.json"))
    assert other.name == "random-joint_torque-physical-easy-train-v0"
    cards = [read_card(path) for path in (usual, other)]
    assert [card["action"]["control_mode"] for card in cards if card] == ["joint_velocity", "joint_torque"]
    datasets = [Dataset.load(path / "episodes.npz") for path in (usual, other)]
    env = CaptureEnv(control_mode="joint_torque", variant="physical", difficulty="easy", split="train")
    seen, _ = env.reset(seed=int(datasets[1].seed[0]), options={"index": int(datasets[1].index[0])})
    np.testing.assert_array_equal(datasets[1].observations[0], seen)
    seen, *_ = env.step(datasets[1].actions[0])
    np.testing.assert_array_equal(datasets[1].observations[1], seen)
    assert not np.array_equal(datasets[0].observations[1], seen)


def test_nothing_left_is_said(tmp_path, capsys):
    assert run(tmp_path, "--policy", "hold", "--episodes", "2", "--captured-only") == 1
    assert "nothing to write" in capsys.readouterr().out
    assert not list(tmp_path.rglob("*.npz"))


def test_minari_has_a_root_of_its_own(tmp_path, monkeypatch):
    pytest.importorskip("minari")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    monkeypatch.delenv("MINARI_DATASETS_PATH", raising=False)
    words = [*"--policy hold --episodes 1 --format minari --minari-root".split(), str(tmp_path / "m")]
    assert run(tmp_path / "out", *words) == 0
    assert (folder(tmp_path / "m", policy="hold") / "data" / "main_data.hdf5").is_file()
    assert [path.name for path in sorted(folder(tmp_path / "out", policy="hold").iterdir())] == [
        ".space-capture",
        "README.md",
        "dataset.json",
    ]
    assert not (tmp_path / "home").exists()
    (folder(tmp_path / "out", policy="hold") / "dataset.json").unlink()
    assert run(tmp_path / "out", *words) == 2  # what is not ours stays


def test_without_minari_nothing_begins(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(datasets_minari, "find_spec", lambda name: None)
    assert run(tmp_path / "out", "--policy", "gjm", "--format", "npz", "minari") == 2
    assert "pip install 'space-capture[minari]'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_jobs_leave_the_bytes_alone(tmp_path, monkeypatch):
    monkeypatch.setattr(request, "CHUNK", 2)
    words = ["--policy", "gjm", "random", "--episodes", "5"]
    assert run(tmp_path / "one", *words) == 0
    assert run(tmp_path / "two", *words, jobs="2") == 0
    assert len(contents(tmp_path / "one")) == 8
    assert contents(tmp_path / "one") == contents(tmp_path / "two")


def test_what_is_complete_is_skipped_and_the_rest_made_anew(tmp_path, monkeypatch, capsys):
    words = ["--policy", "gjm", "hold", "--episodes", "2"]
    assert run(tmp_path, *words) == 0
    before = contents(tmp_path)
    # Killed between the arrays and the card.
    (folder(tmp_path, policy="hold") / "dataset.json").unlink()
    (folder(tmp_path, policy="hold") / "episodes.npz").write_bytes(b"half")
    played = []
    real = making.record
    monkeypatch.setattr(making, "record", lambda chunk: (played.append(chunk.policy.name), real(chunk))[1])
    capsys.readouterr()
    assert run(tmp_path, *words) == 0
    assert played == ["hold"]
    assert contents(tmp_path) == before
    assert "was complete" in capsys.readouterr().out


def test_another_dataset_in_its_place_is_refused(tmp_path, capsys):
    words = ["--policy", "hold", "--episodes"]
    assert run(tmp_path, *words, "1") == 0
    assert run(tmp_path, *words, "2") == 2
    assert "episodes was 1, is 2" in capsys.readouterr().err
    path = folder(tmp_path, policy="hold") / "episodes.npz"
    path.write_bytes(path.read_bytes() + b" ")
    assert run(tmp_path, *words, "1") == 2
    assert "episodes.npz is not the file that was written" in capsys.readouterr().err


def test_captured_only(tmp_path):
    words = ["--env", CLUTTERED, "--policy", "gjm", "--episodes", "4"]
    assert run(tmp_path / "all", *words) == 0
    assert run(tmp_path / "captured", *words, "--captured-only") == 0
    every = Dataset.load(folder(tmp_path / "all", CLUTTERED) / "episodes.npz")
    some = Dataset.load(folder(tmp_path / "captured", CLUTTERED) / "episodes.npz")
    assert 0 < every.captured.sum() < 4
    assert some.captured.all()
    assert some.index.tolist() == every.index[every.captured].tolist()
    card = read_card(folder(tmp_path / "captured", CLUTTERED))
    assert card is not None
    assert card["episodes"]["not_captured"] == 4 - len(some)


def test_experts_are_all_that_plan():
    beginners = {"random", "hold", "bc", "ppo", "bc_reactionless"}
    beginners |= {f"{kind}_network{end}" for kind in ("planner", "reactionless") for end in ("", "_alone")}
    for env_id in ENTRIES:
        experts = experts_for(env_id)
        assert CHEAP[env_id] in experts
        assert set(policies_for(env_id)) - set(experts) <= beginners
        assert not set(experts) & beginners
        assert [policy.name for policy in choose_policies(["experts"], env_id, list(ENTRIES))] == experts


def test_mistakes_are_named_before_anything_is_played(tmp_path, capsys) -> None:
    cases = [
        (["--split", "test"], "never those of split 'test'"),
        (["--split", "ood"], "never those of split 'ood'"),
        (["--split", "trian"], "Did you mean 'train'"),
        (["--policy", "gmj"], "Did you mean 'gjm'"),
        (["--policy", "reactionless"], "does not fit SpaceCapture/SingleArm-v0: it needs 2 arms"),
        (["--policy", "gjm", "gjm"], "policy given twice: gjm"),
        (["--env", "SpaceCapture/SingleArm"], "Did you mean 'SpaceCapture/SingleArm-v0'"),
        (["--format", "npy"], "Did you mean 'npz'"),
        (["--policy", "gjm", "--episodes", "0"], "episodes must lie in 1"),
        (["--policy", "gjm", "--jobs", "0"], "jobs must be at least 1"),
        (["--policy", "gjm", "--seed", "-1"], "seed must be"),
        (["--policy", "gjm", "--minari-root", "m"], "goes with --format minari"),
    ]
    assert_refused(lambda words: main([*words, "--output", str(tmp_path / "out")]), cases, capsys)
    assert not (tmp_path / "out").exists()
