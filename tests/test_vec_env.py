"""The stable-baselines3 adapter says exactly what the Gymnasium environments say."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize
from training_runs import defaults

import space_envs  # noqa: F401  registers the ids
from agents.learning.sb3.vec_env import NativeVecEnv
from agents.policies.learned.features import FeatureView
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.registration import ENTRIES

EASY: dict[str, Any] = {"difficulty": "easy", "horizon": 6}
every_id = pytest.mark.parametrize("env_id", ENTRIES)


def view_of(env: CaptureVectorEnv, *without: str) -> FeatureView:
    """What networks see of an id's observations, but for features of these kinds and fields."""
    table = tuple(f for f in defaults("ppo", env.env_id).features if not {f.kind, f.field} & {*without})
    return FeatureView(table, env.task.layout, env.task.mechanics.home)


def adapter(n: int = 3, view: bool = False, **keywords: Any) -> NativeVecEnv:
    env = CaptureVectorEnv(num_envs=n, autoreset_mode="same_step", **{**EASY, **keywords})
    return NativeVecEnv(env, view_of(env) if view else None)


@every_id
@pytest.mark.parametrize("attitude_limit", [45.0, 0.02])  # with the small limit episodes end as failures
def test_same_as_single_gymnasium_environments(attitude_limit: float, env_id: str) -> None:
    n, seed = 3, 11
    vector = adapter(n, env_id=env_id, attitude_limit=attitude_limit)
    vector.seed(seed)
    observation = vector.reset()
    singles = [gym.make(env_id, attitude_limit=attitude_limit, **EASY) for _ in range(n)]
    expected = [env.reset(seed=seed + row)[0] for row, env in enumerate(singles)]
    np.testing.assert_array_equal(observation, expected)
    rng = np.random.default_rng(0)
    returns, lengths, ends = np.zeros(n), np.zeros(n, dtype=int), 0
    for _ in range(15):
        actions = rng.uniform(-1.0, 1.0, vector.env.action_space.shape).astype(np.float32)
        observation, rewards, dones, infos = vector.step(actions)
        for row, env in enumerate(singles):
            single, reward, terminated, truncated, info = env.step(actions[row])
            returns[row] += float(reward)
            lengths[row] += 1
            assert rewards[row] == np.float32(reward)
            assert dones[row] == (terminated or truncated)
            if dones[row]:
                ends += 1
                np.testing.assert_array_equal(infos[row]["terminal_observation"], single)
                assert infos[row]["TimeLimit.truncated"] == (truncated and not terminated)
                assert infos[row]["is_success"] == info["is_success"]
                assert infos[row]["outcome"] == info["outcome"]
                assert infos[row]["episode"]["r"] == pytest.approx(returns[row], abs=1e-12)
                assert infos[row]["episode"]["l"] == lengths[row]
                returns[row], lengths[row] = 0.0, 0
                single, _ = env.reset()
            else:
                assert infos[row] == {}
            np.testing.assert_array_equal(np.asarray(observation)[row], single)
    assert ends >= 2 * n


def test_infos_belong_to_the_caller() -> None:
    env = adapter()
    env.reset()
    _, _, _, infos = env.step(np.zeros((3, 7), dtype=np.float32))
    infos[0]["mine"] = 1
    assert infos[1] == {} and env.step(np.zeros((3, 7), dtype=np.float32))[3][0] == {}


def test_options_reach_the_environment_once() -> None:
    env = adapter()
    env.set_options([{"split": "validation", "index": index} for index in (5, 6, 7)])
    env.reset()
    assert [info["index"] for info in env.reset_infos] == [5, 6, 7]
    assert {info["split"] for info in env.reset_infos} == {"validation"}
    env.reset()
    assert {info["split"] for info in env.reset_infos} == {"train"}
    for bad in (
        [{"index": 1}, {}, {}],
        [{"split": name} for name in ("train", "test", "test")],
        {"reset_mask": np.ones(3, dtype=bool)},
    ):
        env.set_options(bad)  # pyright: ignore[reportArgumentType]
        with pytest.raises(ConfigurationError):
            env.reset()


@every_id
def test_features_are_what_the_learner_sees(env_id: str) -> None:
    raw, seen = adapter(env_id=env_id), adapter(view=True, env_id=env_id)
    for env in (raw, seen):
        env.seed(3)
    view = view_of(raw.env)
    assert seen.observation_space.shape == (view.size,)
    np.testing.assert_array_equal(np.asarray(seen.reset()), view(np.asarray(raw.reset())))
    actions = np.full(raw.env.action_space.shape, 0.5, dtype=np.float32)
    for _ in range(6):
        observation, _, _, infos = raw.step(actions)
        features, _, _, others = seen.step(actions)
        np.testing.assert_array_equal(np.asarray(features), view(np.asarray(observation)))
    assert np.asarray(features).dtype == np.float32
    for info, other in zip(infos, others, strict=True):
        np.testing.assert_array_equal(
            other["terminal_observation"], view(info["terminal_observation"][None])[0]
        )


@every_id
def test_features_do_not_depend_on_where_the_satellite_points(env_id: str) -> None:
    """Turning everything about the inertial frame changes the attitudes of bodies alone."""
    from space_envs.dynamics.rotations import exponential, multiply, rotate

    env = CaptureVectorEnv(env_id, num_envs=4)
    observation, _ = env.reset(seed=2)
    for _ in range(5):
        observation, *_ = env.step(np.full(env.action_space.shape, 0.8))
    layout, turned = env.task.layout, observation.copy()
    planar = "base_angle" in layout.slices
    vector = np.array([0.0, 0.0, 0.7]) if planar else np.array([0.4, -1.1, 0.7])
    turn, width = exponential(vector), 2 if planar else 3
    for field in layout.fields:
        value = layout.read(observation, field.name)
        if field.name.endswith("quaternion"):
            layout.read(turned, field.name)[:] = multiply(turn, value)
        elif field.name.endswith("_angle"):
            layout.read(turned, field.name)[:] += vector[2]
        elif not field.name.startswith(("joint", "obstacle_radius")) and field.size % width == 0:
            # One vector, or one for each end-effector.
            each = np.zeros((4, field.size // width, 3))
            each[..., :width] = value.reshape(4, -1, width)
            layout.read(turned, field.name)[:] = rotate(turn, each)[..., :width].reshape(4, -1)
    view = view_of(env, "rotation", "base_angle")
    assert np.abs(turned - observation).max() > 0.1
    np.testing.assert_allclose(view(turned), view(observation), atol=1e-6)


def test_wrappers_of_stable_baselines_work() -> None:
    env = VecNormalize(VecMonitor(adapter()))
    env.reset()
    for _ in range(7):
        _, rewards, _, infos = env.step(np.zeros((3, 7), dtype=np.float32))
        assert np.isfinite(rewards).all() and len(infos) == 3
    env.close()


@pytest.mark.filterwarnings("ignore:.*render was called without a render_mode")
def test_attributes_and_methods_of_rows() -> None:
    env = adapter()
    assert env.get_attr("control_mode") == ["joint_velocity"] * 3
    assert env.get_attr("num_envs", indices=[0]) == [3]
    assert env.env_is_wrapped(gym.Wrapper) == [False] * 3
    env.set_attr("color", "red")
    assert env.get_attr("color", 1) == ["red"]
    assert len(env.env_method("reset")) == 3
    assert env.render_mode is None and list(env.get_images()) == [None] * 3
    with pytest.raises(ConfigurationError, match="one by one"):
        env.env_method("reset", indices=0)


def test_only_same_step_autoreset() -> None:
    with pytest.raises(ConfigurationError, match="same_step"):
        NativeVecEnv(CaptureVectorEnv(num_envs=1))
