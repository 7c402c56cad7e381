"""Policy promp_feedback: the control law of the learned distribution, on the leaderboard's terms."""

import numpy as np
import pytest
from rollouts import rollout_of

from agents.policies.registry import policies_for
from agents.policies.single_arm.promp_feedback import PrompFeedback
from reproduce.shyam2020.cases import context, goal
from reproduce.shyam2020.feedback import simulate, simulate_law, spread_ratio
from space_envs.envs import CaptureVectorEnv

ENV_ID = "SpaceCapture/SingleArm-v0"
PUSH = 0.05  # rad


def test_it_is_a_policy_of_the_single_arm_that_captures() -> None:
    assert "promp_feedback" in policies_for(ENV_ID)
    assert "promp_feedback" not in policies_for("SpaceCapture/DualArmPlanar-v0")
    assert (rollout_of("promp_feedback", split="validation")[0].outcome == "captured").all()


def test_drawn_motions_are_distributed_as_the_promp_and_expected_ones_follow_its_mean() -> None:
    found = simulate_law(goal(-1), seed=0)
    assert found is not None
    assert spread_ratio(found) == pytest.approx(1.0, abs=0.15)
    mean = found.drawn.joints.mean(axis=0)
    # The mean of E samples is off by their spread over the root of E.
    assert np.abs(mean - found.mean).max() < 4 * found.spread.max() / np.sqrt(len(found.drawn.cost))
    assert np.abs(found.expected.joints[0] - found.mean).max() < 5e-3
    # The law brings the end-effector to the goal, nearer than tracking of the same plan does.
    error = found.expected.position_error[0]
    assert error < 1e-3 and error < found.followed.position_error[0]
    assert found.drawn.position_error.max() < 0.05
    other = simulate(goal(-1), PrompFeedback, 1, 2, deterministic=False)
    assert np.abs(other.joints - found.drawn.joints[:2]).max() > 0.01  # drawn from the seed


def test_a_push_is_taken_back_as_the_distribution_narrows() -> None:
    """The law in closed loop with joints that do what they are asked, from beside the mean at mid-motion."""
    at = context()
    envs = CaptureVectorEnv(ENV_ID, 1)
    observation, _ = envs.reset(options={"split": "validation", "index": 0})
    envs.close()
    policy = PrompFeedback(at, 0)
    _, plan = policy.predict(observation, None, np.array([True]))
    place, speed = (at.layout.slices[name] for name in ("joint_position", "joint_velocity"))
    last, middle = plan.position.shape[1] - 1, 40
    moved = observation.copy()
    moved[:, place], moved[:, speed] = plan.position[:, middle] + PUSH, plan.rate[:, middle]
    for step in range(middle, last):
        moved[:, at.layout.slices["time"]] = step * at.control_period
        rate = policy.rates(moved, plan)
        moved[:, place] += 0.5 * at.control_period * (moved[:, speed] + rate)
        moved[:, speed] = rate
    assert np.abs(moved[:, place] - plan.position[:, last]).max() < 0.15 * PUSH
    # Without feedback, what the plan's accelerations alone would do, all of it would be left.
    coast = 0.5 * at.control_period * (plan.rate[:, middle:-1] + plan.rate[:, middle + 1 :]).sum(axis=1)
    np.testing.assert_allclose(plan.position[:, middle] + coast, plan.position[:, last], atol=1e-9)
