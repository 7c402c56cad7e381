"""Goals that ask for less than a pose: tasks, records and planners by the keyword `goal`."""

import json
from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from offenders import assert_none

import space_envs  # noqa: F401  (registers the ids)
from agents.commands.choice import experts_for
from agents.commands.evaluate import main as evaluate
from agents.planners.single_arm.check import check
from agents.planners.single_arm.library import library_of
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.policies.registry import make_policy
from agents.policies.single_arm.optimal import drive_limits
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import exponential, from_matrix, multiply, rotate, to_matrix, z_axis
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.evaluation.records.episode import RECORDS, EpisodeRecord
from space_envs.policy import PolicyContext
from space_envs.registration import make_task
from space_envs.tasks.goals.kinds import (
    GOAL_KINDS,
    asked_attitude,
    asked_jacobian,
    goal_angle,
    rotation_to_goal,
)
from space_envs.tasks.single_arm import SingleArmTask
from space_envs.wrappers import GoalConditioned

ID = "SpaceCapture/SingleArm-v0"
ARM = SingleArmTask().mechanics
FREE = ("axis", "position")
seeds = st.integers(0, 2**32 - 1)


def drawn(rng: np.random.Generator, *shape: int) -> Any:
    """Random unit quaternions (*shape, 4)."""
    q = rng.standard_normal((*shape, 4))
    return q / np.linalg.norm(q, axis=-1, keepdims=True)


def unasked(kind: str, rng: np.random.Generator, *shape: int) -> Any:
    """Random rotations (*shape, 4) in grapple axes that change nothing that a goal of a kind asks for."""
    return (
        exponential(rng.uniform(-3.0, 3.0, (*shape, 1)) * [0.0, 0.0, 1.0])
        if kind == "axis"
        else drawn(rng, *shape)
    )


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_what_a_goal_does_not_ask_for_changes_nothing(seed):
    rng = np.random.default_rng(seed)
    now, goal = drawn(rng, 2, 8)
    for kind in FREE:
        other = multiply(goal, unasked(kind, rng, 8))
        np.testing.assert_allclose(
            rotation_to_goal(kind, now, other), rotation_to_goal(kind, now, goal), atol=1e-12
        )
        np.testing.assert_allclose(asked_attitude(kind, other), asked_attitude(kind, goal), atol=1e-9)
        assert goal_angle(kind, now, asked_attitude(kind, now)).max() < 1e-7
    assert (rotation_to_goal("position", now, goal) == 0.0).all()


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_the_rotation_to_a_goal_leads_to_it_by_the_smaller_angle(seed):
    rng = np.random.default_rng(seed)
    now, goal = drawn(rng, 2, 8)
    turned = multiply(exponential(rotation_to_goal("axis", now, goal)), now)
    np.testing.assert_allclose(z_axis(turned), z_axis(goal), atol=1e-12)
    np.testing.assert_allclose(z_axis(goal), to_matrix(goal)[..., 2], atol=1e-14)
    angle = np.arccos(np.clip((z_axis(now) * z_axis(goal)).sum(axis=-1), -1.0, 1.0))
    np.testing.assert_allclose(goal_angle("axis", now, goal), angle, atol=1e-7)
    np.testing.assert_allclose(rotate(asked_attitude("axis", goal), np.array([0.0, 0.0, 1.0])), z_axis(goal))


def test_asked_rows_are_the_derivatives_of_what_is_asked():
    rng, step = np.random.default_rng(1), 1e-6
    q = ARM.home + rng.uniform(-0.5, 0.5, 7)
    _, jacobian = ARM.end_effector_jacobians(q)
    axis = ARM.end_effector_pose(q)[1][:, 2]
    rows = asked_jacobian("axis", jacobian, axis)
    for joint in range(7):
        moved = q + step * np.eye(7)[joint]
        change = (ARM.end_effector_pose(moved)[1][:, 2] - axis) / step
        np.testing.assert_allclose(np.cross(axis, change), rows[3:, joint], atol=1e-5)
    assert np.linalg.matrix_rank(rows) == 5
    assert np.linalg.matrix_rank(asked_jacobian("position", jacobian, axis)) == 3


@pytest.mark.parametrize("kind", FREE)
def test_errors_rewards_and_captures_ignore_what_is_not_asked(kind):
    rng, home = np.random.default_rng(0), ARM.end_effector_pose(ARM.home)
    position = home[0] + np.array([0.02, 0.0, 0.0])
    quaternion = drawn(rng)
    seen = []
    for _ in range(3):
        env = gym.make(ID, goal=kind)
        options = {"goal_position": position, "goal_quaternion": quaternion}
        observation, _ = env.reset(seed=0, options=options)
        task, rewards, outcome = env.unwrapped.task, [], ""
        for _ in range(12):
            observation, reward, _, _, info = env.step(np.zeros(7, dtype=np.float32))
            rewards.append(reward)
            outcome = info["outcome"]
        seen.append((*task.errors(observation[None]), rewards))
        assert outcome == ("captured" if kind == "position" else "running")
        quaternion = multiply(quaternion, unasked(kind, rng))
    for other in seen[1:]:
        for one, two in zip(seen[0], other, strict=True):
            np.testing.assert_allclose(one, two, atol=1e-9)


def test_an_axis_goal_is_captured_at_any_rotation_about_its_axis():
    position, axes = ARM.end_effector_pose(ARM.home)
    for angle in (0.0, 1.0, np.pi):
        env = gym.make(ID, goal="axis")
        quaternion = multiply(from_matrix(axes), exponential(np.array([0.0, 0.0, angle])))
        env.reset(seed=0, options={"goal_position": position, "goal_quaternion": quaternion})
        info: dict[str, Any] = {}
        for _ in range(11):
            info = env.step(np.zeros(7, dtype=np.float32))[4]
        assert info["outcome"] == "captured"


def test_the_keyword_is_checked_and_changes_neither_goals_nor_spaces():
    tasks = {kind: make_task(ID, {"goal": kind}) for kind in GOAL_KINDS}
    for kind, task in tasks.items():
        assert (task.layout.size, task.layout.slices) == (
            tasks["pose"].layout.size,
            tasks["pose"].layout.slices,
        )
        goals = [t.goals("test", np.arange(3)).quaternion for t in (task, tasks["pose"])]
        np.testing.assert_array_equal(*goals)
        optional = task.goal_options["goal_quaternion"].default is not None
        assert optional == (kind == "position")
    with pytest.raises(ConfigurationError, match="unknown kind of goal 'axes'.*Did you mean 'axis'"):
        gym.make(ID, goal="axes")
    with pytest.raises(ConfigurationError, match="goal_position needs goal_quaternion too"):
        gym.make(ID, goal="axis").reset(options={"goal_position": np.ones(3)})
    env = gym.make(ID, goal="position")
    env.reset(options={"goal_position": ARM.end_effector_pose(ARM.home)[0]})


def test_goals_for_hindsight_hold_what_is_asked():
    for kind, size in zip(GOAL_KINDS, (7, 6, 3), strict=True):
        env = GoalConditioned(gym.make(ID, goal=kind))
        observation, _ = env.reset(seed=0)
        assert env.observation_space.contains(observation)
        assert observation["desired_goal"].shape == (size,)
        rng = np.random.default_rng(0)
        quaternion = env.unwrapped.task.layout.read(observation["observation"], "goal_quaternion")
        if kind == "axis":
            turned = multiply(quaternion, unasked(kind, rng))
            np.testing.assert_allclose(observation["desired_goal"][3:], z_axis(turned), atol=1e-12)
        same = env.compute_reward(observation["desired_goal"], observation["desired_goal"], {})
        assert same == 0.0


@pytest.mark.parametrize("keep", [False, True])
def test_plans_for_less_than_a_pose_cost_less_and_ignore_what_is_not_asked(keep):
    """Ends, limits and costs as the independent check measures them; optima are local: costs are summed."""
    context = PolicyContext.from_env(CaptureVectorEnv(ID))
    goals, limits = SingleArmTask().goals("validation", np.arange(6)), drive_limits(context)
    planner = OptimalPlanner(ARM, limits, library_of(context.robot, keep))
    rng, costs = np.random.default_rng(3), []
    for kind in GOAL_KINDS:
        for position, quaternion in zip(goals.position, goals.quaternion, strict=True):
            reach = Reach(ARM.home, Grapple.at_rest(position, quaternion), keep_attitude=keep, kind=kind)
            plan = measured(planner, limits, reach.checked(ARM))
            costs.append(plan.cost)
            if kind == "pose":
                continue
            other = Grapple.at_rest(position, multiply(quaternion, unasked(kind, rng)))
            same = measured(planner, limits, replace(reach, goal=other).checked(ARM))
            assert same.cost == pytest.approx(plan.cost, rel=1e-3)
    pose, axis, place = np.reshape(costs, (3, 6)).sum(axis=1)
    assert place < axis < pose


def measured(planner: Any, limits: Any, reach: Reach) -> ReachPlan:
    """A plan that was checked."""
    plan = planner.plan(reach)
    assert isinstance(plan, ReachPlan)
    plan = check(SingleArmTask().model, ARM, reach, limits, plan)
    assert ("rotation_error" in plan.violation) == (reach.kind != "position")
    assert plan.violation["position_error"] < 1e-3
    assert plan.violation.get("rotation_error", 0.0) < 1e-3
    assert not reach.keep_attitude or plan.violation["end_attitude"] < 1e-3
    for name in ("position", "rate", "acceleration", "torque"):
        assert plan.violation[name] < 1e-2
    return plan


@pytest.mark.parametrize("kind", FREE)
def test_every_planner_captures_and_ignores_what_is_not_asked(kind):
    """Two episodes of one goal, which is rotated in one of them as the kind allows."""
    goals, rng = SingleArmTask().goals("validation", np.arange(1)), np.random.default_rng(2)
    quaternion = np.concatenate([goals.quaternion, multiply(goals.quaternion, unasked(kind, rng, 1))])
    options = {"goal_position": goals.position[0], "goal_quaternion": quaternion}
    failed = []
    for name in experts_for(ID, keywords={"goal": kind}):
        env = CaptureVectorEnv(ID, 2, goal=kind, autoreset_mode="disabled")
        policy, state = make_policy(name, PolicyContext.from_env(env), 0), None
        observation, _ = env.reset(seed=0, options=options)
        captured = np.zeros(2, dtype=bool)
        for _ in range(env.task.horizon):
            action, state = policy.predict(observation, state)
            observation, _, terminated, truncated, info = env.step(action)
            captured |= info["outcome"] == "captured"
            if (terminated | truncated).all():
                break
        angles = env.task.layout.read(observation, "joint_position")
        if not captured.all() or np.abs(angles[1] - angles[0]).max() > 0.01:
            failed.append(f"{name}: {captured}, {angles}")
    assert_none(failed)


def test_records_and_tables_name_the_kind(tmp_path, capsys):
    folders = [tmp_path / kind for kind in ("pose", "axis")]
    arguments = [
        "--policy",
        "gjm",
        "--episodes",
        "1",
        "--split",
        "validation",
        "--no-pictures",
        "--jobs",
        "1",
    ]
    for folder in folders:
        assert evaluate([*arguments, "--goal", folder.name, "--output", str(folder)]) == 0
    pose, axis = (json.loads((folder / RECORDS).read_text()) for folder in folders)
    assert "goal" not in pose
    assert (axis["goal"], axis["captured"]) == ("axis", True)
    assert EpisodeRecord.from_dict(axis).entry.task.keywords(SingleArmTask().robot)["goal"] == "axis"
    assert "goal axis" in capsys.readouterr().out
    assert evaluate([*arguments, "--goal", "axes", "--output", str(tmp_path / "other")]) == 2
    assert "Did you mean 'axis'" in capsys.readouterr().err
    dual = ["--env", "SpaceCapture/DualArmPlanar-v0", "--goal", "axis", "--output", str(tmp_path / "other")]
    assert evaluate(dual) == 2
    assert "DualArmPlanar-v0 has one kind of goals" in capsys.readouterr().err
