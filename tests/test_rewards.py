"""Reward terms: one function and one row each, ours and those that a task of one's own adds."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from rollouts import rollout_of

from agents.learning.runs.feature_tables import SINGLE_ARM_FEATURES
from agents.learning.runs.hyperparameters import PPO
from benchmarks.returns import StoredEpisodes, load, rank_correlation, returns, scores
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.registration import ENTRIES
from space_envs.tasks.base import CaptureTask
from space_envs.tasks.common import CaptureErrors
from space_envs.tasks.outcome import kept_attitude
from space_envs.tasks.rewards import RewardTerm, StepQuantities
from space_envs.tasks.single_arm import SingleArmTask


def joint_speed(step: StepQuantities) -> np.ndarray:
    """Sum of squared joint rates, rad^2/s^2."""
    return (step.read("joint_velocity") ** 2).sum(axis=1)


def reached(step: StepQuantities) -> np.ndarray:
    """1 where the end-effector is within 10 m of its grapple."""
    return (step.errors.position < 10.0).astype(float)


@dataclass(frozen=True)
class SmoothTask(SingleArmTask):
    """The single arm with two terms more."""

    dense_reward = (
        *SingleArmTask.dense_reward,
        RewardTerm("joint_speed", joint_speed, -0.5),
        RewardTerm("reached", reached, 3.0, "once"),
    )


def quantities(task: SingleArmTask, n: int = 3) -> StepQuantities:
    """Quantities of a made-up control period, at the end of which row 1 captures and the others fail."""
    rng = np.random.default_rng(0)

    def made(captured: np.ndarray, failed: np.ndarray, beginning: StepQuantities | None) -> StepQuantities:
        observation, action = rng.normal(size=(n, task.layout.size)), rng.uniform(-1, 1, (n, 7))
        task.layout.read(observation, "peak_attitude")[:] = np.deg2rad(3.0)
        errors, attitude = task.errors(observation), task.attitude(observation)
        return StepQuantities(
            *(observation, observation, action, errors, attitude, captured, failed),
            *(task.layout, task.limits, beginning),
        )

    none, ended = np.zeros(n, dtype=bool), np.arange(n) == 1
    return made(ended, ~ended, made(none, none, None))


def test_a_task_adds_a_term_in_its_own_file():
    task = SmoothTask()
    step = quantities(task)
    values = dict(zip([term.name for term in task.reward_terms], task.weighted_terms(step).T, strict=True))
    speed = np.sum(step.observation[:, 7:14] ** 2, axis=1)
    np.testing.assert_array_equal(values["joint_speed"], speed * (0.1 * -0.5))  # per second
    np.testing.assert_array_equal(values["reached"], [3.0] * 3)  # once
    np.testing.assert_allclose(values["capture"], [0.0, 2.5, 0.0])  # 10 / (1 + 3 deg / 1 deg)
    np.testing.assert_array_equal(values["failure"], [-0.5, 0.0, -0.5])
    longer = replace(task, control_period=0.2).weighted_terms(step)
    np.testing.assert_allclose(longer[:, -2], 2.0 * values["joint_speed"])
    assert [term.name for term in replace(task, reward="sparse").reward_terms] == [
        "attitude",
        "capture",
        "failure",
    ]


def test_a_term_is_refused_with_what_is_wrong():
    with pytest.raises(ConfigurationError, match="Did you mean 'second'"):
        RewardTerm("speed", joint_speed, 1.0, "seconds")
    with pytest.raises(ConfigurationError, match="must have a function, got 3"):
        RewardTerm("speed", 3, 1.0)  # type: ignore[arg-type]

    class Twice(SingleArmTask):
        dense_reward = (*SingleArmTask.dense_reward, RewardTerm("effort", joint_speed, 1.0))

    with pytest.raises(ConfigurationError, match="names of reward terms must differ"):
        Twice()


def test_every_term_of_the_dense_reward_is_what_the_page_says():
    """From numbers worked out by hand: c_v^2, angles in rad, exp(-worst ratio), mean squared action."""
    task = SingleArmTask()
    made = quantities(task, 2)
    none = np.zeros(2, dtype=bool)

    def state(position: float, angle: float) -> dict:
        errors = CaptureErrors(*(np.full(2, value) for value in (position, angle, 0.0, 0.0, 0.3)))
        return {"errors": errors, "captured": none, "failed": none}

    assert made.beginning is not None
    beginning = made.beginning._replace(**state(0.4, 0.5))
    action = np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.5] * 7])
    step = made._replace(
        **state(0.1, 0.2), attitude=np.array([0.25, 0.5]), action=action, beginning=beginning
    )
    assert (task.limits.position, round(np.rad2deg(task.limits.orientation), 9)) == (0.05, 5.0)
    ratio = 0.2 / np.deg2rad(5.0)  # of the angle, larger than 0.1 / 0.05
    before = 0.4 / 0.05  # of the position, larger than 0.5 / 0.087
    expected = {
        "attitude": [-0.009, -0.009],
        "attitude_angle": [-0.0025, -0.005],
        "position": [0.5 * (0.4 - 0.1)] * 2,
        "orientation": [0.25 * (0.5 - 0.2)] * 2,
        "precision": [0.5 * (np.exp(-ratio) - np.exp(-before))] * 2,
        "effort": [-0.002 / 7, -0.0005],
        "capture": [0.0, 0.0],
        "failure": [0.0, 0.0],
    }
    assert [term.name for term in task.reward_terms] == list(expected)
    np.testing.assert_allclose(task.weighted_terms(step).T, list(expected.values()), rtol=1e-12, atol=1e-16)
    # At the goal every potential is 0, and the capture is worth its score: the peak is 3 deg.
    captured = dict(zip(expected, task.weighted_terms(step._replace(captured=~none)).T, strict=True))
    np.testing.assert_allclose(captured["position"] + captured["orientation"], 0.5 * 0.4 + 0.25 * 0.5)
    np.testing.assert_allclose(captured["precision"], 0.5 * (1.0 - np.exp(-before)))
    np.testing.assert_allclose(captured["capture"], 2.5)


SHAPING = [term.name for term in SingleArmTask.dense_reward if term.per == "change"]


@pytest.mark.parametrize("env_id", sorted(name for name in ENTRIES if name.startswith("SpaceCapture/")))
def test_shaping_depends_on_the_first_and_the_last_state_alone(env_id: str):
    """Whatever lies between: motions that differ, with an autoreset and a restored snapshot in between."""
    env = CaptureVectorEnv(env_id, 4, horizon=25, collisions=False)
    rng, last = np.random.default_rng(1), None
    observation, _ = env.reset(seed=0)
    for step in range(60):
        if last is None:
            first, total = env.task.errors(observation), np.zeros(4)
        observation, _, _, truncated, info = env.step(rng.uniform(-1, 1, env.action_space.shape))
        last = env.task.errors(observation)
        total = total + sum(info["reward_terms"][name] for name in SHAPING if name in info["reward_terms"])
        expected = potential(env.task, last) - potential(env.task, first)
        np.testing.assert_allclose(total, expected, atol=1e-12)
        if step == 10:
            snapshot = env.snapshot()
            env = CaptureVectorEnv(env_id, 4, horizon=25, collisions=False)
            env.restore(snapshot)
        if truncated.all():
            observation, *_ = env.step(np.zeros(env.action_space.shape))  # resets
            last = None
    assert step == 59


def potential(task: CaptureTask, errors: CaptureErrors) -> np.ndarray:
    """Potential (N,) of states, from its definition."""
    position, angle = errors.position, errors.orientation
    ratio = np.maximum(position / task.limits.position, angle / task.limits.orientation)
    return -0.5 * position - 0.25 * angle - 0.5 * (1.0 - np.exp(-ratio))


@pytest.mark.parametrize("env_id", sorted(name for name in ENTRIES if name.startswith("SpaceCapture/")))
@pytest.mark.parametrize("discount", [1.0, PPO(features=SINGLE_ARM_FEATURES).gamma])
def test_the_return_ranks_policies_as_the_leaderboard_does(env_id: str, discount: float):
    found = rank_correlation(env_id, discount)
    assert found.spearman >= 0.9 and found.kendall >= 0.75, found


def test_a_reward_with_other_weights_ranks_policies_differently():
    """So the test above can fail: with a heavy attitude angle, shaping by the second, a cheap capture."""
    env_id = "SpaceCapture/SingleArm-v0"

    def weighted(**changes: Any) -> tuple[RewardTerm, ...]:
        return tuple(replace(term, **changes.get(term.name, {})) for term in SingleArmTask.dense_reward)

    for changes in (
        {"attitude_angle": {"weight": -3.0}},
        {"position": {"per": "second", "weight": -1.0}},
        {"capture": {"weight": 0.5}},
    ):

        @dataclass(frozen=True)
        class Changed(SingleArmTask):
            dense_reward = weighted(**changes)

        assert rank_correlation(env_id, 1.0, Changed()).spearman < 0.9, changes


def test_stored_episodes_give_the_return_that_the_environment_gave():
    env_id = "SpaceCapture/SingleArm-v0"
    rollout, task = rollout_of("gjm", 3, env_id, split="validation")
    stored = StoredEpisodes.of(rollout, task)
    np.testing.assert_allclose(returns(stored, task), rollout.episode_return, atol=2e-3)
    np.testing.assert_allclose(
        scores(stored), kept_attitude(rollout.outcome == "captured", rollout.peak_attitude), atol=1e-3
    )
    kept = load()[env_id, "gjm"]
    np.testing.assert_allclose(returns(kept, task)[:3], rollout.episode_return, atol=2e-3)
