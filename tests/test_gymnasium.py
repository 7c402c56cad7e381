"""What clients of Gymnasium rely on: errors, seeds, infos, specs and copies."""

import copy
import pickle
import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import check_env

import space_envs  # noqa: F401  (registers the ids)
from space_envs.envs import CaptureEnv, CaptureVectorEnv
from space_envs.errors import ConfigurationError, SpaceEnvsError
from space_envs.registration import ENTRIES
from space_envs.wrappers import GoalConditioned

# Of any type: a type checker cannot see what is behind them.
gym_make: Any = gym.make
gym_make_vec: Any = gym.make_vec
IDS = sorted(ENTRIES)
SINGLE = "SpaceCapture/SingleArm-v0"
every_id = pytest.mark.parametrize("env_id", IDS)
every_autoreset = pytest.mark.parametrize("mode", list(gym.vector.AutoresetMode))


# Errors ------------------------------------------------------------------------------------------------


@every_id
@pytest.mark.parametrize("make", [gym_make, gym_make_vec, CaptureVectorEnv])
def test_an_unknown_keyword_is_a_type_error_with_pythons_words(make, env_id):
    with pytest.raises(TypeError, match="unexpected keyword argument 'frameskip'") as caught:
        make(env_id, frameskip=1)
    assert isinstance(caught.value, ConfigurationError)
    with pytest.raises(TypeError, match="argument 'horizn'.*Did you mean 'horizon'"):
        make(env_id, horizn=3)


def test_keywords_of_the_vector_environment_are_unknown_to_the_single_one():
    for name in ("num_envs", "autoreset_mode"):
        with pytest.raises(TypeError, match=f"unexpected keyword argument '{name}'.*gym.make_vec"):
            gym_make(SINGLE, **{name: 2})


@pytest.mark.parametrize(
    ("call", "classes"),
    [
        (lambda: gym_make_vec(SINGLE).step(np.zeros((1, 7))), (gym.error.ResetNeeded, ConfigurationError)),
        (lambda: CaptureEnv().step(np.zeros(7)), (gym.error.ResetNeeded,)),
        (lambda: CaptureEnv(render_mode="rgb_array").render(), (gym.error.ResetNeeded,)),
        (lambda: CaptureVectorEnv("SpaceCapture/None-v0"), (gym.error.UnregisteredEnv, ValueError)),
        (lambda: CaptureVectorEnv(split="tset"), (ValueError, gym.error.Error)),
        (lambda: gym_make_vec(SINGLE).reset(seed=-1), (ValueError, gym.error.Error)),
        (lambda: started().step(np.zeros(3)), (gym.error.InvalidAction, ValueError)),
        (lambda: started().step(np.full(7, np.nan)), (gym.error.InvalidAction, ValueError)),
    ],
)
def test_errors_are_those_that_clients_catch(call, classes):
    with pytest.raises(SpaceEnvsError) as caught:
        call()
    for each in classes:
        assert isinstance(caught.value, each)
    assert str(pickle.loads(pickle.dumps(caught.value))) == str(caught.value)


def started(**keywords):
    env = gym_make(SINGLE, **keywords)
    env.reset(seed=0)
    return env


# Seeds -------------------------------------------------------------------------------------------------


def makers():
    """Every way to make two rows, and how the seeds of a row are told."""
    yield lambda: gym_make_vec(SINGLE, num_envs=2)
    for mode in ("sync", "async"):
        yield lambda mode=mode: gym_make_vec(SINGLE, num_envs=2, vectorization_mode=mode)


def test_np_random_of_the_single_environment():
    env = gym_make(SINGLE)
    before = env.unwrapped.np_random_seed  # there is one before the first reset
    first = env.reset()[0]
    assert env.unwrapped.np_random_seed == before
    np.testing.assert_array_equal(gym_make(SINGLE).reset(seed=before)[0], first)
    env.reset(seed=3)
    assert env.np_random_seed == 3
    state = env.np_random.bit_generator.state
    expected = env.reset()[0]
    assert env.np_random_seed == 3
    assert env.np_random.bit_generator.state != state  # it is what goals are drawn from
    env.reset(seed=3)
    np.testing.assert_array_equal(env.reset()[0], expected)
    env.np_random = np.random.default_rng(8)
    assert env.np_random_seed == -1
    drawn = env.reset()[0]
    env.np_random = np.random.default_rng(8)
    np.testing.assert_array_equal(env.reset()[0], drawn)


def test_np_random_of_the_native_vector_environment():
    env = gym_make_vec(SINGLE, num_envs=3)
    before = env.np_random_seed
    first = env.reset()[0]
    assert env.np_random_seed == before
    np.testing.assert_array_equal(gym_make_vec(SINGLE, num_envs=3).reset(seed=before)[0], first)
    env.reset(seed=3)
    assert env.np_random_seed == 3
    single = gym_make(SINGLE)
    single.reset(seed=3)
    assert env.np_random.bit_generator.state == single.np_random.bit_generator.state
    env.reset()
    assert env.np_random_seed == 3
    env.reset(seed=[8, 5, 9])
    assert env.np_random_seed == 8
    env.reset(seed=[None, 5, 9])
    assert env.np_random_seed == 8
    drawn = []
    for _ in range(2):
        env.np_random = np.random.default_rng(2)
        assert env.np_random_seed == -1
        drawn.append(env.reset()[0])
    np.testing.assert_array_equal(drawn[0], drawn[1])
    assert len(np.unique(drawn[0], axis=0)) == 3
    with pytest.raises(ConfigurationError):
        env.reset(seed=4, options={"split": "no"})
    assert env.np_random_seed == -1


def test_gymnasiums_own_vectorizers_give_the_same_rows():
    rows = []
    for make in makers():
        env = make()
        observations = [env.reset(seed=5)[0], env.reset()[0], env.reset(seed=[7, None])[0]]
        observations.append(env.step(np.full((2, 7), 0.3))[0])
        rows.append(np.stack(observations))
        env.close()
    np.testing.assert_array_equal(rows[0], rows[1])
    np.testing.assert_array_equal(rows[0], rows[2])


def test_unseeded_resets_differ():
    seen = [env.reset()[0] for make in makers() for env in [make()] * 2]
    # Of 4096 goals two rows may draw the same one.
    assert len(np.unique(np.concatenate(seen), axis=0)) >= 2 * len(seen) - 2


# Infos -------------------------------------------------------------------------------------------------


def present(info, rows):
    """What a vector info says of each row: nested values by name, as its masks tell."""
    said = [{} for _ in range(rows)]
    for name, value in info.items():
        if name.startswith("_"):
            continue
        for row in np.flatnonzero(info["_" + name]):
            said[row][name] = present(value, rows)[row] if isinstance(value, dict) else value[row]
    return said


@every_id
@every_autoreset
def test_infos_say_what_those_of_gymnasiums_vector_environment_say(env_id, mode):
    keywords = {"horizon": 4, "attitude_limit": 0.2}
    native = gym_make_vec(env_id, num_envs=4, autoreset_mode=mode, **keywords)
    sync = gym.vector.SyncVectorEnv([lambda: gym_make(env_id, **keywords)] * 4, autoreset_mode=mode)
    results: Any = [env.reset(seed=3) for env in (native, sync)]
    rng, ends = np.random.default_rng(0), 0
    for _ in range(12):
        (_, info), (_, expected) = (result[0::4] if len(result) == 5 else result for result in results)
        np.testing.assert_array_equal(results[0][0], results[1][0])
        for got, wanted in zip(present(info, 4), present(expected, 4), strict=True):
            np.testing.assert_equal(got, wanted)
            assert {name: type(value) for name, value in got.items()} == {
                name: type(value) for name, value in wanted.items()
            }
        for name in expected:
            if not name.startswith("_") and not isinstance(expected[name], dict):
                assert info[name].dtype == expected[name].dtype
        for one, other in zip(results[0][1:-1], results[1][1:-1], strict=True):
            np.testing.assert_array_equal(one, other)
        if mode is gym.vector.AutoresetMode.DISABLED and len(results[0]) == 5:
            done = results[0][2] | results[0][3]
            if done.any():
                ends += 1
                results = [env.reset(options={"reset_mask": done.copy()}) for env in (native, sync)]
                continue
        actions = rng.uniform(-1, 1, native.action_space.shape) * [[1.0], [0.0], [0.5], [0.01]]
        results = [env.step(actions) for env in (native, sync)]
        ends += int((results[0][2] | results[0][3]).any())
    assert ends >= 2


# Copies, wrappers --------------------------------------------------------------------------------------


@every_id
def test_copies_keep_gymnasiums_attributes(env_id):
    for env in (gym_make_vec(env_id, num_envs=2), gym_make(env_id, horizon=9)):
        env.reset(seed=3)
        for other in (pickle.loads(pickle.dumps(env)), copy.deepcopy(env)):
            assert other.spec == env.spec is not None
            assert other.np_random_seed == 3
            np.testing.assert_array_equal(other.reset()[0], copy.deepcopy(env).reset()[0])
        env.close()
        env.close()
    vector = gym_make_vec(env_id)
    vector.close()
    assert vector.closed
    assert pickle.loads(pickle.dumps(vector)).closed


@every_id
def test_goal_conditioned_keeps_gymnasiums_contracts(env_id):
    env: Any = GoalConditioned(gym_make(env_id, horizon=5))
    with warnings.catch_warnings():
        warnings.filterwarnings("error")
        warnings.filterwarnings("ignore", ".*different from the unwrapped version")
        check_env(env, skip_render_check=True)
    assert env.spec.additional_wrappers[-1].name == "GoalConditioned"
    assert env.spec.max_episode_steps == 5
    expected = env.reset(seed=4)[0]
    action = np.full(env.action_space.shape, 0.2)
    stepped = env.step(action)
    copies: list[Any] = [
        pickle.loads(pickle.dumps(env)),
        copy.deepcopy(env),
        gym_make(env.spec),
        gym_make(EnvSpec.from_json(env.spec.to_json())),
    ]
    assert [type(other) for other in copies] == [GoalConditioned] * 4
    for other in copies:
        assert other.spec.max_episode_steps == 5
        for name, value in other.reset(seed=4)[0].items():
            np.testing.assert_array_equal(value, expected[name])
        assert other.step(action)[1:] == stepped[1:]
        assert other.np_random_seed == 4
        assert all(other.observation_space[name] == env.observation_space[name] for name in expected)
    made = gym_make_vec(env.spec, num_envs=2, vectorization_mode="sync")
    np.testing.assert_array_equal(made.reset(seed=4)[0]["desired_goal"][0], expected["desired_goal"])


@pytest.mark.parametrize("wrong", [gym_make("CartPole-v1"), gym_make_vec(SINGLE), "CartPole-v1", None])
def test_goal_conditioned_refuses_what_it_cannot_wrap(wrong):
    with pytest.raises(ConfigurationError, match="capture environment"):
        GoalConditioned(wrong)


def test_goal_conditioned_refuses_goals_of_another_size():
    env = GoalConditioned(gym_make(SINGLE))
    with pytest.raises(ConfigurationError, match=r"\(\.\.\., 7\)"):
        env.compute_reward(np.zeros(6), np.zeros(6), {})


def test_the_extra_for_videos_is_named_and_kept_apart():
    """MoviePy holds Pillow below the version that constraints.txt names."""
    import tomllib
    from pathlib import Path

    root = Path(__file__).resolve().parent.parent
    extras = tomllib.loads((root / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    assert extras["video"][0].startswith("moviepy")
    assert not any("moviepy" in need or "video" in need for need in extras["test"])
    pins = dict(
        line.split("==") for line in (root / "constraints.txt").read_text().splitlines() if "==" in line
    )
    assert int(pins["pillow"].split(".")[0]) >= 12
    readme = " ".join((root / "README.md").read_text().split())
    assert "`RecordVideo` needs MoviePy" in readme
