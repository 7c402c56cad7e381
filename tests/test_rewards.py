"""Reward terms: one function and one row each, ours and those that a task of one's own adds."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from space_envs.errors import ConfigurationError
from space_envs.tasks.common import CaptureErrors
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
    """Quantities of a made-up control period."""
    rng = np.random.default_rng(0)
    observation, action = rng.normal(size=(n, task.layout.size)), rng.uniform(-1, 1, (n, 7))
    ended = np.arange(n) == 1
    errors, attitude = task.errors(observation), task.attitude(observation)
    return StepQuantities(
        observation, observation, action, errors, attitude, ended, ~ended, task.layout, task.limits
    )


def test_a_task_adds_a_term_in_its_own_file():
    task = SmoothTask()
    step = quantities(task)
    values = dict(zip([term.name for term in task.reward_terms], task.weighted_terms(step).T, strict=True))
    speed = np.sum(step.observation[:, 7:14] ** 2, axis=1)
    np.testing.assert_array_equal(values["joint_speed"], speed * (0.1 * -0.5))  # per second
    np.testing.assert_array_equal(values["reached"], [3.0] * 3)  # once
    np.testing.assert_array_equal(values["capture"], [0.0, 10.0, 0.0])
    np.testing.assert_array_equal(values["failure"], [-20.0, 0.0, -20.0])
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
    """From numbers worked out by hand: -c_v^2, angles in rad, exp(-worst ratio), mean squared action."""
    task = SingleArmTask()
    made = quantities(task, 2)
    errors = CaptureErrors(*(np.full(2, value) for value in (0.1, 0.2, 0.0, 0.0, 0.3)))
    action = np.array([[1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.5] * 7])
    none = np.zeros(2, dtype=bool)
    step = made._replace(
        errors=errors, attitude=np.array([0.25, 0.5]), action=action, captured=none, failed=none
    )
    assert (task.limits.position, round(np.rad2deg(task.limits.orientation), 9)) == (0.05, 5.0)
    ratio = 0.2 / np.deg2rad(5.0)  # of the angle, larger than 0.1 / 0.05
    expected = {
        "attitude": [-0.009, -0.009],
        "attitude_angle": [-0.025, -0.05],
        "position": [-0.01, -0.01],
        "orientation": [-0.01, -0.01],
        "precision": [0.1 * np.exp(-ratio)] * 2,
        "effort": [-0.002 / 7, -0.0005],
        "capture": [0.0, 0.0],
        "failure": [0.0, 0.0],
    }
    assert [term.name for term in task.reward_terms] == list(expected)
    np.testing.assert_allclose(task.weighted_terms(step).T, list(expected.values()), rtol=1e-12, atol=0.0)
