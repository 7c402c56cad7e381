"""Paths of one arm in the reaction null space, checked by code that shares nothing with their planner."""

from dataclasses import replace
from typing import get_args

import numpy as np
import pytest

from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.check import check
from agents.planners.single_arm.library import find_reactionless_library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.reactionless.flow.chain import StepChain
from agents.planners.single_arm.reactionless.flow.series import Series
from agents.planners.single_arm.reactionless.improvement import PATIENT, PathImprover
from agents.planners.single_arm.reactionless.paths import FUNCTIONS, PathSpace
from agents.planners.single_arm.reactionless.planner import ReactionlessPlanner, Timing
from agents.planners.single_arm.reactionless.planner import space_of as paths_of
from agents.policies.single_arm.optimal import reaches
from agents.policies.single_arm.reactionless.policy import PrompReactionless
from agents.policies.single_arm.reactionless.problem import path_limits
from space_envs.codegen import libraries
from space_envs.dynamics import NoCompiledCodeWarning
from space_envs.dynamics.grapples import Grapple
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.policy import PolicyContext
from space_envs.tasks.goals.clutter import satellite_gaps
from tests.moving_goals import assert_intercepted, circling, windowed

ID = "SpaceCapture/SingleArm-v0"
CONTEXT = PolicyContext.from_env(CaptureVectorEnv(ID, 1))
ROBOT, LIMITS = CONTEXT.arm, path_limits(CONTEXT)
LONG = 40.0  # s, enough for every goal of these tests


def reach_of(number: int, duration: float = LONG) -> Reach:
    """A validation goal of medium difficulty."""
    env = CaptureVectorEnv(ID, 1)
    goal = env.task.goals("validation", np.array([number]))
    return Reach(ROBOT.home, Grapple.at_rest(goal.position[0], goal.quaternion[0]), duration).checked(ROBOT)


def space_of(number: int) -> PathSpace:
    return paths_of(ROBOT, reach_of(number))


def weights_of(seed: int) -> np.ndarray:
    return np.random.default_rng(seed).standard_normal((ROBOT.n_joints, FUNCTIONS)) / np.arange(
        1, FUNCTIONS + 1
    )


def test_paths_never_turn_the_base_and_move_it_as_they_say() -> None:
    for seed in range(3):
        path = space_of(seed).samples(weights_of(seed))
        twist = ROBOT.base_twist(path.angle, path.slope)
        assert np.abs(twist[:, 3:]).max() < 1e-12
        np.testing.assert_allclose(twist[:, :3], path.drift, atol=1e-5)


def test_derivatives_by_phase_and_by_weights_are_those_of_differences() -> None:
    space, weights, step = space_of(0), weights_of(0), 1e-6
    path, by = space.sensitive(weights)
    for joint, function in ((0, 0), (2, 3), (6, FUNCTIONS - 1)):
        change = np.zeros_like(weights)
        change[joint, function] = step
        ends = [space.sensitive(weights + sign * change)[0] for sign in (1.0, -1.0)]
        for name in ("angle", "slope", "curve", "shift", "miss"):
            expected = (getattr(ends[0], name) - getattr(ends[1], name)) / (2.0 * step)
            found = getattr(by, name)[..., function * ROBOT.n_joints + joint]
            np.testing.assert_allclose(found, expected, atol=1e-6, err_msg=name)
    fine = space.samples(weights)
    phase = np.linspace(0.0, 1.0, len(fine.angle))
    for value, slope in ((fine.angle, fine.slope), (fine.slope, fine.curve)):
        middle = np.gradient(value, phase, axis=0, edge_order=2)
        assert np.abs(middle - slope).max() < 0.02 * np.abs(slope).max()
    assert np.abs(path.miss - fine.miss).max() < 1e-3  # the search rolls out coarsely


def test_derivatives_of_steps_are_chained_alike_without_a_compiler(monkeypatch: pytest.MonkeyPatch) -> None:
    rng, shape = np.random.default_rng(0), Series.of(FUNCTIONS, 6).points
    transfer = [rng.standard_normal((6, 7, 7)) for _ in range(6)]
    found = StepChain(7, FUNCTIONS, 6)(transfer, shape)
    monkeypatch.setenv("CC", "no-such-compiler")
    libraries.warn_uncompiled.cache_clear()
    with pytest.warns(NoCompiledCodeWarning):
        expected = StepChain(7, FUNCTIONS, 6)(transfer, shape)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("timing", ["latest", "shortest"])
def test_plans_meet_the_goal_and_keep_every_limit_between_their_nodes(timing: Timing) -> None:
    planner = ReactionlessPlanner(ROBOT, LIMITS, timing=timing)
    for number in (1, 5):
        reach = reach_of(number)
        plan = planner.plan(reach)
        assert isinstance(plan, ReachPlan)
        assert plan.time[-1] == LONG if timing == "latest" else plan.time[-1] < 0.75 * LONG
        found = check(CONTEXT.model, ROBOT, reach, LIMITS.limits, plan)
        assert np.rad2deg(found.violation["peak_attitude"]) < 1e-4
        assert found.violation["position_error"] < 1e-5 and found.violation["rotation_error"] < 1e-5
        for name in ("start", "end_rate"):
            assert found.violation[name] < 1e-9
        for name in ("position", "rate", "acceleration", "torque", "coriolis"):
            assert found.violation[name] < 1e-3, name
        assert found.cost == pytest.approx(plan.cost, rel=1e-3)
        assert satellite_gaps(CONTEXT.robot, plan.sample(np.linspace(0.0, LONG, 300))[0]).min() > 0.0


def test_slopes_of_limits_are_those_of_differences() -> None:
    """At the ends of the steps and between them, of limits that the path violates and of those it keeps."""
    space, weights, step = space_of(0), weights_of(2), 1e-6
    way = weights_of(3)
    rollout = space.rollout(weights)
    by = space.sensitivities(rollout)
    dense = [space.rollout(weights + sign * step * way).dense for sign in (1.0, -1.0)]
    rows = LIMITS.rows(space, 17.0)
    assert len(rows) == 6  # ranges, rates, accelerations, torques, those of rates alone, and the satellite
    for kind in rows:
        at = np.nonzero(np.abs(kind.excess(rollout.dense)) > 0.02)
        expected = (kind.excess(dense[0])[at] - kind.excess(dense[1])[at]) / (2.0 * step)
        found = kind.slopes(rollout.dense, by, at) @ way.T.ravel()
        # Values have corners, where a joint turns back or another side or edge comes nearest.
        wrong = np.abs(found - expected) > 1e-4 * (1.0 + np.abs(expected))
        assert len(wrong) > 50 and wrong.mean() < 0.02, type(kind).__name__


def test_limits_of_torques_that_bind_are_kept() -> None:
    reach, library = reach_of(5, 19.0), find_reactionless_library(CONTEXT.robot)
    weak = replace(LIMITS.limits, torque=0.15 * np.asarray(LIMITS.limits.torque))
    used = []
    for limits in (LIMITS, replace(LIMITS, limits=weak)):
        plan = ReactionlessPlanner(ROBOT, limits, library, candidates=4).plan(reach)
        assert isinstance(plan, ReachPlan)
        excess = check(CONTEXT.model, ROBOT, reach, weak, plan).violation
        used.append(1.0 + excess["torque"] / weak.torque.max())
        assert max(excess[name] for name in ("position", "rate", "acceleration", "coriolis")) < 1e-3
    assert used[0] > 1.5 and 0.9 < used[1] < 1.001


def test_moving_grapples_are_met_without_turning_the_base() -> None:
    """At a given time, and at one that the planner chooses."""
    planner = ReactionlessPlanner(ROBOT, LIMITS, find_reactionless_library(CONTEXT.robot))
    for reach in (circling(1, 19.0), windowed(circling(0, 19.0), 18.0, 22.0)):
        plan = planner.plan(reach)
        assert isinstance(plan, ReachPlan)
        found = check(CONTEXT.model, ROBOT, reach, LIMITS.limits, plan)
        assert_intercepted(reach, plan, found)
        assert np.rad2deg(found.violation["peak_attitude"]) < 1e-4
        assert found.cost == pytest.approx(plan.cost, rel=1e-2)
        for name in ("position", "rate", "acceleration", "torque", "coriolis"):
            assert found.violation[name] < 1e-3, name
        earliest, latest = reach.window or (19.0, 19.0)
        assert earliest - 1e-9 <= plan.time[-1] <= latest + 1e-9
    still = windowed(reach_of(5), 30.0, LONG)
    plan = planner.plan(still)
    assert isinstance(plan, ReachPlan) and plan.time[-1] == LONG


def test_twists_of_the_end_effector_have_the_derivatives_of_differences() -> None:
    space, weights, step = space_of(0), weights_of(0), 1e-6
    path, by = space.sensitive(weights)
    twist, by_angle, by_slope = space.end_twist(path)
    slope = by_angle @ by.angle[path.end] + by_slope @ by.slope[path.end]
    q, rate = path.angle[-1], path.slope[-1]
    np.testing.assert_allclose(twist, ROBOT.generalized_jacobian(q) @ rate, atol=1e-9)
    for number in (0, 20, 69):
        change = np.zeros(weights.size)
        change[number] = step
        moved = change.reshape(FUNCTIONS, -1).T
        ends = [space.end_twist(space.sensitive(weights + sign * moved)[0])[0] for sign in (1.0, -1.0)]
        np.testing.assert_allclose(slope[:, number], (ends[0] - ends[1]) / (2.0 * step), atol=1e-6)


def test_a_later_arrival_disturbs_the_base_less() -> None:
    planner = ReactionlessPlanner(ROBOT, LIMITS)
    costs = [planner.plan(reach_of(5, duration)).cost for duration in (LONG, 2.0 * LONG)]
    assert costs[1] < 0.55 * costs[0]


def test_what_cannot_be_planned_is_a_failure_with_its_reason() -> None:
    planner = ReactionlessPlanner(ROBOT, LIMITS, random=4)
    reach = reach_of(5)
    far = replace(reach, goal=Grapple.at_rest(np.array([50.0, 0.0, 0.0]), reach.end.quaternion))
    moving = replace(reach, rate=np.full(7, 0.02))
    hasty = replace(reach, duration=2.0)
    expected = [(far, Cause.OUT_OF_REACH, "reaches"), (moving, Cause.INFEASIBLE, "at rest")]
    expected += [(hasty, Cause.INFEASIBLE, "there are 2.0 s")]
    for asked, cause, words in expected:
        failure = planner.plan(asked)
        assert isinstance(failure, Failure)
        assert failure.cause is cause and words in failure.reason
    with pytest.raises(ConfigurationError, match="Did you mean 'shortest'"):
        ReactionlessPlanner(ROBOT, LIMITS, timing="shorter")  # pyright: ignore[reportArgumentType]


def played(numbers: np.ndarray, scales: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Captures and peak attitudes (K,), deg, by MuJoCo, with masses of the satellite scaled."""
    count = len(numbers)
    env = CaptureVectorEnv(ID, count, autoreset_mode="disabled")
    policy = PrompReactionless(PolicyContext.from_env(env))
    rows, state, start = np.arange(count), None, None
    observation, _ = env.reset(options={"split": "validation", "index": numbers})
    env.simulation.scale_base(rows, scales)
    env.simulation.refresh(rows)
    env.drive.reset(rows)
    running, peak, captured = np.ones(count, dtype=bool), np.zeros(count), np.zeros(count, dtype=bool)
    while running.any():
        action, state = policy.predict(observation, state, start)
        start = np.zeros(count, dtype=bool)
        observation, _, terminated, truncated, info = env.step(action)
        peak = np.where(running, np.maximum(peak, np.rad2deg(env.task.attitude(observation))), peak)
        captured |= running & (np.array(info["outcome"]) == "captured")
        running &= ~(terminated | truncated)
    return captured, peak


def test_captures_turn_the_satellite_by_hardly_anything_whatever_its_mass() -> None:
    """The planner knows neither the drives nor the masses."""
    captured, peak = played(np.repeat([5, 8], 3), np.tile([1.0, 0.9, 1.1], 2))
    assert captured.all()
    assert peak[::3].max() < 1e-3 and peak.max() < 0.02


def test_the_policy_arrives_late_or_as_soon_as_limits_allow() -> None:
    env = CaptureVectorEnv(ID, 1)
    observation, _ = env.reset(options={"split": "validation", "index": np.array([5])})
    context, arrivals = PolicyContext.from_env(env), []
    for timing in get_args(Timing):
        (rate,) = PrompReactionless(context, timing=timing).plans(observation).rate
        arrivals.append(np.flatnonzero(np.abs(rate).max(axis=1) > 1e-9)[-1] * context.control_period)
    assert arrivals[1] < arrivals[0] - 0.5


@pytest.mark.slow
def test_nearly_all_goals_are_captured_without_turning_the_satellite() -> None:
    numbers = np.arange(100)
    captured, peak = played(numbers, np.ones(100))
    assert (captured & (peak < 0.01)).mean() >= 0.97
    captured, peak = played(numbers, np.where(numbers % 2, 0.9, 1.1))
    assert (captured & (peak < 0.15)).mean() >= 0.95


def test_robots_with_too_few_joints_are_refused_with_the_reason() -> None:
    env = CaptureVectorEnv(ID, 1, robot="ur10")
    reasons = PrompReactionless.needs.missing(PolicyContext.from_env(env))
    assert reasons == ["it needs arms of at least 7 joints, those of 'ur10' have 6"]


def test_failures_of_robots_without_a_library_name_the_command_that_makes_it() -> None:
    env = CaptureVectorEnv(ID, 1, robot="panda")
    observation, _ = env.reset(seed=0)
    context = PolicyContext.from_env(env)
    policy = PrompReactionless(context)
    policy.planner = ReactionlessPlanner(context.arm, path_limits(context), random=1)
    (asked,) = reaches(context, observation, keep_attitude=True)
    far = replace(asked, goal=Grapple.at_rest(np.array([50.0, 0.0, 0.0]), asked.end.quaternion))
    found, refused = policy.plan([replace(asked, duration=1.0), far])
    assert isinstance(found, Failure) and isinstance(refused, Failure)
    assert "`python -m agents.demonstrations.reactionless --robot panda` makes" in found.reason
    assert "agents.demonstrations" not in refused.reason


def test_starts_that_lead_nowhere_are_no_plans_and_raise_nothing() -> None:
    improver, space = PathImprover(LIMITS), space_of(0)
    for scale in (30.0, 1e3, 1e200):
        found = improver.least_cost(space, scale * weights_of(1), 1.0, PATIENT)
        assert not found.keeps(1.0)
