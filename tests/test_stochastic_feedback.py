"""Stochastic feedback from a ProMP: its moments in closed loop, its gains, its use in MuJoCo."""

import numpy as np
import pytest

from agents.demonstrations.optimal.library import robot_limits
from agents.planners.single_arm.library import library_of
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.promp.demonstrated import DemonstratedPlanner
from agents.policies.single_arm.stochastic_feedback import StochasticFeedback
from benchmarks.stochastic_feedback import DURATION, PERIOD, SETTINGS, computed_torque, simulated_errors
from promp import ProMP, ViaPoint
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array
from space_envs.errors import ConfigurationError
from space_envs.robots.zoo import find_robot
from space_envs.tasks.single_arm import SingleArmTask

ROBOT = find_robot("shyam2020")


def promp_of(scale: float = 1.0) -> ProMP:
    """Two joints, from rest to an end that varies by 0.01 rad, at rest."""
    rng = np.random.default_rng(1)
    directions = 0.3 * rng.standard_normal((20, 20)) / np.sqrt(20)
    promp = ProMP(0.3 * rng.standard_normal((2, 10)), scale**2 * directions @ directions.T)
    start = ViaPoint(0.0, np.zeros(2), np.zeros(2), duration=4.0)
    end = ViaPoint(1.0, np.array([0.5, -0.3]), np.zeros(2), duration=4.0, accuracy=0.01)
    return promp.condition_on([start, end])


def simulated(law: StochasticFeedback, count: int, noisy: bool = True) -> Array:
    """States (K + 1, count, 2 n) of double integrators under the law."""
    rng = np.random.default_rng(0)
    n = law.mean.shape[1]
    position, rate = np.tile(law.state[0], (count, 1)).reshape(count, 2, n).swapaxes(0, 1)
    states = [law.state[0] + np.zeros((count, 2 * n))]
    for step in range(len(law.mean)):
        a = law.acceleration(step, position, rate, rng if noisy else None)
        position = position + law.period * rate + 0.5 * law.period**2 * a
        rate = rate + law.period * a
        states.append(np.concatenate([position, rate], axis=1))
    return np.array(states)


@pytest.mark.parametrize("period", [0.05, 0.02])
def test_closed_loop_has_the_moments_of_the_promp(period: float) -> None:
    promp = promp_of()
    states = simulated(StochasticFeedback.of(promp, 4.0, period), 6000)
    for phase in (0.25, 0.5, 0.75, 0.95):
        mean, covariance = promp.state(phase, 4.0)
        seen = states[round(phase * (len(states) - 1))]
        deviation = np.sqrt(np.diag(covariance))
        assert (np.abs(seen.mean(axis=0) - mean) < 0.06 * deviation + 2e-3).all()
        # In units of standard deviations, so that a small variance counts as much as a large one.
        off = (np.cov(seen.T) - covariance) / np.outer(deviation, deviation)
        assert np.abs(off).max() < 0.09, phase
    assert np.std(states[-1, :, :2], axis=0).max() < 0.03


def test_without_noise_it_runs_along_the_mean() -> None:
    promp = promp_of()
    states = simulated(StochasticFeedback.of(promp, 4.0, 0.02), 1, noisy=False)[:, 0]
    phase = np.linspace(0.0, 1.0, len(states))
    np.testing.assert_allclose(states[:, :2], promp.position(phase), atol=2e-3)
    np.testing.assert_allclose(states[:, 2:], promp.velocity(phase, 4.0), atol=1e-9)


def test_gains_are_the_conditional_expectation_of_the_acceleration() -> None:
    promp, period = promp_of(), 0.05
    law = StochasticFeedback.of(promp, 4.0, period)
    samples = promp.sample(np.random.default_rng(2), 20_000)
    motion = promp.trajectories(samples, np.linspace(0.0, 1.0, 81), 4.0)
    for step in (20, 45, 70):
        state = np.concatenate([motion.position[:, step], motion.velocity[:, step]], axis=1)
        wanted = (motion.velocity[:, step + 1] - motion.velocity[:, step]) / period
        predicted = law.acceleration(step, state[:, :2], state[:, 2:])
        rest = wanted - predicted
        # What is left says nothing more about the state.
        together = np.corrcoef(rest.T, state.T)[:2, 2:]
        assert np.abs(together).max() < 0.04
        assert rest.var() < wanted.var()


def test_noise_of_the_measurement_lowers_gains() -> None:
    promp = promp_of()
    sharp = StochasticFeedback.of(promp, 4.0, 0.05)
    blurred = StochasticFeedback.of(promp, 4.0, 0.05, 0.05, 0.05)
    assert np.linalg.norm(blurred.gain) < 0.7 * np.linalg.norm(sharp.gain)
    np.testing.assert_array_equal(blurred.mean, sharp.mean)
    # Gains do not depend on how much motions vary, only on how.
    narrow = StochasticFeedback.of(promp_of(0.5), 4.0, 0.05)
    assert narrow.gain.shape == sharp.gain.shape == (80, 2, 4)


@pytest.mark.parametrize("changes", [{"period": 0.3}, {"period": -0.1}, {"rate_noise": -1.0}])
def test_bad_settings_are_refused(changes: dict) -> None:
    with pytest.raises(ConfigurationError):
        StochasticFeedback.of(promp_of(), **{"duration": 4.0, "period": 0.1, **changes})


def test_both_laws_bring_the_arm_to_the_goal_in_simulation() -> None:
    task = SingleArmTask()
    goals = task.goals("validation", np.array([2]))
    planner = DemonstratedPlanner(task.mechanics, robot_limits(ROBOT), library_of(ROBOT, True))
    goal = Grapple.at_rest(goals.position[0], goals.quaternion[0])
    reach = Reach(task.mechanics.home, goal, keep_attitude=True)
    reach = reach.checked(task.mechanics)
    space, bounds, _ = planner.planner.setting(reach)
    promp = planner.distributions(reach, space, bounds).found[0].promp
    law = StochasticFeedback.of(promp, DURATION, PERIOD)
    plain = simulated_errors(promp, computed_torque(law, 1.0), reach, SETTINGS[0], 2, 0)
    assert plain.joints < 2e-3
    assert plain.position < 2e-3
    stochastic = simulated_errors(promp, law.acceleration, reach, SETTINGS[0], 2, 0)
    # It lets joints stray, and yet meets the goal.
    assert stochastic.joints > 5.0 * plain.joints
    assert stochastic.position < 2e-3
    assert stochastic.attitude < 0.05
    noisy = simulated_errors(promp, computed_torque(law, 1.0), reach, SETTINGS[1], 2, 0)
    assert noisy.torque > 0.1 > plain.torque
