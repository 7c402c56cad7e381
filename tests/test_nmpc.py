"""Nonlinear model predictive control: derivatives, closed loop under model mismatch, moving goals, limits."""

from dataclasses import replace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import space_envs  # noqa: F401  (registers the ids)
from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.library import library_of
from agents.planners.single_arm.nmpc.controller import Controller
from agents.planners.single_arm.nmpc.first import FirstPlans, attitude_if_possible
from agents.planners.single_arm.nmpc.objective import Objective
from agents.planners.single_arm.nmpc.problem import ArmState, Horizon, Weights
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.planners.single_arm.weights.bounds import Bounds
from agents.planners.single_arm.weights.elastic import ElasticProgram
from agents.planners.single_arm.weights.legendre import LegendreBasis
from agents.planners.single_arm.weights.weight_space import WeightSpace
from agents.policies.single_arm.nmpc.policy import NMPC
from agents.policies.single_arm.nmpc.reactionless import NMPCReactionless
from space_envs.dynamics import roll_out_base
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import (
    Array,
    angle_between,
    exponential,
    from_matrix,
    multiply,
    rotate,
    to_matrix,
)
from space_envs.policy import PolicyContext
from space_envs.robots.zoo import find_robot
from space_envs.tasks.single_arm import SingleArmTask
from tests.moving_goals import ENDS, circling

TASK = SingleArmTask()
ARM = TASK.mechanics
RATE, ACCELERATION = 0.3, 0.25
LIMITS = Limits(ARM.range, RATE, ACCELERATION, 60.0)
ROBOT = find_robot("shyam2020")
LIBRARY = library_of(ROBOT, True)
STILL = np.array([1.0, 0.0, 0.0, 0.0])
GOALS = (0, 8)  # of the validation split


def make(n: int) -> Any:
    return gym.make_vec(
        "SpaceCapture/SingleArm-v0", num_envs=n, split="validation", autoreset_mode="disabled"
    )


def play(mass: float, goals: tuple[int, ...] = GOALS, kind: type[NMPC] = NMPC) -> dict[str, Any]:
    """Episodes with the satellite's mass and inertia scaled; what happened, per row."""
    n = len(goals)
    env = make(n)
    observation, _ = env.reset(seed=0, options={"index": np.array(goals)})
    rows = np.arange(n)
    simulation = env.unwrapped.simulation
    simulation.scale_base(rows, np.full(n, mass))
    simulation.refresh(rows)
    env.unwrapped.drive.reset(rows)
    policy, state, layout = kind(PolicyContext.from_env(env.unwrapped)), None, TASK.layout
    rates, attitude, position = [], [], []
    info: dict[str, Any] = {}
    for _ in range(TASK.horizon):
        action, state = policy.predict(observation, state)
        observation, _, terminated, truncated, info = env.step(action)
        rates.append(layout.read(observation, "joint_velocity"))
        attitude.append(np.rad2deg(TASK.attitude(observation)))
        position.append(TASK.errors(observation).position)
        if (terminated | truncated).all():
            break
    env.close()
    return {
        "outcome": list(info["outcome"]),
        "rates": np.array(rates),
        "attitude": np.array(attitude),
        "position": np.array(position),
        "state": state,
    }


@pytest.fixture(scope="module")
def heavy() -> dict[str, Any]:
    return play(1.1)


@pytest.fixture(scope="module")
def light() -> dict[str, Any]:
    return play(0.9)


def state_at(time: float = 0.0, angles: Array = ARM.home) -> ArmState:
    return ArmState(time, angles, np.zeros(7), np.zeros(3), STILL)


def goal_at_rest(index: int) -> Grapple:
    goals = TASK.goals("validation", np.array([index]))
    return Grapple.at_rest(goals.position[0], goals.quaternion[0])


def first_plan(controller: Controller, goal: Grapple, stored: bool = True) -> Horizon | Failure:
    plan = attitude_if_possible(OptimalPlanner(ARM, LIMITS, LIBRARY))
    return FirstPlans(controller, plan, LIBRARY if stored else None)(state_at(), goal)


# What is minimised


def test_rest_of_a_polynomial_motion_is_one_again() -> None:
    basis, rng = LegendreBasis(), np.random.default_rng(0)
    weights = rng.standard_normal((3, basis.size))
    phase = np.linspace(0.0, 1.0, 60)
    rest = basis.value(0.3 + 0.7 * phase) @ weights.T
    fitted = np.linalg.lstsq(basis.value(phase), rest, rcond=None)[0]
    np.testing.assert_allclose(basis.value(phase) @ fitted, rest, atol=1e-10)


def test_derivatives_of_the_basis_by_finite_differences() -> None:
    basis, phase, h = LegendreBasis(), np.linspace(0.1, 0.9, 7), 1e-6
    for function, slope in (
        (basis.value, basis.derivative),
        (basis.derivative, basis.second_derivative),
    ):
        np.testing.assert_allclose(
            (function(phase + h) - function(phase - h)) / (2.0 * h), slope(phase), rtol=1e-6, atol=1e-5
        )


def objective() -> tuple[WeightSpace, Objective, Array]:
    """A motion that starts moving, in a turned frame, and its objective without bounds."""
    rng = np.random.default_rng(1)
    goal = goal_at_rest(3).at(0.0)
    attitude = to_matrix(exponential(np.array([0.03, -0.05, 0.02])))
    rate = 0.1 * rng.standard_normal(7)
    space = WeightSpace(
        ARM, LegendreBasis(), ARM.home, rate, 9.0, goal.position, to_matrix(goal.quaternion), 1.0, attitude
    )
    free = np.full((3, 7), np.inf)
    bounds = Bounds(space.even, space.even_fixed, -free, free)
    y = 0.3 * rng.standard_normal((7, space.free))
    return space, Objective(space, bounds, Weights(goal=10.0, attitude=3.0), attitude), y


def test_gradient_by_finite_differences() -> None:
    space, function, y = objective()
    gradient = function.quadratic(space.disturbance(y[None]))[1]

    def value(x: Array) -> float:
        return function.value(x, space.disturbance(x[None]))

    steps = 1e-6 * np.eye(y.size).reshape(-1, *y.shape)
    numeric = np.array([(value(y + step) - value(y - step)) / 2e-6 for step in steps])
    np.testing.assert_allclose(numeric, gradient, rtol=1e-4, atol=1e-5 * np.abs(gradient).max())


def test_elastic_program_distributes_unavoidable_violations() -> None:
    """Two bounds that exclude each other are broken by the same share; one that can be kept is kept."""
    rows = np.zeros((3, 2, 1))
    rows[0, :, 0] = [1.0, -1.0]
    fixed = np.zeros((3, 2, 1))
    fixed[0, :, 0] = 3.0
    low, high = np.full((3, 1), -np.inf), np.full((3, 1), np.inf)
    low[0], high[0] = -1.0, 1.0
    step = ElasticProgram(Bounds(rows, fixed, low, high)).solve(np.eye(1), np.array([5.0]), np.zeros((1, 1)))
    assert not isinstance(step, Failure)
    assert abs(step[0, 0]) < 1e-2
    fixed[0, :, 0] = 0.0
    step = ElasticProgram(Bounds(rows, fixed, low, high)).solve(np.eye(1), np.array([5.0]), np.zeros((1, 1)))
    assert not isinstance(step, Failure)
    assert step[0, 0] == pytest.approx(-1.0, abs=1e-3)


# Closed loop


def test_predicted_end_is_where_the_model_ends() -> None:
    """The motion of one control step, rolled out by other code, ends at the goal with the attitude kept."""
    controller, goal = Controller(ARM, LIMITS), goal_at_rest(8)
    horizon = first_plan(controller, goal)
    assert isinstance(horizon, Horizon)
    for _ in range(3):
        horizon = controller.advance(horizon, state_at(), goal)
    phase = np.linspace(0.0, 1.0, 801)
    q = horizon.basis.value(phase) @ horizon.weights.T
    qdot = horizon.basis.derivative(phase) @ horizon.weights.T / horizon.duration
    position, quaternion = roll_out_base(ARM, q, qdot, horizon.duration / 800)
    local, rotation = ARM.end_effector_pose(q[-1])
    wanted = goal.at(Weights().duration)
    assert np.linalg.norm(position[-1] + rotate(quaternion[-1], local) - wanted.position) < 1e-3
    assert angle_between(multiply(quaternion[-1], from_matrix(rotation)), wanted.quaternion) < np.deg2rad(0.1)
    assert angle_between(quaternion[-1], STILL) < np.deg2rad(0.05)


@pytest.mark.parametrize("case", ["light", "heavy"])
def test_closes_the_loop_on_wrong_masses(case: str, request: pytest.FixtureRequest) -> None:
    played = request.getfixturevalue(case)
    assert played["outcome"] == ["captured"] * len(GOALS)
    assert played["attitude"][-1].max() < 0.1
    assert played["position"][-1].max() < 0.02


def test_attitude_that_is_weighted_at_all_times_is_kept_at_all_times() -> None:
    """With satellites that are heavier than the nominal one too."""
    for mass in (1.0, 1.1):
        played = play(mass, kind=NMPCReactionless)
        assert played["outcome"] == ["captured"] * len(GOALS)
        assert played["attitude"].max() < 0.2


def test_limits_are_kept(heavy: dict[str, Any], light: dict[str, Any]) -> None:
    for played in (heavy, light):
        rates = np.concatenate([np.zeros_like(played["rates"][:1]), played["rates"]])
        assert np.abs(rates).max() < 1.01 * RATE
        assert np.abs(np.diff(rates, axis=0)).max() < 1.02 * ACCELERATION * TASK.control_period
        for horizon in played["state"].horizons:
            times = np.linspace(horizon.start, horizon.start + horizon.duration, 401)
            assert np.abs(horizon.rates(times)).max() < 1.02 * RATE


def test_feedback_is_necessary(light: dict[str, Any]) -> None:
    """The first plan alone, carried out exactly on the lighter satellite, misses by more."""
    controller = Controller(ARM, LIMITS)
    goals = TASK.goals("validation", np.array(GOALS))
    lighter = replace(
        ARM, mass=np.append(0.9 * ARM.mass[:1], ARM.mass[1:]), inertia=_scaled_inertia(ARM.inertia)
    )
    for row, index in enumerate(GOALS):
        horizon = first_plan(controller, goal_at_rest(index))
        assert isinstance(horizon, Horizon)
        phase = np.linspace(0.0, 1.0, 401)
        q = horizon.basis.value(phase) @ horizon.weights.T
        qdot = horizon.basis.derivative(phase) @ horizon.weights.T / horizon.duration
        position, quaternion = roll_out_base(lighter, q, qdot, horizon.duration / 400)
        tip = position[-1] + rotate(quaternion[-1], ARM.end_effector_pose(q[-1])[0])
        open_loop = np.rad2deg(angle_between(quaternion[-1], STILL))
        assert open_loop > 1.5 * light["attitude"][-1, row]
        assert np.linalg.norm(tip - goals.position[row]) > 1e-3


def _scaled_inertia(inertia: Array) -> Array:
    scaled = inertia.copy()
    scaled[0] *= 0.9
    return scaled


def track(goal: Grapple, most: float) -> tuple[Array, Array, Array, Array, float]:
    """Pose and twist of the end-effector on the model and the time, at the rendezvous or `most` s."""
    controller, dt, fine = Controller(ARM, LIMITS), 0.1, 5
    state = state_at()
    horizon = first_plan(controller, goal)
    assert isinstance(horizon, Horizon)
    while state.time < min(most, horizon.rendezvous) - 1e-9:
        horizon = controller.advance(horizon, state, goal.after(state.time))
        asked = horizon.rates(np.array(state.time + dt))
        share = np.linspace(0.0, 1.0, fine)[:, None]
        rates = state.rates + share * (asked - state.rates)
        angles = state.angles + dt * (share * state.rates + 0.5 * share**2 * (asked - state.rates))
        moved, turned = roll_out_base(ARM, angles, rates, dt / (fine - 1))
        base = state.position + rotate(state.quaternion, moved[-1])
        state = ArmState(state.time + dt, angles[-1], asked, base, multiply(state.quaternion, turned[-1]))
    local, rotation = ARM.end_effector_pose(state.angles)
    velocity = ARM.generalized_jacobian(state.angles) @ state.rates
    return (
        state.position + rotate(state.quaternion, local),
        multiply(state.quaternion, from_matrix(rotation)),
        rotate(state.quaternion, velocity[:3]),
        rotate(state.quaternion, velocity[3:]),
        state.time,
    )


@pytest.mark.parametrize("number", [3, 8])
def test_intercepts_a_grapple_that_circles(number: int) -> None:
    """Pose and twist are matched on the model, at a time between the earliest and the latest."""
    position, quaternion, linear, angular, time = track(circling(number, 16.0).goal, 30.0)
    wanted = circling(number, 16.0).goal.at(time)
    assert Weights().earliest <= time <= Weights().latest
    assert np.linalg.norm(position - wanted.position) < ENDS["position_error"]
    assert angle_between(quaternion, wanted.quaternion) < ENDS["rotation_error"]
    assert np.linalg.norm(linear - wanted.linear_velocity) < ENDS["linear_velocity_error"]
    assert np.linalg.norm(angular - wanted.angular_velocity) < ENDS["angular_velocity_error"]


# Policy


def test_goal_out_of_reach_is_a_typed_failure() -> None:
    failure = first_plan(Controller(ARM, LIMITS), Grapple.at_rest(np.array([0.0, 30.0, 0.0]), STILL))
    assert isinstance(failure, Failure)
    assert failure.cause is Cause.OUT_OF_REACH


def test_policy_rests_with_a_failure_where_there_is_no_plan() -> None:
    env = make(1)
    policy = NMPC(PolicyContext.from_env(env.unwrapped))
    observation, _ = env.reset(seed=0, options={"index": np.array([8])})
    env.close()
    lost = observation.copy()
    lost[:, TASK.layout.slices["goal_position"]] = [0.0, 30.0, 0.0]
    action, state = policy.predict(np.concatenate([lost, observation]))
    assert not action[0].any() and action[1].any()
    assert state.failures[0].cause == "out_of_reach" and state.failures[1] is None
    before = state.horizons[1]
    alone = policy.predict(observation)[0]
    np.testing.assert_array_equal(alone[0], action[1])
    policy.predict(np.concatenate([lost, observation]), state, np.zeros(2, dtype=bool))
    assert state.horizons[1] is before  # a state is never changed in place
