"""Training runs: cloning, reinforcement, checkpoints, resuming, policy files, shipping."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th
from stable_baselines3.common.callbacks import CallbackList
from stable_baselines3.common.logger import configure
from training_runs import ENV_ID, begin, defaults, history, installed_algorithms, interrupt, run, same, small

from agents.commands.training import ship
from agents.learning import training
from agents.learning.reinforcement import Reinforcement
from agents.learning.runs.folder import RunFolder
from agents.learning.runs.hyperparameters import BC, CONTRIB, PPO, Planner
from agents.learning.runs.nested_npz import load_nested, save_nested
from agents.learning.runs.session import Session
from agents.learning.runs.settings import Settings
from agents.learning.sb3 import initial
from agents.learning.validation import Validator
from agents.policies.baselines import Hold
from agents.policies.learned.policy_file import load_policy_file
from agents.policies.learned.trained import load_trained
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, PolicyError
from space_envs.policy import PolicyContext
from space_envs.registration import ENTRIES


@pytest.fixture(scope="module")
def cloned(tmp_path_factory: pytest.TempPathFactory) -> RunFolder:
    folder = begin(tmp_path_factory.mktemp("runs") / "bc", "bc", difficulty="easy")
    run(folder)
    return folder


def weights(folder: RunFolder) -> tuple[np.ndarray, ...]:
    return load_policy_file(folder.policy).network.weights


# Models and validation --------------------------------------------------------------------------------


def test_every_id_has_a_model_of_every_algorithm() -> None:
    for env_id in ENTRIES:
        for algorithm in installed_algorithms():
            parameters = defaults(algorithm, env_id)
            if isinstance(parameters, BC | Planner):
                continue
            learner = Reinforcement(Session(RunFolder(Path()), Settings(algorithm, env_id), parameters))
            assert learner.network.inputs == learner.view.size
            assert [len(bias) for bias in learner.network.biases[:-1]] == list(parameters.hidden)
            if isinstance(parameters, PPO):
                assert parameters.round % parameters.batch_size == 0


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "td3", *CONTRIB])
def test_exported_network_agrees_with_stable_baselines(algorithm: str) -> None:
    learner = Reinforcement(Session(RunFolder(Path()), Settings(algorithm, ENV_ID), small(algorithm)))
    features = np.random.default_rng(0).standard_normal((20, learner.view.size)).astype(np.float32)
    expected, _ = learner.model.predict(features, deterministic=True)
    np.testing.assert_allclose(learner.network.actions(features), expected, atol=2e-6)


def test_validation_counts_what_the_environment_says() -> None:
    validator = Validator(ENV_ID, 3)
    result = validator(Hold(validator.context))
    assert (result.captured, result.seconds, result.episodes) == (0.0, 20.0, 3)
    assert result.attitude_cost == pytest.approx(0.0, abs=1e-9)
    assert result == validator(Hold(validator.context))
    assert Validator(ENV_ID, 3, horizon=50)(Hold(validator.context)).seconds == 5.0
    with pytest.raises(ConfigurationError, match=r"must lie in 1\.\.256"):
        Validator(ENV_ID, 300)


# Cloning and policy files -----------------------------------------------------------------------------


def test_cloning_learns_and_its_policy_is_kept_to_the_bit(cloned: RunFolder) -> None:
    losses = _scalars(cloned, "train/loss")
    assert losses[-1] < 0.7 * losses[0]
    assert (cloned.checkpoint() or {})["steps"] == 4 * 320
    assert not (cloned.path / "demonstrations").exists()
    copy = cloned.path / "copy.npz"
    load_policy_file(cloned.policy).save(copy)
    env = CaptureVectorEnv(num_envs=40)
    context = PolicyContext.from_env(env)
    observation, _ = env.reset(seed=0)
    policies = [load_trained(path, context, seed=1) for path in (cloned.path, cloned.policy, copy)]
    actions = [policy.predict(observation)[0] for policy in policies]
    assert actions[0].shape == (40, 7) and (np.abs(actions[0]) <= 1.0).all()
    assert same(actions[0], actions[1]) and same(actions[0], actions[2])
    # An action depends neither on how many rows there are nor on which one it is.
    for rows in ([7], [39, 3, 12]):
        assert same(policies[0].predict(observation[rows])[0], actions[0][rows])
    noisy = [policy.predict(observation, deterministic=False)[0] for policy in policies]
    assert same(noisy[0], noisy[1])
    assert 0.02 < np.abs(noisy[0] - actions[0]).mean() < 0.2


def test_interrupted_cloning_ends_with_the_same_bits(
    cloned: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = begin(tmp_path / "run", "bc", difficulty="easy")
    assert interrupt(folder, monkeypatch)["steps"] == 2 * 320
    run(folder)
    assert history(folder) == history(cloned)
    assert same(weights(folder), weights(cloned))


def test_policy_of_another_task_or_damaged_file(cloned: RunFolder, tmp_path: Path) -> None:
    torque = PolicyContext.from_env(CaptureVectorEnv(control_mode="joint_torque"))
    context = PolicyContext.from_env(CaptureVectorEnv())
    for path, where, message in (
        (cloned.path, torque, "joint_torque"),
        (tmp_path, context, "holds no"),
        (tmp_path / "none.npz", context, "no policy file"),
    ):
        with pytest.raises(PolicyError, match=message):
            load_trained(path, where)
    whole = cloned.policy.read_bytes()
    for content in (whole[: len(whole) // 2], b"", b"hello"):
        (tmp_path / "damaged").write_bytes(content)
        with pytest.raises(PolicyError, match="not a policy file"):
            load_policy_file(tmp_path / "damaged")


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
        load_nested(path)
    with pytest.raises(TypeError):
        save_nested(path, {"bomb": Bomb()})


def test_nested_values_come_back_as_they_were(tmp_path: Path) -> None:
    tree = {
        "a": {0: th.arange(3), 1: (1, 2.5, None)},
        "b": [True, "x", {"c": np.eye(2)}],
        "scalar": th.tensor(2.0),
    }
    save_nested(tmp_path / "tree.npz", tree)
    again = load_nested(tmp_path / "tree.npz")
    assert th.equal(again["a"][0], tree["a"][0]) and again["a"][1] == (1, 2.5, None)
    assert again["b"][:2] == [True, "x"] and np.array_equal(again["b"][2]["c"], np.eye(2))
    assert again["scalar"].shape == () and list(again) == list(tree)


# Reinforcement ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("algorithm", "start"),
    [("ppo", True), ("sac", False), ("sac", True), ("td3", True), ("tqc", False), ("crossq", True)],
)
def test_interrupted_reinforcement_ends_with_the_same_bits(
    algorithm: str, start: bool, cloned: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    if algorithm in CONTRIB:
        pytest.importorskip("sb3_contrib")
    monkeypatch.setattr(initial, "IMITATION_STEPS", 20)
    changes: dict[str, Any] = {"steps": 480, "validation_interval": 160, "batch_size": 32}
    changes |= {"init": str(cloned.path), "critic_warm_up": 160} if start else {}
    changes |= {"n_steps": 10} if algorithm == "ppo" else {"demonstrations": 80} if start else {}
    whole, cut = (begin(tmp_path / name, algorithm, **changes) for name in ("whole", "cut"))
    run(whole)
    halfway = interrupt(cut, monkeypatch, after=160)
    assert 160 <= halfway["steps"] < 480
    # What another process has drawn in the meantime makes no difference.
    np.random.seed(7)
    th.manual_seed(7)
    run(cut)
    ours, theirs = (folder.checkpoint() or {} for folder in (cut, whole))
    assert history(cut) == history(whole) and ours["steps"] == theirs["steps"] == 480
    for key in ("random", "model", "seen", "episodes"):
        assert same(ours[key], theirs[key]), key
    if algorithm != "ppo":  # the replay buffer goes on from where it was
        before, after = halfway["model"], ours["model"]
        rows = before["replay"]["pos"]
        assert 0 < rows < after["replay"]["pos"] and 0 < before["n_updates"] < after["n_updates"]
        assert same(after["replay"]["observations"][:rows], before["replay"]["observations"])


@pytest.mark.parametrize("algorithm", ["sac", "td3"])
def test_an_off_policy_run_starts_as_the_policy_and_stays_near_it(
    algorithm: str, cloned: RunFolder, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also with another network, and a critic that knows nothing: the cloning term is for that."""
    monkeypatch.setattr(initial, "IMITATION_STEPS", 400)
    changes = {"hidden": (32, 32), "demonstrations": 400, "critic_warm_up": 0, "learning_rate": 1e-3}
    file, differences = load_policy_file(cloned.policy), {}
    for weight in (0.0, 1e3):
        parameters = small(algorithm, **changes, steps=800, cloning_weight=weight)
        learner = Reinforcement(Session(RunFolder(Path()), Settings(algorithm, ENV_ID), parameters))
        learner.start_from(file.network)
        seen = learner.model.replay_buffer.observations[:100].reshape(-1, learner.view.size)
        expected = file.network.actions(seen)
        differences["start"] = np.abs(learner.network.actions(seen) - expected).mean()
        assert learner.model.num_timesteps == 400 and not learner.learned
        callback = CallbackList([])
        learner.hold_actor()
        learner.model.set_logger(configure(None, []))
        learner.model.learn(400, callback, reset_num_timesteps=False)
        differences[weight] = np.abs(learner.network.actions(seen) - expected).mean()
    assert differences["start"] < 0.05 and differences[1e3] < 0.05 < differences[0.0], differences


def test_a_run_that_only_warmed_up_does_not_pass_as_an_improvement(cloned: RunFolder, tmp_path: Path) -> None:
    """The policy that ppo keeps was updated by ppo, however well the clone does that it started from."""
    changes = {"init": str(cloned.path), "expert": None, "validation_interval": 128, "learning_rate": 1e-2}
    folder = begin(tmp_path / "run", "ppo", critic_warm_up=256, **changes)
    summary = run(folder)
    assert [row["steps"] for row in history(folder)] == [0, 128, 256, 384, 512]
    returns = [row["episode_return"] for row in history(folder)]
    assert returns[0] == returns[1] == returns[2] == summary["start"]["episode_return"]
    assert summary["best_steps"] > 256
    assert not same(weights(cloned)[0], weights(folder)[0])
    best, start = (
        [summary[key][of] for of in ("score", "episode_return")] for key in ("validation", "start")
    )
    better = best > start
    assert summary["improved"] is better
    never = begin(tmp_path / "never", "ppo", critic_warm_up=512, **changes)
    assert run(never)["improved"] is False
    assert same(weights(cloned), weights(never))
    with pytest.raises(ConfigurationError, match="not better than the one that it started from"):
        ship.ship(never, "ppo")
    other = begin(tmp_path / "other", "ppo", **changes, activation="relu")
    with pytest.raises(PolicyError, match="activation"):
        run(other)


def test_ppo_killed_while_it_clones(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "clone_hyperparameters", lambda settings, parameters: small("bc"))
    folder = begin(tmp_path / "run", "ppo")
    interrupt(folder, monkeypatch)
    clone = RunFolder(folder.path / "clone")
    halfway = clone.checkpoint()
    assert folder.checkpoint() is None and clone.summary() is None
    assert halfway is not None and halfway["steps"] == 2 * 320
    summary, finished = run(folder), clone.summary()
    assert finished is not None and finished["steps"] == 4 * 320 and summary["steps"] == 512
    assert summary["wall_s"] > finished["wall_s"] > halfway["times"]["wall"]


def test_the_clone_has_the_network_of_ppo() -> None:
    ppo = small("ppo", hidden=(8,), expert="mpc", activation="relu")
    assert isinstance(ppo, PPO)
    clone = training.clone_hyperparameters(Settings("ppo", ENV_ID), ppo)
    assert isinstance(clone, BC)
    assert (clone.hidden, clone.expert, clone.activation) == ((8,), "mpc", "relu")
    assert clone.steps == defaults("bc").steps


def test_keywords_of_the_environment_hold_in_training_validation_and_the_policy(tmp_path: Path) -> None:
    keywords = {"horizon": 30, "reward": "sparse"}
    folder = begin(tmp_path / "run", "bc", env_kwargs=keywords, steps=320)
    summary = run(folder)
    assert summary["validation"]["seconds"] == 3.0
    assert folder.config()["settings"]["env_kwargs"] == keywords
    assert load_policy_file(folder.policy).notes["env_kwargs"] == keywords
    learner = Reinforcement(Session(folder, folder.restore()[0], small("sac")))
    assert learner.episodes.env.task.horizon == 30 and learner.episodes.env.task.reward == "sparse"


# Shipping ---------------------------------------------------------------------------------------------


def test_shipping_a_run(cloned: RunFolder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ship, "TEST_EPISODES", 4)
    monkeypatch.setattr(ship, "shipped_path", lambda env_id, name: tmp_path / f"{name}.npz")
    cloned.note_command(["train.py", "--algo", "bc", "--output", str(cloned.path)])
    provenance = ship.ship(cloned, "bc")
    assert provenance["commands"][-1] == ["train.py", "--algo", "bc"]
    assert provenance["test"]["episodes"] == 4 and provenance["summary"] == cloned.summary()
    text = (tmp_path / "bc.json").read_text()
    assert json.loads(text) == json.loads(json.dumps(provenance)) and str(cloned.path) not in text
    assert load_policy_file(tmp_path / "bc.npz").notes == load_policy_file(cloned.policy).notes
    monkeypatch.setattr(ship, "load_shipped", lambda env_id, name: load_policy_file(cloned.policy))
    monkeypatch.setattr(ship, "TEST_EPISODES", 3)
    again = ship.evaluate_again(ENV_ID, "bc")
    assert again["test"]["episodes"] == 3 and {**again, "test": None} == {**json.loads(text), "test": None}
    assert json.loads((tmp_path / "bc.json").read_text()) == again
    with pytest.raises(ConfigurationError, match="identifier"):
        ship.ship(cloned, "../bc")
    with pytest.raises(ConfigurationError, match="not finished"):
        ship.ship(begin(tmp_path / "unfinished", "bc"), "bc")


def _scalars(folder: RunFolder, name: str) -> list[float]:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(folder.tensorboard))
    events.Reload()
    return [event.value for event in events.Scalars(name)]
