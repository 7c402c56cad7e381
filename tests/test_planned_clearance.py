"""Planners and obstacles: clear motions, or typed failures."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from agents.planners.common.plans import Cause, Failure
from agents.policies.dual_arm.reactionless import PlannerInput, ReactionlessZetaZero
from agents.policies.registry import make_policy
from agents.policies.single_arm.nmpc.policy import CHECK_PERIOD
from space_envs.envs import CaptureVectorEnv
from space_envs.evaluation.play.playing import roll_out
from space_envs.policy import PolicyContext

SINGLE, PLANAR = "SpaceCapture/SingleArm-v0", "SpaceCapture/DualArmPlanar-v0"
CLUTTERED = "SpaceCapture/SingleArmCluttered-v0"
N = 64


def begun(env_id: str, n: int, indices: Any = None) -> tuple[CaptureVectorEnv, PolicyContext, Any]:
    """An environment on hard validation goals, its context and the first observations."""
    env = CaptureVectorEnv(env_id, n, difficulty="hard", autoreset_mode="disabled")
    indices = np.arange(n) if indices is None else indices
    observation, _ = env.reset(seed=0, options={"split": "validation", "index": indices})
    return env, PolicyContext.from_env(env), observation


def outcomes(env: CaptureVectorEnv, policy: Any, observation: Any) -> Any:
    """How episodes that have begun end under a policy."""
    state, info = None, {}
    for _ in range(env.task.horizon):
        action, state = policy.predict(observation, state)
        observation, *_, info = env.step(action)
        if (info["outcome"] != "running").all():
            break
    return info["outcome"]


@pytest.mark.parametrize("name", ["minimum_jerk", "promp_mean"])
def test_motions_through_the_satellite_are_replanned(name: str) -> None:
    _, context, observation = begun(SINGLE, N)
    assert context.contacts is not None
    blind = make_policy(name, replace(context, contacts=None), 0)
    naive = blind.predict(observation)[1]
    points = context.contacts.points(context.arm, naive.position)
    touching = np.flatnonzero(context.contacts.satellite_gaps(points).min(axis=(1, 2)) <= 0.0)
    assert 0 < len(touching) < 10
    env, context, observation = begun(SINGLE, len(touching), touching)
    assert (
        outcomes(env, make_policy(name, replace(context, contacts=None), 0), observation) == "collision"
    ).all()
    env, context, observation = begun(SINGLE, len(touching), touching)
    policy = make_policy(name, context, 0)
    plan = policy.predict(observation)[1]
    ended = outcomes(env, policy, observation)
    assert not (ended == "collision").any() and (ended == "captured").any()
    for row, failure in enumerate(plan.failures):
        assert (ended[row] == "captured") == (failure is None)
    # A row's plan does not depend on the rows beside it.
    alone = make_policy(name, context, 0).predict(observation[:1])[1]
    np.testing.assert_array_equal(alone.position[0], plan.position[0])


@pytest.mark.parametrize("name", ["minimum_jerk", "mpc", "promp", "promp_optimal", "promp_demonstrated"])
def test_without_a_clear_motion_the_arm_rests_with_a_failure(name: str) -> None:
    env, context, observation = begun(SINGLE, 2)
    assert context.contacts is not None
    satellite = replace(context.robot.satellite, box=(1.2, 1.2, 1.2))  # the elbow is within
    context = replace(
        context, contacts=replace(context.contacts, robot=replace(context.robot, satellite=satellite))
    )
    policy = make_policy(name, context, 0)
    action, state = policy.predict(observation)
    np.testing.assert_allclose(action, 0.0, atol=1e-12)
    for failure in state.failures:
        assert failure.cause == Cause.CLEARANCE == "clearance"
        assert "from the satellite at t = " in failure.reason and failure.reason.startswith("link ")
    for _ in range(110):  # after the time of the motion too
        observation, *_ = env.step(action)
        action, state = policy.predict(observation, state)
        np.testing.assert_allclose(action, 0.0, atol=1e-9)


@pytest.mark.parametrize("name", ["minimum_jerk", "mpc", "promp_mean", "promp", "promp_optimal"])
def test_among_spheres_planners_capture_or_name_the_obstacle(name: str) -> None:
    rollout = roll_out(
        lambda context: make_policy(name, context, 0), {"env_id": CLUTTERED}, "validation", np.arange(12), 0
    )
    assert "collision" not in rollout.outcome
    for outcome, cause, reason in zip(rollout.outcome, rollout.cause, rollout.reason, strict=True):
        if outcome != "captured":  # the record says why
            assert cause == "clearance" and reason is not None
            assert "obstacle" in reason or "satellite" in reason
    if name in ("promp", "promp_optimal"):  # which have others to choose from
        assert rollout.outcome.tolist().count("captured") >= 6


def test_spheres_count_where_they_are_and_not_where_nothing_ends_an_episode() -> None:
    """A sphere that is moved onto the way of a planned motion is what the refusal names."""
    env = CaptureVectorEnv(CLUTTERED, 1, autoreset_mode="disabled")
    observation, _ = env.reset(options={"split": "validation", "index": np.array([0])})
    context = PolicyContext.from_env(env)
    away = context.layout.slices["obstacle_position"]
    observation[:, away] = 9.0  # far from everything
    policy = make_policy("minimum_jerk", context, 0)
    plan = policy.predict(observation)[1]
    assert plan.failures[0] is None
    tip = context.layout.read(observation, "goal_position")[0]  # where every motion ends
    observation[0, away] = [9.0, 9.0, 9.0, *tip, 9.0, 9.0, 9.0]
    assert policy.predict(observation)[1].failures[0].reason.split(" m from ")[1].startswith("obstacle 2")
    blind = make_policy("minimum_jerk", replace(context, contacts=None), 0)
    assert blind.predict(observation)[1].failures[0] is None


def test_nmpc_brakes_before_an_obstacle_and_continues_without_it() -> None:
    env, context, observation = begun(SINGLE, 1)
    policy = make_policy("nmpc", context, 0)
    action, state = policy.predict(observation)
    observation, *_ = env.step(action)
    for _ in range(round(CHECK_PERIOD / context.control_period) - 1):
        action, state = policy.predict(observation, state)
        observation, *_ = env.step(action)
    assert context.contacts is not None and action.any() and state.failures[0] is None
    satellite = replace(context.robot.satellite, box=(1.2, 1.2, 1.2))  # every motion is within
    large_context = replace(
        context, contacts=replace(context.contacts, robot=replace(context.robot, satellite=satellite))
    )
    action, braking = make_policy("nmpc", large_context, 0).predict(observation, state)
    failure = braking.failures[0]
    assert not action.any() and failure.cause == Cause.CLEARANCE
    assert "from the satellite at t = " in failure.reason
    action, state = policy.predict(observation, braking)
    assert action.any() and state.failures[0] is None


def test_reactionless_plans_into_something_are_refused() -> None:
    _, context, observation = begun(PLANAR, 8)
    policy = ReactionlessZetaZero(context, 0)
    tasks = policy.inputs(observation)
    plans = [(task, policy.plan(task)) for task in tasks]
    found = [(task, plan) for task, plan in plans if not isinstance(plan, Failure)]
    kept = [(task, plan) for task, plan in found if task.checked(plan) is plan]
    assert kept
    task, plan = kept[0]
    hand = context.arm.end_effector_pose(plan.sample(np.array(10.0))[0], 0)[0]
    moved = PlannerInput(**{**vars(task), "centre": hand})  # a target in the way at half time
    refused = moved.checked(plan)
    assert isinstance(refused, Failure) and refused.cause == Cause.CLEARANCE
    assert refused.reason.startswith("an arm and the target would come to -")
