"""Training runs: tables, cloning, reinforcement, checkpoints, resuming, policy files, the command line."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th

from agents.commands import ship as ship_command
from agents.commands.train import main
from agents.learning.hyperparameters import (
    ALGORITHMS,
    BC,
    PPO,
    SAC,
    TABLES,
    TD3,
    AnyHyperparameters,
    from_json,
    to_json,
)
from agents.learning.options import Options, rounding
from agents.learning.recorder import Recorder
from agents.learning.reinforcement import Reinforcement
from agents.learning.runs import Budget, RunFolder, Settings
from agents.learning.training import learn
from agents.learning.trees import load_tree, save_tree
from agents.learning.validation import Validator
from agents.policies.learned.features import CLUTTERED_FEATURES
from agents.policies.learned.learned_policy import (
    LearnedPolicy,
    load_shipped,
    shipped_path,
    shipped_policies,
)
from agents.policies.learned.policy_file import load_policy_file
from agents.policies.registry import POLICIES, control_mode, make_policy, policies_for
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, PolicyError
from space_envs.policy import PolicyContext
from space_envs.registration import ENTRIES

ENV_ID = "SpaceCapture/SingleArm-v0"
ROOT = Path(__file__).parents[1]
TABLE = TABLES[ENV_ID]


def small(algorithm: str, **changes: Any) -> AnyHyperparameters:
    """A table that runs in a second or two."""
    sizes: dict[str, dict[str, Any]] = {
        "ppo": {
            "num_envs": 8,
            "steps": 512,
            "interval": 256,
            "n_steps": 16,
            "batch_size": 64,
            "critic_warm_up": 128,
        },
        "sac": {"num_envs": 4, "steps": 400, "interval": 200, "learning_starts": 100, "batch_size": 64},
        "td3": {"num_envs": 4, "steps": 400, "interval": 200, "learning_starts": 100, "batch_size": 64},
        "bc": {
            "num_envs": 16,
            "steps": 4 * 320,
            "interval": 2 * 320,
            "episode": 20,
            "last_epochs": 4,
            "batch_size": 64,
        },
    }
    return replace(TABLE[algorithm], hidden=(16, 16), **(sizes[algorithm] | changes))


def begin(path: Path, algorithm: str, **changes: Any) -> RunFolder:
    settings = {name: changes.pop(name) for name in ("seed", "init", "difficulty") if name in changes}
    folder = RunFolder(path)
    folder.begin(Settings(algorithm, ENV_ID, **settings), small(algorithm, **changes))
    return folder


def run(folder: RunFolder) -> dict[str, Any]:
    return learn(folder, episodes=4, quiet=True)


def run_until_first_record(folder: RunFolder, monkeypatch: pytest.MonkeyPatch, after: int = 1) -> None:
    """Run as far as the first checkpoint after `after` steps, then as if Ctrl-C had been pressed."""
    record: Any = Recorder.record

    def interrupted(recorder: Recorder, steps: int, *arguments: Any) -> None:
        record(recorder, steps, *arguments)
        if steps >= after:
            raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(Recorder, "record", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run(folder)


@pytest.fixture(scope="module")
def cloned(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder = begin(tmp_path_factory.mktemp("runs") / "bc", "bc", difficulty="easy")
    run(folder)
    return folder


# Hyperparameters --------------------------------------------------------------------------------------


@pytest.mark.parametrize("env_id", TABLES)
@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_every_table_builds_its_model_and_survives_json(env_id: str, algorithm: str) -> None:
    parameters = TABLES[env_id][algorithm]
    again = from_json(algorithm, json.loads(json.dumps(to_json(parameters))))
    assert again == parameters and isinstance(
        again, {"ppo": PPO, "sac": SAC, "td3": TD3, "bc": BC}[algorithm]
    )
    if not isinstance(parameters, BC):
        learner = Reinforcement(Settings(algorithm, env_id), parameters, Budget())
        assert learner.network.inputs == learner.view.size
        assert [len(bias) for bias in learner.network.biases[:-1]] == list(parameters.hidden)
        if isinstance(parameters, PPO):
            assert parameters.num_envs * parameters.n_steps % parameters.batch_size == 0


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"num_envs": 0}, "num_envs"),
        ({"steps": -1}, "steps"),
        ({"batch_size": 1.5}, "batch_size"),
        ({"learning_rate": float("nan")}, "learning_rate"),
        ({"gamma": 1.1}, "gamma"),
        ({"minutes": 0.0}, "minutes"),
        ({"hidden": ()}, "hidden"),
        ({"activation": "tan"}, "tanh"),
    ],
)
def test_bad_hyperparameters(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        replace(TABLE["ppo"], **change)


def test_json_with_foreign_names() -> None:
    values = to_json(TABLE["ppo"])
    with pytest.raises(ConfigurationError, match="gama"):
        from_json("ppo", values | {"gama": 0.9})
    with pytest.raises(ConfigurationError, match="feature"):
        from_json("ppo", values | {"features": [["joint_position"]]})
    with pytest.raises(ConfigurationError, match="do not fit"):
        from_json("ppo", {name: value for name, value in values.items() if name != "steps"})


# Cloning and policy files -----------------------------------------------------------------------------


def test_cloning_learns_and_its_policy_is_kept_to_the_bit(cloned: RunFolder) -> None:
    losses = _scalars(cloned, "train/loss")
    assert losses[-1] < 0.7 * losses[0]
    checkpoint = cloned.checkpoint()
    assert checkpoint is not None and checkpoint["steps"] == 4 * 320
    assert not (cloned.path / "demonstrations").exists()
    file = load_policy_file(cloned.policy)
    copy = cloned.path / "copy.npz"
    file.save(copy)
    env = CaptureVectorEnv(num_envs=40)
    context = PolicyContext.from_env(env)
    observation, _ = env.reset(seed=0)
    policies = [LearnedPolicy.from_path(path, context, seed=1) for path in (cloned.path, cloned.policy, copy)]
    actions = [policy.predict(observation)[0] for policy in policies]
    assert actions[0].shape == (40, 7) and (np.abs(actions[0]) <= 1.0).all()
    np.testing.assert_array_equal(actions[0], actions[1])
    np.testing.assert_array_equal(actions[0], actions[2])
    # An action depends neither on how many rows there are nor on which one it is.
    for rows in ([7], [39, 3, 12]):
        np.testing.assert_array_equal(policies[0].predict(observation[rows])[0], actions[0][rows])
    noisy = [policy.predict(observation, deterministic=False)[0] for policy in policies]
    np.testing.assert_array_equal(noisy[0], noisy[1])
    assert 0.02 < np.abs(noisy[0] - actions[0]).mean() < 0.2


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3"])
def test_exported_network_agrees_with_stable_baselines(algorithm: str) -> None:
    parameters = small(algorithm)
    assert not isinstance(parameters, BC)
    learner = Reinforcement(Settings(algorithm, ENV_ID), parameters, Budget())
    features = np.random.default_rng(0).standard_normal((20, learner.view.size)).astype(np.float32)
    expected, _ = learner.model.predict(features, deterministic=True)
    np.testing.assert_allclose(learner.network.actions(features), expected, atol=2e-6)


def test_interrupted_cloning_ends_with_the_same_bits(
    cloned: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = begin(tmp_path / "run", "bc", difficulty="easy")
    run_until_first_record(folder, monkeypatch)
    checkpoint = folder.checkpoint()
    assert checkpoint is not None and checkpoint["steps"] == 2 * 320
    run(folder)
    for name in ("steps", "captured", "episode_return"):
        assert [row[name] for row in folder.checkpoint()["history"]] == [  # pyright: ignore[reportOptionalSubscript]
            row[name]
            for row in cloned.checkpoint()["history"]  # pyright: ignore[reportOptionalSubscript]
        ]
    ours, theirs = load_policy_file(folder.policy), load_policy_file(cloned.policy)
    for a, b in zip(ours.network.weights, theirs.network.weights, strict=True):
        np.testing.assert_array_equal(a, b)


def test_policy_of_another_task_or_damaged_file(cloned: RunFolder, tmp_path: Path) -> None:
    torque = PolicyContext.from_env(CaptureVectorEnv(control_mode="joint_torque"))
    context = PolicyContext.from_env(CaptureVectorEnv())
    with pytest.raises(PolicyError, match="joint_torque"):
        LearnedPolicy.from_path(cloned.path, torque)
    with pytest.raises(PolicyError, match="holds no"):
        LearnedPolicy.from_path(tmp_path, context)
    with pytest.raises(PolicyError, match="no policy file"):
        LearnedPolicy.from_path(tmp_path / "none.npz", context)
    whole = cloned.policy.read_bytes()
    for name, content in (("cut", whole[: len(whole) // 2]), ("empty", b""), ("text", b"hello")):
        (tmp_path / name).write_bytes(content)
        with pytest.raises(PolicyError, match="not a policy file"):
            load_policy_file(tmp_path / name)


class Bomb:
    """What a hostile file would hold; it must never come to life."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os._exit, (42,)


def test_no_file_is_unpickled(tmp_path: Path) -> None:
    path = tmp_path / "policy.npz"
    np.savez(path, header=np.array([Bomb()], dtype=object))
    with pytest.raises(PolicyError):
        load_policy_file(path)
    np.savez(path, tree=np.array([Bomb()], dtype=object))
    with pytest.raises(ConfigurationError):
        load_tree(path)
    with pytest.raises(TypeError):
        save_tree(path, {"bomb": Bomb()})


def test_trees_come_back_as_they_were(tmp_path: Path) -> None:
    tree = {
        "a": {0: th.arange(3), 1: (1, 2.5, None)},
        "b": [True, "x", {"c": np.eye(2)}],
        "scalar": th.tensor(2.0),
    }
    save_tree(tmp_path / "tree.npz", tree)
    again = load_tree(tmp_path / "tree.npz")
    assert th.equal(again["a"][0], tree["a"][0]) and again["a"][1] == (1, 2.5, None)
    assert again["b"][:2] == [True, "x"] and np.array_equal(again["b"][2]["c"], np.eye(2))
    assert again["scalar"].shape == () and list(again) == list(tree)


# Reinforcement ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("algorithm", ["sac", "td3"])
def test_off_policy_runs_learn_and_resume_with_their_buffer(
    algorithm: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = begin(tmp_path / "run", algorithm)
    run_until_first_record(folder, monkeypatch)
    before = folder.checkpoint()
    assert before is not None and before["steps"] == 200
    state = before["model"]
    assert state["replay"]["pos"] == 50 and state["n_updates"] > 0
    assert run(folder)["steps"] == 400
    after = folder.checkpoint()
    assert after is not None and [row["steps"] for row in after["history"]] == [200, 400]
    assert after["model"]["replay"]["pos"] == 100
    np.testing.assert_array_equal(
        after["model"]["replay"]["observations"][:50], state["replay"]["observations"]
    )
    assert after["model"]["n_updates"] > state["n_updates"]


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3"])
def test_interrupted_reinforcement_ends_with_the_same_bits(
    algorithm: str, cloned: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    changes: dict[str, Any] = {"steps": 480, "interval": 160, "batch_size": 32}
    if algorithm == "ppo":
        changes |= {"init": str(cloned.path), "n_steps": 10, "critic_warm_up": 160}
    whole, cut = (begin(tmp_path / name, algorithm, **changes) for name in ("whole", "cut"))
    run(whole)
    run_until_first_record(cut, monkeypatch, after=160)
    interrupted = cut.checkpoint()
    assert interrupted is not None and 160 <= interrupted["steps"] < 480
    # What another process has drawn in the meantime makes no difference.
    np.random.seed(7)
    th.manual_seed(7)
    run(cut)
    ours, theirs = cut.checkpoint(), whole.checkpoint()
    assert ours is not None and theirs is not None
    for entry in (*ours["history"], *theirs["history"]):
        del entry["wall_s"]
    assert ours["history"] == theirs["history"] and ours["steps"] == theirs["steps"] == 480
    for key in ("random", "model", "seen", "episodes"):
        assert same(ours[key], theirs[key]), key


def same(a: Any, b: Any) -> bool:
    """Whether two trees are equal to the bit."""
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, list | tuple):
        return len(a) == len(b) and all(map(same, a, b))
    return np.array_equal(a, b)


def test_a_run_that_only_warmed_up_does_not_pass_as_an_improvement(cloned: RunFolder, tmp_path: Path) -> None:
    """What ppo keeps was updated by ppo, however well the clone does that it started from."""
    changes = {"init": str(cloned.path), "interval": 128, "learning_rate": 1e-2, "steps": 512}
    folder = begin(tmp_path / "run", "ppo", critic_warm_up=256, **changes)
    summary = run(folder)
    history = folder.checkpoint()["history"]  # pyright: ignore[reportOptionalSubscript]
    assert [row["steps"] for row in history] == [0, 128, 256, 384, 512]
    unchanged = [row["episode_return"] for row in history[:3]]
    assert unchanged[0] == unchanged[1] == unchanged[2] == summary["start"]["episode_return"]
    assert summary["best_steps"] > 256
    start, kept = load_policy_file(cloned.policy).network, load_policy_file(folder.policy).network
    assert not np.array_equal(start.weights[0], kept.weights[0])
    better = summary["validation"]["episode_return"] > summary["start"]["episode_return"]
    assert summary["improved"] is better
    never = begin(tmp_path / "never", "ppo", critic_warm_up=512, **changes)
    assert run(never)["improved"] is False
    with pytest.raises(ConfigurationError, match="not better than the one that it started from"):
        ship_command.ship(never, "ppo")


def test_ppo_starts_from_a_clone_and_the_critic_warms_up(cloned: RunFolder, tmp_path: Path) -> None:
    changes = {"steps": 256, "interval": 128, "critic_warm_up": 256, "init": str(cloned.path)}
    folder = begin(tmp_path / "warm", "ppo", **changes)
    run(folder)
    start, end = load_policy_file(cloned.policy).network, load_policy_file(folder.policy).network
    for a, b in zip(start.weights, end.weights, strict=True):
        np.testing.assert_array_equal(a, b)
    folder = begin(tmp_path / "free", "ppo", **(changes | {"critic_warm_up": 0, "interval": 256}))
    run(folder)
    assert not np.array_equal(start.weights[0], load_policy_file(folder.policy).network.weights[0])
    other = begin(tmp_path / "other", "ppo", init=str(cloned.path), activation="relu")
    with pytest.raises(PolicyError, match="activation"):
        run(other)


def test_ppo_killed_while_it_clones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(TABLE, "bc", small("bc"))
    folder = begin(tmp_path / "run", "ppo")
    run_until_first_record(folder, monkeypatch)
    clone = RunFolder(folder.path / "clone")
    halfway = clone.checkpoint()
    assert folder.checkpoint() is None and clone.summary() is None
    assert halfway is not None and halfway["steps"] == 2 * 320
    summary = run(folder)
    finished = clone.summary()
    assert finished is not None and finished["steps"] == 4 * 320 and summary["steps"] == 512
    assert summary["wall_s"] > finished["wall_s"] > halfway["times"]["wall"]
    assert clone.restore()[1].hidden == (16, 16)


def test_shipping_a_run(cloned: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ship_command, "TEST_EPISODES", 4)
    monkeypatch.setattr(ship_command, "shipped_path", lambda env_id, name: tmp_path / f"{name}.npz")
    cloned.note_command(["train.py", "--algo", "bc", "--output", str(cloned.path)])
    provenance = ship_command.ship(cloned, "bc")
    assert provenance["commands"][-1] == ["train.py", "--algo", "bc"]
    assert provenance["test"]["episodes"] == 4 and provenance["summary"] == cloned.summary()
    text = (tmp_path / "bc.json").read_text()
    assert json.loads(text) == json.loads(json.dumps(provenance)) and str(cloned.path) not in text
    assert load_policy_file(tmp_path / "bc.npz").notes == load_policy_file(cloned.policy).notes
    monkeypatch.setattr(ship_command, "load_shipped", lambda env_id, name: load_policy_file(cloned.policy))
    monkeypatch.setattr(ship_command, "TEST_EPISODES", 3)
    again = ship_command.evaluate_again(ENV_ID, "bc")
    assert again["test"]["episodes"] == 3 and {**again, "test": None} == {**json.loads(text), "test": None}
    assert json.loads((tmp_path / "bc.json").read_text()) == again
    with pytest.raises(ConfigurationError, match="identifier"):
        ship_command.ship(cloned, "../bc")
    with pytest.raises(ConfigurationError, match="not finished"):
        ship_command.ship(begin(tmp_path / "unfinished", "bc"), "bc")


def test_validation_counts_what_the_environment_says() -> None:
    validator = Validator(ENV_ID, 3)
    result = validator(lambda observation: np.zeros((3, 7)))
    assert (
        result.captured == 0.0
        and result.seconds == 20.0
        and result.attitude_cost == pytest.approx(0.0, abs=1e-9)
    )
    assert result == validator(lambda observation: np.zeros((3, 7)))


# The command line -------------------------------------------------------------------------------------


def test_a_killed_run_goes_on_from_its_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / "run"
    command = [sys.executable, str(ROOT / "train.py"), "--validation-episodes", "2", "--quiet"]
    begun = ["--init", "none", "--num-envs", "8", "--seed", "5", "--steps", "40960", "--output", str(path)]
    process = subprocess.Popen([*command, *begun], cwd=ROOT)
    try:
        deadline = time.monotonic() + 60
        while not (path / "checkpoint.npz").exists():
            assert process.poll() is None and time.monotonic() < deadline
            time.sleep(0.02)
    finally:
        process.send_signal(signal.SIGKILL)
        process.wait()
    folder = RunFolder(path)
    killed, config = folder.checkpoint(), folder.config()
    assert killed is not None and folder.summary() is None
    steps = killed["steps"] + 1024
    subprocess.run([*command, "--resume", str(path), "--steps", str(steps)], cwd=ROOT, check=True, timeout=60)
    ended, after = folder.checkpoint(), folder.config()
    assert ended is not None and ended["steps"] == steps
    assert ended["history"][: len(killed["history"])] == killed["history"]
    assert ended["times"]["wall"] > killed["times"]["wall"]
    summary = folder.summary()
    assert summary is not None and summary["steps"] == steps
    assert after["settings"] == config["settings"] and after["settings"]["seed"] == 5
    assert len(after["commands"]) == 2 and after["versions"] == config["versions"]
    changed = {
        name for name, value in after["hyperparameters"].items() if value != config["hyperparameters"][name]
    }
    assert changed <= {"steps", "interval"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--algo", "pp"], "Did you mean 'ppo'"),
        (["--env", "SpaceCapture/SingleArm-v1"], "SingleArm-v0"),
        (["--difficulty", "meduim"], "medium"),
        (["--control-mode", "torque"], "joint_torque"),
        (["--control-mode", "joint_torque"], "--init none"),
        (["--expert", "gmj"], "gjm"),
        (["--algo", "sac", "--expert", "gjm"], "--expert is for"),
        (["--algo", "bc", "--init", "none"], "--init is for ppo"),
        (["--init", "none", "--expert", "gjm"], "either"),
        (["--init", "nowhere"], "no policy file nowhere"),
        (["--steps", "0"], "steps must be"),
        (["--minutes", "nan"], "minutes must be"),
        (["--num-envs", "-1"], "num_envs must be"),
        (["--seed", "-1"], "seed must lie"),
        (["--device", "abacus"], "abacus"),
        (["--device", "meta"], "meta"),
        (["--num-envs", str(10**9)], "num_envs must be a positive integer of at most 65536"),
        (["--steps", str(10**30)], "steps must be a positive integer of at most"),
        (["--seed", str(10**30)], "seed must lie"),
        (["--validation-episodes", "0"], "validation-episodes"),
        (["--resume", "nowhere"], "there is no run's folder 'nowhere'."),
        (["--resume", "."], ". holds no run: there is no config.json"),
        (["--resume", "nowhere", "--algo", "ppo"], "leave out --algo"),
    ],
)
def test_bad_input_is_one_line_and_nothing_is_begun(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 2
    error = capsys.readouterr().err
    assert message in error and error.startswith("train.py: ") and error.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_run_that_is_not_there_is_answered_with_the_nearest_that_is(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    begin(tmp_path / "ppo-easy", "ppo")
    (tmp_path / "ppo-eass").mkdir()  # nearer, and no run
    assert main(["--resume", str(tmp_path / "ppo-esy")]) == 2
    error = capsys.readouterr().err
    assert error.endswith(
        f"there is no run's folder '{tmp_path}/ppo-esy'. Did you mean '{tmp_path}/ppo-easy'?\n"
    )


@pytest.mark.parametrize(
    ("algorithm", "steps", "taken", "whole"),
    [
        ("bc", 8_000, 15_360, 15_360),
        ("bc", 20_000, 30_720, 15_360),
        ("bc", 15_360, 15_360, 15_360),
        ("ppo", 10_000, 16_384, 8_192),
        ("sac", 1_001, 1_008, 16),
    ],
)
def test_steps_are_whole_rounds_and_the_user_is_told(
    algorithm: str, steps: int, taken: int, whole: int
) -> None:
    settings, parameters = Options(algo=algorithm, steps=steps).settle()
    assert settings.algorithm == algorithm and parameters.steps == taken and parameters.round == whole
    message = rounding(parameters, steps)
    assert message is None if taken == steps else f"{taken:,} steps, not {steps:,}" in str(message)


def test_a_run_takes_the_steps_that_it_announced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(TABLE, "bc", small("bc"))
    folder = tmp_path / "run"
    options = ["--algo", "bc", "--steps", "400", "--validation-episodes", "2", "--output", str(folder)]
    assert main(options) == 0
    assert "640 steps, not 400: whole rounds of 320" in capsys.readouterr().out
    summary = RunFolder(folder).summary()
    assert summary is not None and summary["steps"] == 640


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_every_id_has_a_table_for_every_algorithm(algorithm: str) -> None:
    assert set(TABLES) == set(ENTRIES)
    for env_id in ENTRIES:
        settings, parameters = Options(algo=algorithm, env=env_id).settle()
        assert settings.env_id == env_id and parameters == TABLES[env_id][algorithm]


def test_training_around_obstacles(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    env_id = "SpaceCapture/SingleArmCluttered-v0"
    monkeypatch.setitem(TABLES[env_id], "bc", replace(small("bc"), features=CLUTTERED_FEATURES))
    folder = tmp_path / "run"
    arguments = ["--algo", "bc", "--env", env_id, "--validation-episodes", "2", "--quiet"]
    assert main([*arguments, "--output", str(folder)]) == 0
    env = CaptureVectorEnv(env_id, 2)
    policy = LearnedPolicy.from_path(folder, PolicyContext.from_env(env))
    observation, _ = env.reset(seed=0)
    moved = observation.copy()
    moved[:, env.task.layout.slices["obstacle_position"]] += 0.1
    assert not np.array_equal(policy.predict(observation)[0], policy.predict(moved)[0])


def test_a_folder_is_not_overwritten(cloned: RunFolder, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--output", str(cloned.path)]) == 2
    assert "--resume" in capsys.readouterr().err


def test_bad_syntax_and_help(capsys: pytest.CaptureFixture[str]) -> None:
    for arguments, status in ((["--steps", "many"], 2), (["--help"], 0)):
        with pytest.raises(SystemExit) as exit_:
            main(arguments)
        assert exit_.value.code == status
    assert "--resume RUN" in capsys.readouterr().out


# Policies that ship -----------------------------------------------------------------------------------


SHIPPED = [(env_id, name) for env_id in ENTRIES for name in shipped_policies(env_id)]


@pytest.mark.parametrize(("env_id", "name"), SHIPPED)
def test_shipped_policies_capture_as_their_provenance_says_and_seldom_collide(env_id: str, name: str) -> None:
    said = json.loads(shipped_path(env_id, name).with_suffix(".json").read_text())["test"]["captured"]
    n, mode = 64, control_mode(name)
    env = CaptureVectorEnv(env_id, n, autoreset_mode="disabled", control_mode=mode)
    policy = make_policy(name, PolicyContext.from_env(env), 0)
    observation, _ = env.reset(seed=0, options={"split": "test", "index": np.arange(n)})
    outcome = np.full(n, "running", dtype=object)
    while (outcome == "running").any():
        observation, _, _, _, info = env.step(policy.predict(observation)[0])
        outcome = info["outcome"]
    captured = (outcome == "captured").mean()
    # Three standard deviations of a share among 64 of the goals that the provenance was counted on.
    assert abs(captured - said) <= 3.0 * np.sqrt(said * (1.0 - said) / n) + 1.0 / n
    assert said >= 0.95 and (outcome == "collision").mean() <= 0.05


def test_an_unknown_shipped_policy() -> None:
    with pytest.raises(ConfigurationError, match="shipped policy"):
        load_shipped(ENV_ID, "dqn")


@pytest.mark.parametrize("env_id", ENTRIES)
def test_policies_that_are_offered_are_those_that_ship(env_id: str) -> None:
    offered = {
        name for name in policies_for(env_id) if POLICIES[name].policy.startswith("agents.policies.learned")
    }
    assert offered == set(shipped_policies(env_id))


IMPROVED = [(env_id, name) for env_id in ENTRIES for name in shipped_policies(env_id) if name[:2] != "bc"]


@pytest.mark.parametrize(("env_id", "name"), IMPROVED)
def test_what_ships_beside_a_clone_is_better_than_the_clone(env_id: str, name: str) -> None:
    mode = control_mode(name)
    clone = name.replace(name.split("_")[0], "bc")
    validator = Validator(env_id, 96, control_mode=mode)
    files = [load_shipped(env_id, each) for each in (name, clone)]
    weights = [file.network.weights for file in files]
    assert any(not np.array_equal(a, b) for a, b in zip(*weights, strict=False))
    layout = validator.env.task.layout
    scores = []
    for file in files:
        view = file.view(layout)
        scores.append(validator(lambda seen, file=file, view=view: file.network.actions(view(seen))).score)
    assert scores[0] > scores[1]


@pytest.mark.parametrize("name", ["bc", "ppo"])
def test_shipped_policies_come_from_the_documented_command(name: str) -> None:
    provenance = json.loads(shipped_path(ENV_ID, name).with_suffix(".json").read_text())
    assert provenance["commands"] == [["train.py"] if name == "ppo" else ["train.py", "--algo", "bc"]]
    assert from_json(name, provenance["hyperparameters"]) == TABLE[name]
    assert load_shipped(ENV_ID, name).notes["validation"] == provenance["summary"]["validation"]
    assert provenance["test"]["captured"] >= 0.97 and provenance["summary"]["wall_s"] < 600


def _scalars(folder: RunFolder, name: str) -> list[float]:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(folder.tensorboard))
    events.Reload()
    return [event.value for event in events.Scalars(name)]
