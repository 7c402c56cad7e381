"""Reactionless paths around keep-out spheres, checked by the contact code of the task."""

from dataclasses import replace

import numpy as np
import pytest
from cluttered_scenes import ENV_ID, make

from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.library import find_reactionless_library
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.reactionless.clearances import SPHERE_CLEARANCE, SPHERE_SCALE, SphereKeepOut
from agents.planners.single_arm.reactionless.paths import FUNCTIONS
from agents.planners.single_arm.reactionless.planner import ReactionlessPlanner, space_of
from agents.policies.clearance import KeepOut
from agents.policies.single_arm.optimal import reaches
from agents.policies.single_arm.reactionless.policy import PrompReactionless
from agents.policies.single_arm.reactionless.problem import latest_arrival, path_limits
from space_envs.dynamics.rotations import rotate
from space_envs.dynamics.spheres import link_ends, sphere_gaps
from space_envs.policy import PolicyContext

GOALS = np.array([5, 10])  # of the validation split, where the path without spheres is blocked
LONG = 40.0  # s


def problems(numbers: np.ndarray) -> tuple[PolicyContext, KeepOut, list[Reach]]:
    """Context, bodies to keep out of, and problems of some validation goals."""
    env = make(len(numbers))
    observation, _ = env.reset(options={"split": "validation", "index": numbers})
    context = PolicyContext.from_env(env)
    keep_out = KeepOut.of(context, observation)
    assert keep_out is not None
    asked = reaches(context, observation, keep_attitude=True)
    return context, keep_out, [replace(one, duration=latest_arrival(context)) for one in asked]


def test_slopes_of_missing_clearances_are_those_of_differences() -> None:
    context, _, asked = problems(GOALS[:1])
    reach = asked[0].checked(context.arm)
    assert reach.spheres is not None
    wide = reach.spheres + [0.0, 0.0, 0.0, 0.3]  # that links are inside
    keep_out, space = SphereKeepOut(context.arm, wide, reach.link_radius), space_of(context.arm, reach)
    shape, step = (context.arm.n_joints, FUNCTIONS), 1e-6
    weights, way = np.random.default_rng(0).standard_normal((2, *shape)) / np.arange(1, FUNCTIONS + 1)
    rollout = space.rollout(weights)
    values = keep_out.excess(rollout.dense)
    at = np.nonzero(values > 0.0)
    assert len(at[0]) > 20
    slopes = keep_out.slopes(rollout.dense, space.sensitivities(rollout), at)
    moved = [keep_out.excess(space.rollout(weights + sign * step * way).dense)[at] for sign in (1.0, -1.0)]
    np.testing.assert_allclose(slopes @ way.T.ravel(), (moved[0] - moved[1]) / (2.0 * step), atol=1e-5)
    # The values are those of the numpy mathematics of the whole robot.
    path = space.samples(weights)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (len(path.angle), 1))
    gaps = sphere_gaps(link_ends(context.arm, path.angle, path.shift, still), wide, reach.link_radius)
    expected = SPHERE_CLEARANCE - gaps[:: (len(gaps) - 1) // (len(values) - 1)].min()
    assert values.max() * SPHERE_SCALE == pytest.approx(expected, abs=1e-3)


def test_plans_are_clear_of_spheres_between_their_nodes_where_shorter_ones_are_not() -> None:
    context, keep_out, asked = problems(GOALS)
    planner = PrompReactionless(context).planner
    for row, reach in enumerate(asked):
        time, own = np.linspace(0.0, reach.duration, 801), keep_out.take(np.array([row]))
        gaps = []
        for spheres in (reach.spheres, None):
            plan = planner.plan(replace(reach, spheres=spheres))
            assert isinstance(plan, ReachPlan)
            q, rate, _ = plan.sample(time)
            assert np.abs(context.arm.base_twist(q, rate)[:, 3:]).max() < 1e-4
            gaps.append(own.gaps(q[None], rate[None], float(time[1])).min())
        assert gaps[0] > 0.004 and gaps[1] < 0.0


def test_goals_in_spheres_and_paths_into_them_are_failures_with_the_reason() -> None:
    context, _, asked = problems(GOALS[:1])
    reach = asked[0]
    library = find_reactionless_library(context.robot)
    planner = ReactionlessPlanner(context.arm, path_limits(context), library, candidates=3, random=1)
    elbow = context.arm.kinematics(reach.start).position[3]
    place, axes = context.arm.end_effector_pose(reach.start)
    wrist = axes.T @ (context.arm.kinematics(reach.start).position[-1] - place)  # in the end-effector's frame
    wrist_there = reach.end.position + rotate(reach.end.quaternion, wrist)
    for centre, radius, words in (
        (reach.end.position, 0.1, "at the goal the last link would be -0."),
        (elbow, 0.1, "at the start a link is -0."),
        (wrist_there, 0.02, "too close to a sphere"),
    ):
        failure = planner.plan(replace(reach, spheres=np.array([[*centre, radius]])))
        assert isinstance(failure, Failure) and failure.cause is Cause.CLEARANCE, words
        assert words in failure.reason


def played(numbers: np.ndarray) -> tuple[np.ndarray, np.ndarray, list[Failure | None]]:
    """Outcomes and peak attitudes (K,), deg, by MuJoCo, and failures."""
    env = make(len(numbers))
    observation, _ = env.reset(options={"split": "validation", "index": numbers})
    policy = PrompReactionless(PolicyContext.from_env(env))
    state, peak, running = None, np.zeros(len(numbers)), np.ones(len(numbers), dtype=bool)
    outcome = np.full(len(numbers), "running", dtype=object)
    while running.any():
        action, state = policy.predict(observation, state)
        observation, *_, info = env.step(action)
        peak = np.where(running, np.maximum(peak, np.rad2deg(env.task.attitude(observation))), peak)
        outcome = np.where(running, np.asarray(info["outcome"], dtype=object), outcome)
        running = outcome == "running"
    assert state is not None
    return outcome, peak, list(state.failures)


def test_captures_around_spheres_do_not_turn_the_satellite() -> None:
    outcome, peak, failures = played(GOALS)
    assert failures == [None, None]
    assert (outcome == "captured").all() and peak.max() < 0.01
    assert PrompReactionless.needs.missing(PolicyContext.from_env(make(1))) == [], ENV_ID


@pytest.mark.slow
def test_most_goals_among_spheres_are_captured_and_none_ends_as_a_collision() -> None:
    outcome, peak, failures = played(np.arange(40))
    captured = outcome == "captured"
    assert not (outcome == "collision").any()
    assert (captured & (peak <= 0.01)).mean() >= 0.7
    for one, failure in zip(captured, failures, strict=True):
        assert one or failure is not None
