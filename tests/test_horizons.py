"""After how many steps an episode is cut, by whichever of its names that was said."""

import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from boundary import SINGLE, gym_make, gym_make_vec
from gymnasium.envs.registration import EnvSpec
from gymnasium.wrappers import TimeAwareObservation

from space_envs.dynamics.rotations import from_matrix
from space_envs.envs import CaptureEnv, CaptureVectorEnv
from space_envs.errors import ConfigurationError, SpaceEnvsError
from space_envs.registration import ENTRIES
from space_envs.wrappers import GoalConditioned

every_id = pytest.mark.parametrize("env_id", sorted(ENTRIES))


def length(env, action=0.0):
    """Steps of an episode, and what was said of its end."""
    env.reset(seed=0)
    for step in range(1, 1000):
        *_, terminated, truncated, info = env.step(np.full(env.action_space.shape, action))
        if np.all(terminated) or np.all(truncated):
            return step, bool(np.all(truncated)), np.ravel(info["outcome"])[0]
    raise AssertionError("the episode has no end")


@every_id
def test_the_spec_says_the_horizon_in_effect(env_id):
    default = ENTRIES[env_id].task().horizon
    for make in (gym_make, gym_make_vec):
        assert make(env_id).spec.max_episode_steps == default
        assert make(env_id, horizon=7).spec.max_episode_steps == 7
        assert make(env_id, max_episode_steps=default + 9).spec.max_episode_steps == default + 9
        assert make(env_id, max_episode_steps=-1).spec.max_episode_steps == default
    assert gym.spec(env_id).max_episode_steps is None  # the registry's is not that of an environment
    assert gym_make_vec(env_id, vectorization_mode="sync").spec.max_episode_steps is None


LIMITED = {
    "make": lambda **keywords: gym_make(SINGLE, **keywords),
    "goals": lambda **keywords: GoalConditioned(gym_make(SINGLE, **keywords)),
    "native": lambda **keywords: gym_make_vec(SINGLE, num_envs=2, autoreset_mode="disabled", **keywords),
    "sync": lambda **keywords: gym_make_vec(SINGLE, num_envs=2, vectorization_mode="sync", **keywords),
    "class": lambda **keywords: CaptureEnv(**keywords),
}


@pytest.mark.parametrize("kind", LIMITED)
@pytest.mark.parametrize("keyword", ["horizon", "max_episode_steps"])
def test_both_names_of_the_horizon_end_an_episode_as_a_timeout(kind, keyword):
    for steps in (4, 230):  # less and more than the default
        assert length(LIMITED[kind](**{keyword: steps})) == (steps, True, "timeout")


@pytest.mark.parametrize("make", [gym_make, gym_make_vec, CaptureEnv, CaptureVectorEnv])
def test_two_horizons_must_agree(make):
    ids = () if make is CaptureEnv else (SINGLE,)
    assert make(*ids, horizon=5, max_episode_steps=5) is not None
    with pytest.raises(ConfigurationError, match="must agree, got 5 and 4"):
        make(*ids, horizon=5, max_episode_steps=4)
    for bad in (0, -2, 2.5, True, "4", 10**400):
        with pytest.raises(SpaceEnvsError, match="max_episode_steps must be|horizon must be"):
            make(*ids, max_episode_steps=bad)  # type: ignore[arg-type]


@pytest.mark.parametrize("keywords", [{"horizon": 6}, {"max_episode_steps": 6}, {"max_episode_steps": 300}])
def test_what_a_spec_makes_ends_where_the_original_does(keywords):
    env = gym_make(SINGLE, **keywords)
    expected = length(env)
    specs = [env.spec, EnvSpec.from_json(env.spec.to_json()), pickle.loads(pickle.dumps(env)).spec]
    for spec in specs:
        again = gym_make(spec)
        assert length(again) == expected
        assert again.spec.max_episode_steps == expected[0]
        assert gym_make(again.spec).spec == again.spec
    vector = gym_make_vec(SINGLE, num_envs=3, **keywords)
    again = gym_make_vec(vector.spec)
    assert again.num_envs == 3
    assert (
        again.spec.max_episode_steps
        == expected[0]
        == pickle.loads(pickle.dumps(vector)).spec.max_episode_steps
    )
    with pytest.raises(ConfigurationError, match="must agree"):
        gym_make(env.spec, horizon=9)


def test_a_registered_limit_is_the_horizon():
    gym.register(
        "SpaceCaptureTest/Short-v0",
        entry_point="space_envs.envs:CaptureEnv",
        vector_entry_point="space_envs.envs:CaptureVectorEnv",
        max_episode_steps=5,
        kwargs={"env_id": SINGLE},
    )
    try:
        assert length(gym_make("SpaceCaptureTest/Short-v0")) == (5, True, "timeout")
        assert length(gym_make("SpaceCaptureTest/Short-v0", max_episode_steps=8)) == (8, True, "timeout")
        vector = gym_make_vec("SpaceCaptureTest/Short-v0", autoreset_mode="disabled")
        assert length(vector) == (5, True, "timeout")
    finally:
        del gym.registry["SpaceCaptureTest/Short-v0"]


@pytest.mark.parametrize(("keywords", "horizon"), [({"horizon": 7}, 7), ({}, 200)])
def test_a_limit_of_another_id_is_not_that_of_an_environment_inside(keywords, horizon):
    """What builds an environment of ours on its way is limited from outside, as any other."""

    def inside(**_: Any) -> gym.Env:
        return gym.wrappers.ClipReward(CaptureEnv(env_id=SINGLE, **keywords), -1.0, 1.0)

    name = "SpaceCaptureTest/Inside-v0"
    gym.register(name, entry_point=inside, max_episode_steps=5)
    try:
        env = gym_make(name)
        assert env.unwrapped.task.horizon == horizon
        assert env.spec.max_episode_steps == 5
        assert length(env) == (5, True, "running")
        assert gym_make(name, max_episode_steps=9).unwrapped.task.horizon == horizon
    finally:
        del gym.registry[name]


def test_a_class_of_a_users_own_has_the_limit_that_it_is_registered_with():
    class Own(CaptureEnv):
        def __init__(self, **keywords):
            self.inner = CaptureEnv()
            super().__init__(**keywords)

    name = "SpaceCaptureTest/Own-v0"
    gym.register(name, entry_point=Own, max_episode_steps=5)
    try:
        env = gym_make(name)
        assert length(env) == (5, True, "timeout")
        assert env.unwrapped.inner.task.horizon == 200
    finally:
        del gym.registry[name]


def test_a_make_whose_names_are_unknown_says_no_limit(monkeypatch):
    def other(creator, limit):
        return creator(horizon=limit)

    monkeypatch.setattr("space_envs.registration.make", other)
    assert other(CaptureEnv, 7).task.horizon == 7


def test_an_end_at_the_last_step_is_the_same_with_gymnasiums_limit():
    """Captured there, an episode is terminated, and it is truncated as well, as by Gymnasium's TimeLimit."""
    env = gym_make(SINGLE, horizon=10)
    goal = env.unwrapped.task.mechanics.end_effector_pose(env.unwrapped.task.mechanics.home)
    options = {"goal_position": goal[0], "goal_quaternion": from_matrix(goal[1])}
    for made in (env, gym_make(env.spec)):
        made.reset(options=options)
        ends = [made.step(np.zeros(7)) for _ in range(10)]
        assert [end[2:4] for end in ends] == [(False, False)] * 9 + [(True, True)]
        assert ends[-1][4]["outcome"] == "captured"


@every_id
def test_wrappers_that_need_a_time_limit(env_id):
    env = TimeAwareObservation(gym_make(env_id, horizon=4))
    assert env.reset(seed=0)[0][-1] == 0
    assert env.max_timesteps == 4
