"""Metrics of episodes obey physics, and count what they say they count."""

import numpy as np
import pytest
from evaluated_tasks import evaluated
from rollouts import SINGLE, rollout_of

from space_envs.dynamics.bodies import body_motion
from space_envs.evaluation.leaderboard.figures import cost_times_duration
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.records.making import episode_records
from space_envs.evaluation.records.metrics import episode_metrics


def test_attitude_cost_is_minus_the_attitude_reward():
    rollout, task = rollout_of("minimum_jerk", reward="sparse")
    metrics = episode_metrics(rollout, task)
    captured = np.array([outcome == "captured" for outcome in rollout.outcome])
    # Sparse rewards are the attitude term and ten times the score of a capture, nothing else.
    score = 1.0 / (1.0 + metrics["peak_attitude"])
    np.testing.assert_allclose(rollout.episode_return, 10.0 * score - metrics["attitude_cost"], atol=1e-12)
    assert captured.all()


@pytest.mark.parametrize("name", ["minimum_jerk", "random"])
def test_torques_times_angles_make_the_kinetic_energy(name):
    """The work of torques held over each step is exactly what the robot's kinetic energy gains."""
    rollout, task = rollout_of(name)
    motion = body_motion(task.mechanics, rollout.qpos, rollout.qvel)
    work = (rollout.torque * np.diff(rollout.qpos[..., 7:], axis=1)).sum(axis=-1)
    gained = np.diff(motion.kinetic_energy, axis=1)
    assert gained.max() > 0.01
    np.testing.assert_allclose(work, gained, atol=1e-6)
    metrics = episode_metrics(rollout, task)
    assert (metrics["mechanical_work"] >= np.abs(work.sum(axis=1)) - 1e-9).all()
    assert (metrics["peak_power"] * task.control_period >= np.abs(gained).max(axis=1) - 1e-6).all()
    assert (metrics["linear_momentum_drift"] < 1e-6 * np.abs(motion.linear).max()).all()
    assert (metrics["angular_momentum_drift"] < 1e-6 * np.abs(motion.angular).max()).all()


def test_slowness_makes_a_path_cheap_by_eq_20_and_not_by_cost_times_duration(monkeypatch):
    """The same minimum-jerk paths, planned for 5, 10 and 20 s."""
    costs, products = [], []
    monkeypatch.setattr("agents.policies.single_arm.reaching.DISPLACEMENT", 0.1)  # however fast they are
    for duration in (5.0, 10.0, 20.0):
        monkeypatch.setattr("agents.policies.single_arm.reaching.DURATION", duration)
        rollout, task = rollout_of("minimum_jerk", episodes=4)
        records = episode_records(rollout, task, LeaderboardEntry(evaluated(SINGLE)[0], "mine", "any"), 0)
        assert rollout.outcome.tolist() == ["captured"] * 4
        costs.append([record.metrics["attitude_cost"] for record in records])
        products.append([cost_times_duration(record) for record in records])
    cost, product = np.array(costs), np.array(products)
    np.testing.assert_allclose(cost[1:] / cost[:-1], 0.5, rtol=0.03)
    # What is left is the start and the end of a motion, which the envelope cuts off differently.
    assert (product.max(axis=0) / product.min(axis=0)).max() < 1.15


def test_the_time_to_the_envelope_is_that_of_the_first_state_of_the_hold():
    rollout, task = rollout_of("minimum_jerk", episodes=2)
    records = episode_records(rollout, task, LeaderboardEntry(evaluated(SINGLE)[0], "mine", "any"), 0)
    for row, record in enumerate(records):
        inside = rollout.position_error[row] <= task.envelope.position
        assert (
            record.metrics["time_to_envelope"] is not None and record.metrics["time_to_capture"] is not None
        )
        assert record.metrics["time_to_envelope"] == pytest.approx(
            record.metrics["time_to_capture"] - task.envelope.hold
        )
        assert inside[round(record.metrics["time_to_envelope"] / task.control_period) :].all()


def test_metrics_do_not_count_what_comes_after_the_end():
    rollout, task = rollout_of("gjm")
    assert (rollout.length < task.horizon).all()
    after = np.arange(rollout.torque.shape[1]) >= rollout.length[:, None]
    assert (rollout.torque[after] == 0).all()
    last = rollout.qpos[np.arange(6), rollout.length]
    np.testing.assert_array_equal(rollout.qpos[:, -1], last)
