"""Residual actions: nothing added is the policy itself, and what is added is scaled."""

import gymnasium as gym
import numpy as np
import pytest

from agents.learning.residual import ResidualAction, VectorResidualAction
from agents.policies.registry import make_policy
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.policy import PolicyContext

ENV_ID, N, STEPS = "SpaceCapture/SingleArm-v0", 3, 50


@pytest.mark.parametrize("expert", ["gjm", "minimum_jerk"])  # without and with a state
def test_nothing_added_is_the_policy_itself(expert: str) -> None:
    plain, wrapped = (CaptureVectorEnv(ENV_ID, N, autoreset_mode="same_step", horizon=20) for _ in range(2))
    residual = VectorResidualAction(wrapped, expert)
    policy, state, start = make_policy(expert, PolicyContext.from_env(plain), 0), None, np.ones(N, dtype=bool)
    observation, _ = plain.reset(seed=0)
    assert np.array_equal(observation, residual.reset(seed=0)[0])
    ends = 0
    for _ in range(STEPS):
        action, state = policy.predict(observation, state, start)
        observation, reward, terminated, truncated, _ = plain.step(action)
        start = terminated | truncated
        ends += start.sum()
        other, gained, *_ = residual.step(np.zeros((N, 7)))
        assert np.array_equal(observation, other) and np.array_equal(reward, gained)
    assert ends >= 2 * N  # the policy plans again in episodes that begin


def test_what_is_added_is_scaled_in_the_single_environment_too() -> None:
    env, plain = ResidualAction(gym.make(ENV_ID), "gjm", scale=0.5), gym.make(ENV_ID)
    observation, _ = env.reset(seed=1)
    plain.reset(seed=1)
    context = PolicyContext.from_env(plain.unwrapped)  # type: ignore[arg-type]
    action = make_policy("gjm", context, 0).predict(observation[None])[0][0]
    added = np.linspace(-0.4, 0.4, 7)
    expected, *_ = plain.step(np.clip(action + 0.5 * added, -1.0, 1.0))
    assert np.array_equal(env.step(added)[0], expected)


def test_bad_choices_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="same_step"):
        VectorResidualAction(CaptureVectorEnv(ENV_ID, 2))
    with pytest.raises(ConfigurationError, match="gjm"):
        ResidualAction(gym.make(ENV_ID), "gmj")
    with pytest.raises(ConfigurationError, match="scale"):
        ResidualAction(gym.make(ENV_ID), scale=-1.0)
    with pytest.raises(ConfigurationError, match="single capture environment"):
        ResidualAction(CaptureVectorEnv(ENV_ID, 2))  # type: ignore[arg-type]
