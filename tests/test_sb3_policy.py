"""Zips of stable-baselines3 as policies: the same actions, no pickle opened, clear refusals."""

import base64
import io
import json
import os
import pickle
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import stable_baselines3 as sb3
import torch as th
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

import space_envs  # noqa: F401
from agents.policies.learned.sb3_policy import StableBaselinesPolicy
from agents.policies.learned.sb3_zip import load_network
from agents.policies.resolve import ResolvedPolicy, resolve_policy
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import PolicyError
from space_envs.evaluation.records.storage import read_records
from space_envs.policy import PolicyContext

ENV_ID = "SpaceCapture/SingleArm-v0"
ALGORITHMS: dict[str, dict[str, Any]] = {
    "PPO": {"n_steps": 8, "batch_size": 8},
    "A2C": {},
    "SAC": {"buffer_size": 8, "learning_starts": 2},
    "TD3": {"buffer_size": 8, "learning_starts": 2},
    "DDPG": {"buffer_size": 8, "learning_starts": 2},
}


class Bomb:
    """What a hostile file would hold: it leaves a file behind if it comes to life."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, (str(self.path),)


class OwnPolicy(ActorCriticPolicy):
    """A user's own policy class."""

    def __init__(self, *arguments: Any, **keywords: Any) -> None:
        super().__init__(*arguments, **keywords)


class Halved(BaseFeaturesExtractor):
    """Features without parameters, which leave no trace in the arrays."""

    def __init__(self, observation_space: gym.spaces.Box) -> None:
        super().__init__(observation_space, observation_space.shape[0])

    def forward(self, observations: th.Tensor) -> th.Tensor:
        return 0.5 * observations


def made(algorithm: str, policy: Any = "MlpPolicy", env: Any = None, **keywords: Any) -> BaseAlgorithm:
    """A model with large random weights, so that actions fill their range."""
    env = gym.make(ENV_ID) if env is None else env
    model = getattr(sb3, algorithm)(policy, env, seed=1, **(ALGORITHMS[algorithm] | keywords))
    generator = th.Generator().manual_seed(3)
    with th.no_grad():
        for parameter in model.policy.parameters():
            parameter.add_(0.1 * th.randn(parameter.shape, generator=generator))
    return model


def rewritten(source: Path, target: Path, **changes: Callable[[bytes], bytes]) -> Path:
    """A copy of a zip with some of its members changed; `policy_pth` stands for policy.pth."""
    with zipfile.ZipFile(source) as old, zipfile.ZipFile(target, "w") as new:
        for name in old.namelist():
            change = changes.get(name.replace(".", "_"), bytes)
            new.writestr(name, change(old.read(name)))
    return target


def edited(path: tuple[str, ...], value: Any) -> Callable[[bytes], bytes]:
    """A change of one entry of `data`."""

    def change(content: bytes) -> bytes:
        data = json.loads(content)
        at = data
        for key in path[:-1]:
            at = at[key]
        at[path[-1]] = value
        return json.dumps(data).encode()

    return change


@pytest.fixture(scope="module")
def context() -> PolicyContext:
    return PolicyContext.from_env(CaptureVectorEnv(ENV_ID))


@pytest.fixture(scope="module")
def ppo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("zips") / "ppo.zip"
    made("PPO").save(path)
    return path


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_actions_are_those_of_stable_baselines(
    algorithm: str, tmp_path: Path, context: PolicyContext
) -> None:
    model = made(algorithm)
    model.learn(16)
    model.save(tmp_path / "model.zip")
    observation = np.random.default_rng(0).uniform(-1.5, 1.5, (50, context.layout.size))
    expected, _ = model.predict(observation, deterministic=True)
    policy = resolve_policy(str(tmp_path / "model.zip"))
    assert (policy.name, policy.control_mode) == ("model", "joint_velocity")
    actions, state = policy.build(context, 0).predict(observation)
    assert state is None
    assert actions.std() > 0.1
    np.testing.assert_allclose(actions, expected, atol=1e-5)


@pytest.mark.parametrize(
    ("algorithm", "activation", "sizes"),
    [
        ("PPO", th.nn.ELU, {"pi": [16], "vf": [8, 8]}),
        ("PPO", th.nn.ReLU, []),
        ("SAC", th.nn.GELU, [16, 8]),
        ("A2C", th.nn.SiLU, [16]),
        ("TD3", th.nn.LeakyReLU, {"pi": [8], "qf": [16]}),
        ("DDPG", th.nn.Tanh, [8, 8, 8]),
    ],
)
def test_architectures_and_activations(
    algorithm: str, activation: type, sizes: Any, tmp_path: Path, context: PolicyContext
) -> None:
    model = made(algorithm, policy_kwargs={"activation_fn": activation, "net_arch": sizes})
    model.save(tmp_path / "model.zip")
    observation = np.random.default_rng(1).uniform(-1.0, 1.0, (20, context.layout.size))
    expected, _ = model.predict(observation, deterministic=True)
    actions, _ = StableBaselinesPolicy(context, 0, tmp_path / "model.zip").predict(observation)
    np.testing.assert_allclose(actions, expected, atol=1e-5)


@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
def test_noise_is_that_of_the_model(algorithm: str, tmp_path: Path, context: PolicyContext) -> None:
    model = made(algorithm, policy_kwargs={"log_std_init": -2.0})
    model.save(tmp_path / "model.zip")
    observation = np.zeros((4000, context.layout.size))
    theirs, _ = model.predict(observation, deterministic=False)
    policy = StableBaselinesPolicy(context, 0, tmp_path / "model.zip")
    ours, _ = policy.predict(observation, deterministic=False)
    assert ours.std(axis=0).min() > 0.01
    np.testing.assert_allclose(ours.std(axis=0), theirs.std(axis=0), rtol=0.1)


@pytest.mark.usefixtures("brief_reports")
def test_one_command_plays_a_zip(ppo: Path, tmp_path: Path) -> None:
    from agents.commands.evaluate import main as evaluate

    arguments = ["--policy", str(ppo), "--episodes", "2", "--no-pictures", "--output", str(tmp_path / "out")]
    assert evaluate(arguments) == 0
    records = read_records(tmp_path / "out" / "records.jsonl")
    assert [record.policy for record in records] == ["ppo", "ppo"]


def test_what_was_resolved_can_be_built_elsewhere(ppo: Path, tmp_path: Path, context: PolicyContext) -> None:
    for name in (str(ppo), "gjm"):
        policy = resolve_policy(name)
        again = pickle.loads(pickle.dumps(policy))
        assert again == policy and isinstance(again, ResolvedPolicy)
        factory = pickle.loads(pickle.dumps(policy.factory(3)))
        observation = CaptureVectorEnv(ENV_ID, num_envs=2).reset(seed=0)[0]
        ours, theirs = (build(context).predict(observation)[0] for build in (policy.factory(3), factory))
        np.testing.assert_array_equal(ours, theirs)


def test_files_are_found_from_another_folder(
    ppo: Path, tmp_path: Path, context: PolicyContext, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ppo.parent)
    policy = resolve_policy("ppo.zip")
    monkeypatch.chdir(tmp_path)
    assert policy.build(context, 0)


def test_no_pickle_is_opened(ppo: Path, tmp_path: Path) -> None:
    """Hostile pickles wherever a zip of stable-baselines3 has pickles; the honest loader opens the first."""
    mark = tmp_path / "exploded"
    poison = base64.b64encode(pickle.dumps(Bomb(mark), protocol=2)).decode()
    everywhere = tmp_path / "everywhere.zip"

    def poisoned(content: bytes) -> bytes:
        data = json.loads(content)
        for value in data.values():
            if isinstance(value, dict) and ":serialized:" in value:
                value[":serialized:"] = poison
        return json.dumps(data | {"extra": {":type:": "x", ":serialized:": poison}}).encode()

    bomb = pickle.dumps(Bomb(mark), protocol=2)
    rewritten(
        ppo,
        everywhere,
        data=poisoned,
        pytorch_variables_pth=lambda _: bomb,
        policy_optimizer_pth=lambda _: bomb,
    )
    assert load_network(everywhere).inputs == load_network(ppo).inputs
    assert not mark.exists()
    wrapped = io.BytesIO()
    th.save({"log_std": Bomb(mark)}, wrapped)
    for content in (bomb, wrapped.getvalue()):
        hostile = rewritten(ppo, tmp_path / "hostile.zip", policy_pth=lambda _, content=content: content)
        with pytest.raises(PolicyError, match="nothing of it was executed"):
            load_network(hostile)
        assert not mark.exists()
    # The bomb is a live one: a loader that unpickles sets it off.
    with pytest.raises(Exception):  # noqa: B017
        sb3.PPO.load(everywhere)
    assert mark.exists()


def test_damaged_files(ppo: Path, tmp_path: Path) -> None:
    whole = ppo.read_bytes()
    for content, message in (
        (whole[: len(whole) // 2], "damaged"),
        (b"", "not a whole zip"),
        (b"hello", "not a whole zip"),
        (whole.replace(b"policy_class", b"policy_clasp", 1), "not a whole zip"),  # a wrong checksum
    ):
        path = tmp_path / "model.zip"
        path.write_bytes(content)
        with pytest.raises(PolicyError, match=message):
            resolve_policy(str(path))
    with pytest.raises(PolicyError, match="there is no file"):
        load_network(tmp_path / "none.zip")
    np.savez(tmp_path / "arrays.zip", a=np.zeros(2))
    (tmp_path / "arrays.zip.npz").rename(tmp_path / "arrays.zip")
    with pytest.raises(PolicyError, match=r"holds no `data`.*a.npy"):
        load_network(tmp_path / "arrays.zip")
    for member, content, message in (
        ("data", b"{", "not JSON"),
        ("data", b"[" * 100_000, "not JSON"),
        ("data", b"[]", "not a JSON object"),
        ("policy_pth", b"nonsense", "damaged"),
        ("policy_pth", saved([1, 2]), "named arrays"),
        ("policy_pth", saved({"log_std": th.zeros(7, dtype=th.float64)}), "float32"),
        ("policy_pth", saved({"log_std": th.zeros(1).expand(10**9)}), "larger than itself"),
    ):
        changes = {member: lambda _, content=content: content}
        with pytest.raises(PolicyError, match=message):
            load_network(rewritten(ppo, tmp_path / "bad.zip", **changes))


def saved(value: Any) -> bytes:
    file = io.BytesIO()
    th.save(value, file)
    return file.getvalue()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (edited(("policy_class", "__module__"), "sb3_contrib.tqc.policies"), "sb3_contrib.tqc.policies"),
        (edited(("policy_class",), None), "module unknown"),
        (edited(("action_space", ":type:"), "<class 'gymnasium.spaces.discrete.Discrete'>"), "Discrete"),
        (edited(("action_space", "high"), "[1. 1. 1. 1. 1. 1. 2.]"), "high of its action_space"),
        (edited(("observation_space", ":type:"), "<class 'gymnasium.spaces.dict.Dict'>"), "Dict"),
        (edited(("observation_space", "_shape"), [3, 18]), "one axis"),
        (edited(("observation_space", "_shape"), [12]), r"has shape \[12\], its network"),
        (edited(("use_sde",), True), "use_sde"),
        (edited(("policy_kwargs",), {"activation_fn": "<class 'mine.Swish'>"}), "mine.Swish"),
        (edited(("policy_kwargs",), {"features_extractor_class": "<class 'mine.Net'>"}), "mine.Net"),
    ],
)
def test_what_cannot_be_read_is_named(
    change: Callable[[bytes], bytes], message: str, ppo: Path, tmp_path: Path
) -> None:
    with pytest.raises(PolicyError, match=message):
        load_network(rewritten(ppo, tmp_path / "model.zip", data=change))


def test_models_of_other_kinds_as_stable_baselines_saves_them(tmp_path: Path) -> None:
    path = tmp_path / "model.zip"
    for model, message in (
        (made("PPO", OwnPolicy), "OwnPolicy"),
        (made("SAC", policy_kwargs={"features_extractor_class": Halved}), "Halved"),
        (made("A2C", use_sde=True), "use_sde"),
        (sb3.DQN("MlpPolicy", gym.make("CartPole-v1"), buffer_size=8), "DQNPolicy"),
        (sb3.PPO("MlpPolicy", gym.make("CartPole-v1"), n_steps=8, batch_size=8), "Discrete"),
        (sb3.PPO("MlpPolicy", gym.make("Pendulum-v1"), n_steps=8, batch_size=8), r"low.* is \[-2\.\]"),
    ):
        model.save(path)
        with pytest.raises(PolicyError, match=message):
            load_network(path)


@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
def test_normalised_observations_are_noticed(algorithm: str, tmp_path: Path) -> None:
    path = tmp_path / "model.zip"
    for normalised in (True, False):
        env = VecNormalize(DummyVecEnv([lambda: gym.make(ENV_ID)]), norm_obs=normalised, norm_reward=True)
        model = made(algorithm, env=env)
        model.learn(8)
        model.save(path)
        if normalised:
            with pytest.raises(PolicyError, match="VecNormalize"):
                load_network(path)
        else:
            assert load_network(path).outputs == 7


def test_layers_that_do_not_belong(ppo: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(ppo) as archive:
        arrays = th.load(io.BytesIO(archive.read("policy.pth")), weights_only=True)
    lstm = {"lstm_actor.weight_ih_l0": th.zeros(4, 4)}
    bent = {"action_net.bias": th.zeros(1, 7)}
    short = {"action_net.bias": th.zeros(6)}
    lost = {name: value for name, value in arrays.items() if name != "action_net.weight"}
    for content, message in (
        (arrays | lstm, "lstm_actor"),
        (arrays | bent, "action_net.bias"),
        (arrays | short, "do not fit"),
        (arrays | {"log_std": th.full((7,), np.nan)}, "finite"),
        (lost, r"missing \['action_net.weight'\]"),
    ):
        changed = rewritten(ppo, tmp_path / "bad.zip", policy_pth=lambda _, content=content: saved(content))
        with pytest.raises(PolicyError, match=message):
            load_network(changed)


def test_another_task_is_refused_by_its_sizes(ppo: Path) -> None:
    dual = PolicyContext.from_env(CaptureVectorEnv("SpaceCapture/DualArmPlanar-v0"))
    with pytest.raises(PolicyError, match="observations of size 55; those of SpaceCapture/DualArmPlanar-v0"):
        StableBaselinesPolicy(dual, 0, ppo)
    end_effector = PolicyContext.from_env(CaptureVectorEnv(ENV_ID, control_mode="end_effector_velocity"))
    with pytest.raises(PolicyError, match="actions of size 7.*'end_effector_velocity' have 6"):
        resolve_policy(str(ppo), "end_effector_velocity").build(end_effector, 0)
