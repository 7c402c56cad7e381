"""Experts: inverse kinematics, the Riccati recursion, and what the policies do in the simulation."""

import dataclasses
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import solve_discrete_are

import space_envs  # noqa: F401  (registers the ids)
from agents.planners.common.damped_search import Rows
from agents.planners.common.inverse_kinematics import (
    JointMotion,
    floating_inverse_kinematics,
    inverse_kinematics,
)
from agents.planners.common.linear_quadratic import (
    closed_loop,
    double_integrator,
    receding_gains,
    riccati_step,
)
from agents.policies.registry import POLICIES, control_mode, knowledge, make_policy
from agents.policies.single_arm.minimum_jerk import MinimumJerk, minimum_jerk_profile
from agents.policies.single_arm.mpc import ModelPredictive
from agents.policies.single_arm.promp import ConditionedPrior, ProMPPolicy, prior_of
from promp import ViaPoint
from space_envs.dynamics import minimum_jerk, roll_out_base, trajectory_cost
from space_envs.dynamics.rotations import Array, angle_between, from_matrix, multiply, rotate
from space_envs.errors import ConfigurationError, PolicyError
from space_envs.policy import Knowledge, PolicyContext, load_policy_class
from space_envs.robots.zoo import find_robot
from space_envs.tasks.common import ObservationLayout
from space_envs.tasks.single_arm import SingleArmTask

PLANNERS = {"minimum_jerk": MinimumJerk, "mpc": ModelPredictive, "promp": ProMPPolicy}
EXPERTS = ("minimum_jerk", "gjm", "mpc", "promp")
ARM = SingleArmTask().mechanics
LIMITS = ARM.range + 0.1 * np.array([1.0, -1.0])


def make(n: int = 1, **keywords: Any) -> Any:
    """A vector environment on the validation goals, whose episodes freeze when they end."""
    keywords = {"split": "validation", "autoreset_mode": "disabled"} | keywords
    return gym.make_vec("SpaceCapture/SingleArm-v0", num_envs=n, **keywords)


def begin(env: Any, **options: Any) -> Array:
    return env.reset(seed=0, options={"index": np.arange(env.num_envs), **options})[0]


@pytest.fixture(scope="module")
def observed() -> tuple[PolicyContext, Array]:
    """The context and the first observations of 16 episodes."""
    env = make(16)
    return PolicyContext.from_env(env), begin(env)


def inertial_pose(motion: JointMotion) -> tuple[Array, Array]:
    """End-effector pose at the end of motions from the initial base pose."""
    positions, quaternions = roll_out_base(ARM, motion.position, motion.velocity, motion.dt)
    local, rotation = ARM.end_effector_pose(motion.position[:, -1])
    base = quaternions[:, -1]
    return positions[:, -1] + rotate(base, local), multiply(base, from_matrix(rotation))


# Inverse kinematics


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.05, 1.2))
def test_inverse_kinematics_reaches_what_can_be_reached(seed: int, radius: float) -> None:
    rng = np.random.default_rng(seed)
    home = np.tile(ARM.home, (8, 1))
    q = home + rng.uniform(-radius, radius, home.shape)
    position, rotation = ARM.end_effector_pose(q)
    quaternion = from_matrix(rotation) * rng.choice([-1.0, 1.0], (8, 1))  # either sign is the same pose
    found = inverse_kinematics(ARM, position, quaternion, home, LIMITS)
    at, turned = ARM.end_effector_pose(found.position)
    np.testing.assert_allclose(np.linalg.norm(at - position, axis=1), found.position_residual, atol=1e-9)
    np.testing.assert_allclose(
        angle_between(from_matrix(turned), quaternion), found.orientation_residual, atol=1e-7
    )
    assert (found.position >= LIMITS[:, 0]).all() and (found.position <= LIMITS[:, 1]).all()
    # Reported as it is, row by row; and a pose that exists is nearly always found.
    within = (found.position_residual < 2e-5) & (found.orientation_residual < 2e-5)
    assert (found.converged == within).all()
    assert found.converged.sum() >= 7
    # The redundancy is drawn home: most solutions are nearer to it than what the poses were made from.
    distance, before = (np.linalg.norm(x - home, axis=1) for x in (found.position, q))
    assert np.median((distance - before)[found.converged]) <= 0.1


def test_inverse_kinematics_respects_limits_and_reports_the_unreachable() -> None:
    home = ARM.home[None]
    q = home + 0.5
    position, rotation = ARM.end_effector_pose(q)
    tight = np.stack([ARM.home - 0.2, ARM.home + 0.2], axis=1)
    for limits, place in ((tight, position), (LIMITS, position + 20.0)):
        found = inverse_kinematics(ARM, place, from_matrix(rotation), home, limits)
        assert not found.converged.any()
        assert (found.position >= limits[:, 0]).all() and (found.position <= limits[:, 1]).all()
        at, _ = ARM.end_effector_pose(found.position)
        np.testing.assert_allclose(np.linalg.norm(at - place), found.position_residual[0], atol=1e-9)
    # With one joint stuck at its limit the six others do the work.
    stuck = LIMITS.copy()
    stuck[0] = ARM.home[0] - 0.1, ARM.home[0] + 0.1
    found = inverse_kinematics(ARM, *_pose(home + 0.3), home, stuck)
    assert found.converged.all() and abs(found.position[0, 0] - ARM.home[0]) <= 0.1


def _pose(q: Array) -> tuple[Array, Array]:
    position, rotation = ARM.end_effector_pose(q)
    return position, from_matrix(rotation)


def test_goals_are_met_where_the_base_really_ends() -> None:
    goals = SingleArmTask(difficulty="hard").goals("validation", np.arange(64))
    start = np.tile(ARM.home, (64, 1))
    still = np.zeros((64, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (64, 1))

    def motion(goal: Array, rows: Rows) -> JointMotion:
        return JointMotion(*minimum_jerk(start[rows], goal, 10.0, 101))

    found = floating_inverse_kinematics(ARM, goals.position, goals.quaternion, motion, *still, start, LIMITS)
    assert found.converged.all()
    # Seen by a roll-out four times as fine.
    position, quaternion = inertial_pose(JointMotion(*minimum_jerk(start, found.position, 10.0, 401)))
    assert np.linalg.norm(position - goals.position, axis=1).max() < 1e-4
    assert np.rad2deg(angle_between(quaternion, goals.quaternion)).max() < 0.005
    # The same goals with the base held fixed: this is what the correction is for.
    fixed = inverse_kinematics(ARM, goals.position, goals.quaternion, start, LIMITS)
    position, _ = inertial_pose(motion(fixed.position, np.arange(64)))
    assert np.median(np.linalg.norm(position - goals.position, axis=1)) > 0.1


# The linear-quadratic controller


def weights(rng: np.random.Generator, *batch: int) -> tuple[Array, Array]:
    """Random full cost matrices for three joints."""
    a, b = rng.standard_normal((*batch, 6, 6)), rng.standard_normal((*batch, 3, 3))
    return a @ a.swapaxes(-1, -2) + np.eye(6), b @ b.swapaxes(-1, -2) + np.eye(3)


def test_riccati_with_constant_weights_is_the_stationary_regulator() -> None:
    q, r = weights(np.random.default_rng(0), 4)
    gains, costs = receding_gains(q, r, np.arange(31) * 0.1, ramp=0.0)
    for row in range(4):
        a, b = double_integrator(3, 0.1)
        p = solve_discrete_are(a, b, q[row], r[row])
        stationary = np.linalg.solve(r[row] + b.T @ p @ b, b.T @ p @ a)
        np.testing.assert_allclose(costs[:, row], np.broadcast_to(p, (31, 6, 6)), rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(
            gains[:, row], np.broadcast_to(stationary, (31, 3, 6)), rtol=1e-7, atol=1e-8
        )


def test_cost_to_go_is_the_cost_of_the_simulated_motion() -> None:
    rng = np.random.default_rng(1)
    q, r = weights(rng)
    times = np.arange(41) * 0.1
    gains, costs = receding_gains(q, r, times, ramp=3.0)
    a, b = double_integrator(3, 0.1)
    first = x = rng.standard_normal(6)
    total = 0.0
    for t in range(40):
        u = -gains[t] @ x
        total += (times[t] / times[-1]) ** 3 * x @ q @ x + u @ r @ u
        x = a @ x + b @ u
    np.testing.assert_allclose(first @ costs[0] @ first, total + x @ costs[-1] @ x, rtol=1e-10)
    transition, _ = closed_loop(gains, 0.1)
    np.testing.assert_allclose(transition[-1] @ first, x, atol=1e-12)


def test_one_backward_pass_is_every_steps_receding_horizon() -> None:
    q, r = weights(np.random.default_rng(2))
    times = np.arange(21) * 0.1
    gains, _ = receding_gains(q, r, times, ramp=4.0)
    a, b = double_integrator(3, 0.1)
    for t in (0, 7, 19, 20):
        # A horizon of the whole duration from step t, solved by itself.
        gain, cost = np.zeros((3, 6)), solve_discrete_are(a, b, q, r)
        for k in range(t + 20 - 1, t - 1, -1):
            gain, cost = riccati_step(a, b, min(k / 20, 1.0) ** 4 * q, r, cost)
        np.testing.assert_allclose(gain, gains[t], rtol=1e-8, atol=1e-9)


def test_disturbance_response_is_linear_superposition() -> None:
    rng = np.random.default_rng(3)
    gains, _ = receding_gains(*weights(rng), np.arange(11) * 0.1)
    push = rng.standard_normal((11, 3))
    transition, response = closed_loop(gains, 0.1, push)
    a, b = double_integrator(3, 0.1)
    first = x = rng.standard_normal(6)
    for t in range(10):
        x = a @ x + b @ (push[t] - gains[t] @ x)
    np.testing.assert_allclose(transition[-1] @ first + response[-1], x, atol=1e-12)


def test_minimum_jerk_profile() -> None:
    rng = np.random.default_rng(4)
    start, rate, goal = rng.standard_normal((3, 5, 7))
    profile = minimum_jerk_profile(np.linspace(0.0, 8.0, 2001))
    motion = profile.motion(start, rate, goal)
    np.testing.assert_allclose(motion.position[:, [0, -1]], np.stack([start, goal], axis=1), atol=1e-12)
    np.testing.assert_allclose(motion.velocity[:, [0, -1]], np.stack([rate, 0 * rate], axis=1), atol=1e-12)
    slope = np.gradient(motion.position, motion.dt, axis=1)
    np.testing.assert_allclose(motion.velocity[:, 1:-1], slope[:, 1:-1], atol=1e-4)
    acceleration = np.gradient(motion.velocity, motion.dt, axis=1)
    assert np.abs(acceleration[:, [0, -1]]).max() < 0.02
    resting = profile.motion(start, 0 * rate, goal)
    np.testing.assert_allclose(resting.position, minimum_jerk(start, goal, 8.0, 2001)[0], atol=1e-12)


# Policies in the simulation


def run(env: Any, policy: Any, steps: int) -> tuple[Array, Any]:
    """Observations (steps + 1, N, size) and the last info."""
    observations = [begin(env)]
    state, fresh, info = None, np.ones(env.num_envs, dtype=bool), {}
    for _ in range(steps):
        action, state = policy.predict(observations[-1], state, fresh)
        assert action.shape == env.action_space.shape and np.abs(action).max() <= 1.0
        fresh = np.zeros(env.num_envs, dtype=bool)
        observation, _, terminated, truncated, info = env.step(action)
        observations.append(observation)
        if (terminated | truncated).all():
            break
    return np.stack(observations), info


@pytest.mark.parametrize(
    ("name", "position", "angle"), [("minimum_jerk", 1e-3, 0.05), ("mpc", 1e-3, 0.05), ("promp", 2e-3, 0.1)]
)
def test_planned_motions_end_at_the_goal(name: str, position: float, angle: float) -> None:
    env = make(24, hold_time=50.0)
    observations, _ = run(env, make_policy(name, PolicyContext.from_env(env), 0), 100)
    errors = env.task.errors(observations[-1])  # type: ignore[attr-defined]
    assert errors.position.max() < position
    assert np.rad2deg(errors.orientation).max() < angle


@pytest.mark.parametrize("name", EXPERTS)
def test_experts_capture(name: str) -> None:
    env = make(32)
    _, info = run(env, make_policy(name, PolicyContext.from_env(env), 0), 200)
    assert (info["outcome"] == "captured").all()


def test_resolved_rate_goes_straight_to_the_goal_and_does_not_overshoot() -> None:
    env = make(16, hold_time=50.0)
    observations, _ = run(env, make_policy("gjm", PolicyContext.from_env(env), 0), 160)
    read = env.task.layout.read  # type: ignore[attr-defined]
    errors = read(observations, "position_error")
    distance = np.linalg.norm(errors, axis=-1)
    assert np.diff(distance, axis=0).max() < 1e-4
    assert np.median(distance[-1]) < 5e-3
    # Once under way the end-effector moves along the error, though the base turns under the arm.
    velocity = read(observations, "end_effector_linear_velocity")[10]
    cosine = (velocity * errors[10]).sum(axis=1) / np.linalg.norm(velocity, axis=1) / distance[10]
    assert np.median(cosine) > 0.99


def test_an_unreachable_goal_is_reported_and_the_arm_comes_to_rest() -> None:
    env = make(1, hold_time=50.0)
    far = {"goal_position": np.array([0.0, 2.9, 2.9]), "goal_quaternion": np.array([0.5, 0.5, -0.5, 0.5])}
    observation = env.reset(seed=0, options=far)[0]
    context = PolicyContext.from_env(env)
    for name in PLANNERS:
        policy, state = PLANNERS[name](context), None
        observation = env.reset(seed=0, options=far)[0]
        before = env.task.errors(observation).position[0]  # type: ignore[attr-defined]
        for _ in range(140):
            action, state = policy.predict(observation, state)
            observation = env.step(action)[0]
        assert state is not None
        assert not state.goals.converged[0] and state.goals.position_residual[0] > 0.05
        assert env.task.errors(observation).position[0] < before  # type: ignore[attr-defined]
        assert np.abs(context.layout.read(observation, "joint_velocity")).max() < 1e-2


def test_plans_start_from_any_state(observed: tuple[PolicyContext, Array]) -> None:
    context, _ = observed
    env = make(16)
    rng = np.random.default_rng(5)
    start = context.arm.home + rng.uniform(-0.2, 0.2, (16, 7))
    observation = begin(env, joint_position=start, joint_velocity=rng.uniform(-0.05, 0.05, (16, 7)))
    read = context.layout.read
    for name in PLANNERS:
        motion, goals = PLANNERS[name](context).plan(observation)
        assert goals.converged.all()
        np.testing.assert_allclose(motion.position[:, 0], read(observation, "joint_position"), atol=1e-9)
        np.testing.assert_allclose(motion.velocity[:, 0], read(observation, "joint_velocity"), atol=1e-9)
        np.testing.assert_allclose(motion.position[:, -1], goals.position, atol=2e-4)
        assert np.abs(motion.velocity[:, -1]).max() < 1e-3


@pytest.mark.parametrize("name", PLANNERS)
def test_a_plan_does_not_depend_on_the_other_rows(name: str, observed: tuple[PolicyContext, Array]) -> None:
    context, observation = observed
    policy = PLANNERS[name](context)
    together, goals = policy.plan(observation)
    for row in (0, 7, 15):
        alone, goal = policy.plan(observation[row : row + 1])
        np.testing.assert_array_equal(alone.position[0], together.position[row])
        np.testing.assert_array_equal(alone.velocity[0], together.velocity[row])
        np.testing.assert_array_equal(goal.position[0], goals.position[row])


@pytest.mark.parametrize("name", EXPERTS)
def test_experts_act_on_the_observation_through_its_layout(
    name: str, observed: tuple[PolicyContext, Array]
) -> None:
    context, observation = observed
    expected, _ = make_policy(name, context, 0).predict(observation)
    # The same observation laid out in the opposite order, long after the simulation has gone.
    layout = ObservationLayout(context.layout.fields[::-1])
    turned = np.empty_like(observation)
    for field in layout.fields:
        layout.read(turned, field.name)[:] = context.layout.read(observation, field.name)
    action, _ = make_policy(name, dataclasses.replace(context, layout=layout), 0).predict(turned)
    np.testing.assert_array_equal(action, expected)


def test_only_rows_that_start_are_planned_anew(observed: tuple[PolicyContext, Array]) -> None:
    context, observation = observed
    policy = MinimumJerk(context)
    _, state = policy.predict(observation)
    later = observation[::-1].copy()
    context.layout.read(later, "time")[:] = 3.0
    fresh = np.zeros(16, dtype=bool)
    fresh[[2, 5]] = True
    _, mixed = policy.predict(later, state, fresh)
    _, other = policy.predict(later)
    for row in range(16):
        expected = other if fresh[row] else state
        np.testing.assert_array_equal(mixed.position[row], expected.position[row])
        np.testing.assert_array_equal(mixed.goals.position[row], expected.goals.position[row])
    assert mixed.start.tolist() == np.where(fresh, 3.0, 0.0).tolist()
    assert policy.predict(later, mixed)[1] is mixed
    with pytest.raises(PolicyError, match="start together"):
        policy.predict(later[:4], mixed, np.zeros(4, dtype=bool))
    with pytest.raises(PolicyError, match="shape"):
        policy.predict(later, mixed, np.zeros(4, dtype=bool))


# The ProMP policy


def test_gain_is_that_of_the_primitive(observed: tuple[PolicyContext, Array]) -> None:
    context, _ = observed
    prior, times = prior_of(find_robot("shyam2020")), np.arange(101) * 0.1
    rng = np.random.default_rng(6)
    home, goal = context.arm.home, context.arm.home + rng.uniform(-0.5, 0.5, 7)
    expected = prior.condition_on(
        [ViaPoint(0.0, home, np.zeros(7), duration=10.0), ViaPoint(1.0, goal, np.zeros(7), duration=10.0)]
    )
    conditioned = ConditionedPrior(prior, times)
    mean = conditioned.weights(home[None], np.zeros((1, 7)), goal[None])[0]
    np.testing.assert_allclose(mean, expected.mean, atol=1e-8)
    np.testing.assert_allclose(conditioned.free.covariance, expected.covariance, atol=1e-10)
    moved = conditioned.moved(mean[None], np.full((1, 7), 0.01))
    again = conditioned.weights(home[None], np.zeros((1, 7)), goal[None] + 0.01)
    np.testing.assert_allclose(moved, again, atol=1e-10)


def test_best_of_the_samples_beats_the_conditional_mean(observed: tuple[PolicyContext, Array]) -> None:
    context, observation = observed
    costs = {}
    for samples in (0, 100):
        motion, goals = ProMPPolicy(context, samples=samples).plan(observation)
        assert goals.converged.all()
        costs[samples] = trajectory_cost(context.arm, motion.position, motion.velocity, motion.dt)
    assert costs[100].sum() < 0.88 * costs[0].sum()


def test_samples_that_break_a_limit_are_not_taken(observed: tuple[PolicyContext, Array]) -> None:
    context, observation = observed
    mean = ProMPPolicy(context, samples=0).plan(observation)[0]

    def peak(motion: JointMotion) -> Array:
        return np.abs(np.diff(motion.velocity, axis=1)).max(axis=(1, 2)) / motion.dt

    free = ProMPPolicy(context).plan(observation)[0]
    limit = 0.97 * float(peak(free).max())
    chosen = ProMPPolicy(dataclasses.replace(context, acceleration_limit=limit)).plan(observation)[0]
    is_mean = (chosen.position == mean.position).all(axis=(1, 2))
    assert ((peak(chosen) < 1.03 * limit) | is_mean).all()
    assert not is_mean.all()
    assert (chosen.position != free.position).any()
    # Where all break one, the mean is taken.
    impossible = dataclasses.replace(context, acceleration_limit=1e-4)
    np.testing.assert_array_equal(ProMPPolicy(impossible).plan(observation)[0].position, mean.position)


def test_seeds(observed: tuple[PolicyContext, Array]) -> None:
    context, observation = observed
    for name in ("random", "promp"):
        same = [make_policy(name, context, 3).predict(observation)[0] for _ in range(2)]
        other = make_policy(name, context, 4).predict(observation)[0]
        np.testing.assert_array_equal(same[0], same[1])
        assert (same[0] != other).any()
    assert (make_policy("hold", context, 0).predict(observation)[0] == 0.0).all()


# Names and errors


class Lazy:
    """A user's policy, found by this module's name."""

    control_mode = "joint_torque"

    def __init__(self, context: PolicyContext, seed: int) -> None:
        self.size = len(context.action_scale)

    def predict(
        self, observation: Array, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[Array, Any]:
        return np.zeros((len(observation), self.size)), None


def test_policies_by_name(observed: tuple[PolicyContext, Array]) -> None:
    context, observation = observed
    own = f"{__name__}:Lazy"
    assert make_policy(own, context, 0).predict(observation)[0].shape == (16, 7)
    assert control_mode(own) == "joint_torque" and control_mode("promp") == "joint_velocity"
    assert all(entry.summary for entry in POLICIES.values())
    with pytest.raises(ConfigurationError, match="Did you mean 'minimum_jerk'"):
        make_policy("minimum_jerks", context, 0)
    with pytest.raises(PolicyError, match="Did you mean 'Lazy'"):
        load_policy_class(f"{__name__}:Lazzy")
    with pytest.raises(PolicyError, match="no_such_module"):
        load_policy_class("no_such_module:Policy")
    for wrong in ("module", "a:b:c", ":Class", "../evil:Class"):
        with pytest.raises(PolicyError, match="package.module:Class"):
            load_policy_class(wrong)
    with pytest.raises(PolicyError, match="predict"):
        load_policy_class("space_envs.errors:PolicyError")


def test_wrong_use_is_refused(observed: tuple[PolicyContext, Array]) -> None:
    context, observation = observed
    spoilt = observation.copy()
    spoilt[3, 3] = np.nan
    for name in (*EXPERTS, "random", "hold"):
        policy = make_policy(name, context, 0)
        with pytest.raises(PolicyError, match="shape"):
            policy.predict(observation[0])
        with pytest.raises(PolicyError, match="finite"):
            policy.predict(spoilt)
    torque = PolicyContext.from_env(make(1, control_mode="joint_torque"))
    for name in EXPERTS:
        with pytest.raises(PolicyError, match="joint_torque"):
            make_policy(name, torque, 0)


def test_every_registered_policy_states_its_knowledge() -> None:
    stated = {name: knowledge(name) for name in POLICIES}
    assert Knowledge.UNSTATED not in stated.values()
    assert {stated[name] for name in ("hold", "random")} == {Knowledge.NONE}
    assert {stated[name] for name in ("bc", "ppo", "bc_reactionless")} == {Knowledge.IMITATION}
    assert all(stated[name] is Knowledge.MODEL for name, entry in POLICIES.items() if entry.expert)
