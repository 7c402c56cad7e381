"""Anything at all, at every call of an environment: it is done, or refused before anything has moved."""

import numpy as np
import pytest
from boundary import Strange, check, gym_make, pair, soon
from hypothesis import given, settings
from hypothesis import strategies as st

from space_envs.envs import CaptureVectorEnv
from space_envs.envs.limits import MAX_ENVS
from space_envs.errors import ActionError, SpaceEnvsError
from space_envs.registration import ENTRIES, ENVELOPE_KEYWORDS

every_id = pytest.mark.parametrize("env_id", sorted(ENTRIES))

NUMBERS = st.one_of(
    st.floats(),
    st.integers(),
    st.booleans(),
    st.sampled_from(
        [0, 1, -1, 0.1, 0.02, 10**400, -(10**400), 1e308, 5e-324, np.float32(0.5), np.int8(3), 2**63]
    ),
)
LEAVES = st.one_of(NUMBERS, st.none(), st.text(max_size=5), st.sampled_from(["test", "easy", "rgb_array"]))
ANYTHING = st.one_of(
    LEAVES,
    st.builds(Strange),
    st.binary(max_size=3),
    st.recursive(NUMBERS, lambda inner: st.lists(inner, max_size=4), max_leaves=12),
    st.dictionaries(st.text(max_size=3), NUMBERS, max_size=2),
    st.lists(NUMBERS, max_size=4).map(lambda values: np.array(values, dtype=object)),
    st.sampled_from(
        [
            np.zeros(0),
            np.zeros((2, 3)),
            np.array(3),
            np.array([1, 2]),
            np.array(["a"]),
            np.ones(2, dtype=bool),
        ]
    ),
    st.sampled_from([np.datetime64("2020"), 3j, np.array([1j]), object(), int, b"", ..., slice(3)]),
)
KEYWORDS = (
    *(
        "difficulty",
        "split",
        "reward",
        "robot",
        "variant",
        "horizon",
        "timestep",
        "control_period",
        "attitude_limit",
    ),
    *("c", "mounts", "num_envs", "control_mode", "autoreset_mode", "threads", "render_mode", "width"),
    *("height", "camera", "max_episode_steps", "nothing", *ENVELOPE_KEYWORDS),
)


@every_id
@given(st.dictionaries(st.sampled_from(KEYWORDS), ANYTHING, min_size=1, max_size=2))
@settings(max_examples=30)
def test_any_keywords_are_taken_or_refused(env_id, keywords):
    if isinstance(keywords.get("num_envs"), int | np.integer):
        keywords["num_envs"] = keywords["num_envs"] if not 50 < keywords["num_envs"] <= MAX_ENVS else 50
    with soon():
        try:
            env = CaptureVectorEnv(env_id, **keywords)
        except SpaceEnvsError:
            return
    assert env.observation_space.shape == (env.num_envs, env.task.layout.size)
    env.close()


@every_id
@given(data=st.data())
@settings(max_examples=30)
def test_any_reset_is_done_or_refused_and_then_nothing_moved(env_id, data):
    task = pair(env_id)[0].task
    names = (
        "split",
        "index",
        "joint_position",
        "joint_velocity",
        "reset_mask",
        "nothing",
        *task.goal_options,
    )
    options = data.draw(
        st.one_of(ANYTHING, st.dictionaries(st.sampled_from(names), ANYTHING, min_size=1, max_size=3))
    )
    if isinstance(options, dict) and data.draw(st.booleans()):
        goal = data.draw(
            st.fixed_dictionaries(
                {
                    name: st.lists(st.floats(-3, 3), min_size=option.width, max_size=option.width)
                    for name, option in task.goal_options.items()
                }
            )
        )
        options = {**goal, **options}
    seed = data.draw(st.one_of(st.none(), ANYTHING))
    check(env_id, lambda env: env.reset(seed=seed, options=options))


@every_id
@given(ANYTHING)
@settings(max_examples=30)
def test_any_action_is_done_or_refused_and_then_nothing_moved(env_id, action):
    check(env_id, lambda env: env.step(action), ActionError)


@every_id
@given(ANYTHING)
@settings(max_examples=20)
def test_any_action_of_the_single_environment_likewise(env_id, action):
    env = pair(env_id)[0]
    single = SINGLES.setdefault(env_id, gym_make(env_id))
    single.reset(seed=0)
    with soon():
        try:
            single.step(action)
        except ActionError:
            np.testing.assert_array_equal(
                single.unwrapped.vector.simulation.qvel[:, : env.simulation.n_base], 0.0
            )


SINGLES = {}
