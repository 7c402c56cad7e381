"""The weight-space planner: its derivatives, its limits and its optima, by independent means."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from known_reaches import KNOWN, OUT_OF_REACH, ROBOT, drives, reach_of, robot

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.check import check
from agents.planners.single_arm.inequalities.spheres import Spheres
from agents.planners.single_arm.inequalities.torques import Torques
from agents.planners.single_arm.library import Library, library_of
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.planners.single_arm.weights.bounds import Bounds
from agents.planners.single_arm.weights.functions import ArmFunctions
from agents.planners.single_arm.weights.quadratic import QuadraticProgram
from agents.planners.single_arm.weights.shapes import INTERVALS
from agents.planners.single_arm.weights.sqp import minimise
from agents.planners.single_arm.weights.weight_space import WeightSpace
from promp import GaussianBasis
from promp.errors import StorageError
from space_envs.dynamics import roll_out_base, trajectory_cost
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array, exponential, to_matrix
from space_envs.errors import ConfigurationError
from space_envs.tasks.goals.kinds import GOAL_KINDS, GoalKind
from space_envs.tasks.single_arm import SingleArmTask


def space_of(seed: int, rate: float = 0.1, kind: GoalKind = "pose") -> tuple[WeightSpace, Array]:
    rng = np.random.default_rng(seed)
    start = robot().home + rng.uniform(-1.0, 1.0, 7)
    turn = to_matrix(exponential(rng.normal(size=3)))
    attitude = to_matrix(exponential(0.3 * rng.normal(size=3)))
    space = WeightSpace(
        robot(),
        GaussianBasis(),
        start,
        rate * rng.normal(size=7),
        8.0,
        rng.normal(size=3),
        turn,
        1.3,
        attitude,
        kind=kind,
    )
    return space, 0.15 * rng.standard_normal((7, space.free))


@pytest.mark.parametrize("name", ["slopes", *GOAL_KINDS, "torque_slope"])
def test_compiled_derivatives_agree_with_differences(name: str) -> None:
    functions, rng = ArmFunctions.of(robot(), INTERVALS), np.random.default_rng(1)
    q, qdot, qddot = rng.normal(size=(3, 4, 7))
    pose = np.concatenate([rng.normal(size=3), to_matrix(exponential(rng.normal(size=3))).T.ravel()])
    pose = np.broadcast_to(pose, (4, 12))
    turns = [to_matrix(exponential(0.4 * rng.normal(size=3))).T.ravel() for _ in range(2)]
    goal = np.broadcast_to(np.concatenate([rng.normal(size=3), *turns]), (4, 21))
    weight = rng.normal(size=(4, 7))
    for joint in range(7):
        step = 1e-6 * np.eye(7)[joint]
        if name == "slopes":
            slope = functions.slopes(q, qdot)[1]
            difference = (functions.twist(q + step, qdot)[0] - functions.twist(q - step, qdot)[0]) / 2e-6
            np.testing.assert_allclose(slope[..., joint], difference, atol=1e-8)
            difference = (functions.twist(q, qdot + step)[0] - functions.twist(q, qdot - step)[0]) / 2e-6
            np.testing.assert_allclose(slope[..., 7 + joint], difference, atol=1e-8)
        elif name in GOAL_KINDS:
            ending = functions.ending_of(name)
            slope = ending(q, pose, goal)[1]
            sides = [ending(q + sign * step, pose, goal)[0] for sign in (1, -1)]
            np.testing.assert_allclose(slope[..., 6 + joint], (sides[0] - sides[1]) / 2e-6, atol=1e-7)
        else:
            (slope,) = functions.torque_slope(q, qdot, qddot, weight)
            for part in range(3):
                moved = [np.array([q, qdot, qddot]) for _ in range(2)]
                moved[0][part] += step
                moved[1][part] -= step
                high, low = (functions.torque(*side)[0] for side in moved)
                difference = ((high - low) * weight).sum(axis=1) / 2e-6
                np.testing.assert_allclose(slope[:, 7 * part + joint], difference, rtol=1e-6, atol=1e-5)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.sampled_from(GOAL_KINDS))
def test_costs_and_goal_errors_are_differentiated_exactly(seed: int, kind: GoalKind) -> None:
    space, y = space_of(seed, kind=kind)
    at = space.disturbance(y[None])
    # At half a turn a rotation vector jumps to the other side, and close to it differences lose their digits.
    turns = np.split(at.goal_error[0], [3, space.rows])[1:]
    assume(all(np.linalg.norm(turn) < np.pi - 0.01 for turn in turns))
    direction = np.random.default_rng(seed + 1).standard_normal(y.shape)
    high, low = (space.disturbance((y + sign * 1e-6 * direction)[None]) for sign in (1, -1))
    for name, derivative in (("residual", "residual_slope"), ("goal_error", "goal_slope")):
        difference = (getattr(high, name) - getattr(low, name))[0] / 2e-6
        slope = getattr(at, derivative)[0] @ direction.ravel()
        np.testing.assert_allclose(slope, difference, atol=1e-6 * max(1.0, np.abs(slope).max()))
    cost, miss = space.values(y[None])
    assert cost == pytest.approx(at.cost, rel=1e-12)
    np.testing.assert_allclose(miss, at.goal_error, atol=1e-12)


@pytest.mark.parametrize("kind", ["pose", "axis", "position"])
def test_second_derivatives_agree_with_differences_of_first_ones(kind: GoalKind) -> None:
    rng = np.random.default_rng(5)
    turn = to_matrix(exponential(rng.normal(size=3)))
    rest, position = np.zeros(7), rng.normal(size=3)
    space = WeightSpace(robot(), GaussianBasis(), robot().home, rest, 10.0, position, turn, 0.7, kind=kind)
    y, weight = 0.2 * rng.standard_normal((7, space.free)), rng.normal(size=space.rows + 3)

    def gradient(y: Array) -> Array:
        at = space.disturbance(y[None])
        return 2.0 * at.residual[0] @ at.residual_slope[0] + weight @ at.goal_slope[0]

    at, step = space.disturbance(y[None]), 1e-5
    exact = space.curvature(y, at, weight) + 2.0 * at.residual_slope[0].T @ at.residual_slope[0]
    for direction in rng.standard_normal((5, *y.shape)):
        difference = (gradient(y + step * direction) - gradient(y - step * direction)) / (2.0 * step)
        np.testing.assert_allclose(
            exact @ direction.ravel(), difference, atol=2e-3 * np.abs(difference).max()
        )


def test_torque_and_sphere_rows_agree_with_differences() -> None:
    space, y = space_of(3, rate=0.0)
    ends = robot().end_effector_pose(space.even_fixed[0])[0]
    spheres = np.array([[*(ends[25] + [0.1, 0.2, 0.1]), 0.3], [0.3, 1.0, 1.0, 0.1]])
    for rows in (Torques(space, 5.0), Spheres(space, robot(), spheres, 0.05)):
        at = space.disturbance(y[None])
        matrix, low, _ = rows.linear(y, at, 1.0)
        assert len(low) > 5
        missing = np.maximum(low, 0.0)
        if isinstance(rows, Spheres):
            # Those that are broken sum to the violation, and so do their changes.
            broken = low > 1e-3
            assert broken.any()
            assert rows.violation(y) == pytest.approx(missing.sum(), rel=1e-9)
            direction = np.random.default_rng(0).standard_normal(y.shape)
            sides = [rows.violation(y + sign * 1e-6 * direction) for sign in (1, -1)]
            # The base's pose is taken as straight between intervals, which its derivative is not quite.
            expected = -(matrix[low > 0.0] @ direction.ravel()).sum()
            assert (sides[0] - sides[1]) / 2e-6 == pytest.approx(expected, rel=2e-3)
        else:
            direction = np.random.default_rng(0).standard_normal(y.shape)
            high, lower = (rows.linear(y + sign * 1e-6 * direction, at, 1.0)[1] for sign in (1, -1))
            assert len(high) == len(lower) == len(low)
            np.testing.assert_allclose(
                -(high - lower) / 2e-6, matrix @ direction.ravel(), rtol=1e-4, atol=1e-4
            )


def test_roll_out_is_that_of_numpy() -> None:
    space, y = space_of(5)
    weights = space.weights(y).T
    basis, phase = GaussianBasis(), np.linspace(0.0, 1.0, 4001)
    q, qdot = basis.value(phase) @ weights, basis.derivative(phase) @ weights / 8.0
    position, quaternion = roll_out_base(robot(), q, qdot, 8.0 / 4000)
    pose = space.poses(y[None])[0, -1]
    np.testing.assert_allclose(pose[:3], position[-1], atol=2e-4)
    np.testing.assert_allclose(pose[3:].reshape(3, 3).T, to_matrix(quaternion[-1]), atol=2e-4)
    cost = trajectory_cost(robot(), q, qdot, 8.0 / 4000, 1.3)
    assert space.values(y[None])[0][0] == pytest.approx(cost, rel=5e-3)


def test_ends_are_met_by_every_coordinate() -> None:
    space, y = space_of(6)
    basis, weights = GaussianBasis(), space.weights(y).T
    np.testing.assert_allclose(basis.value(0.0) @ weights, space.even_fixed[0, 0], atol=1e-9)
    np.testing.assert_allclose(basis.derivative(1.0) @ weights, 0.0, atol=1e-9)
    np.testing.assert_allclose(space.coordinates(space.weights(y)), y, atol=1e-9)
    # A unit of y adds a unit of the integral of the squared rate.
    phase = np.linspace(0.0, 1.0, 2001)
    rate = basis.derivative(phase) @ (weights - space.fixed.T)
    assert (rate**2).mean(axis=0).sum() == pytest.approx((y**2).sum(), rel=1e-2)


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_steps_keep_bounds_and_equations_and_are_least(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rows, fixed = rng.normal(size=(3, 9, 3)), np.zeros((3, 9, 2))
    bounds = Bounds(rows, fixed, np.full((3, 2), -1.0), np.full((3, 2), 1.0))
    root = rng.normal(size=(6, 6))
    hessian, gradient = root @ root.T + 0.1 * np.eye(6), 3.0 * rng.normal(size=6)
    equations, right = rng.normal(size=(1, 6)), np.array([0.05])
    y = np.zeros((2, 3))
    found = QuadraticProgram(bounds).solve(hessian, gradient, equations, right, y)
    assert not isinstance(found, Failure)
    step, _ = found
    np.testing.assert_allclose(equations @ step, right, atol=1e-6)
    assert bounds.excess(step.reshape(2, 3)).max() < 2e-4
    # No feasible direction of descent among many: the problem is convex.
    here = 0.5 * step @ hessian @ step + gradient @ step
    null = np.linalg.svd(equations)[2][1:]
    for direction in rng.standard_normal((200, 5)) @ null:
        other = step + 0.05 * direction
        if bounds.excess(other.reshape(2, 3)).max() <= 0.0:
            assert 0.5 * other @ hessian @ other + gradient @ other > here - 1e-4 * abs(here) - 1e-6


def test_contradicting_bounds_have_no_step() -> None:
    rows = np.stack([np.eye(3)] * 3)
    bounds = Bounds(rows, np.zeros((3, 3, 2)), np.full((3, 2), -1.0), np.full((3, 2), 1.0))
    equations = np.zeros((1, 6))
    equations[0, 0] = 1.0
    right, y = np.array([3.0]), np.zeros((2, 3))
    found = QuadraticProgram(bounds).solve(np.eye(6), np.zeros(6), equations, right, y)
    assert isinstance(found, Failure)
    assert found.cause is Cause.INFEASIBLE


@cache
def planner(keep_attitude: bool, limited: bool) -> OptimalPlanner:
    limits = drives() if limited else Limits()
    library = library_of(ROBOT, keep_attitude, limited)
    return OptimalPlanner(robot(), limits, library, candidates=16, improved=4)


@pytest.mark.parametrize("keep_attitude", [False, True])
@pytest.mark.parametrize("number", range(len(KNOWN)))
def test_known_goals_cost_hardly_more_than_is_known(number: int, keep_attitude: bool) -> None:
    reach = reach_of(number, keep_attitude)
    plan = planner(keep_attitude, False).plan(reach)
    assert isinstance(plan, ReachPlan)
    measured = check(SingleArmTask().model, robot(), reach, Limits(), plan)
    assert measured.cost == pytest.approx(plan.cost, rel=0.01)
    assert measured.cost <= 1.05 * KNOWN[number]["kept" if keep_attitude else "free"]
    assert measured.violation["position_error"] < 1e-3
    assert measured.violation["rotation_error"] < np.deg2rad(0.05)
    assert not keep_attitude or measured.violation["end_attitude"] < np.deg2rad(0.05)


@pytest.mark.parametrize("keep_attitude", [False, True])
def test_limits_of_the_model_are_satisfied(keep_attitude: bool) -> None:
    for number in range(len(KNOWN)):
        reach = reach_of(number, keep_attitude)
        plan = planner(keep_attitude, True).plan(reach)
        assert isinstance(plan, ReachPlan)
        violation = check(SingleArmTask().model, robot(), reach, drives(), plan).violation
        assert violation["position"] <= 0.0
        assert violation["rate"] <= 1e-4 * 0.3
        assert violation["acceleration"] <= 1e-2 * 0.25
        assert violation["torque"] <= 1e-2 * 60.0
        assert violation["position_error"] < 1e-3
        assert violation["start"] < 1e-9
        assert violation["end_rate"] < 1e-9
        assert not keep_attitude or violation["end_attitude"] < np.deg2rad(0.05)


def test_torque_limit_is_active_and_satisfied() -> None:
    model, bare = SingleArmTask().model, planner(False, True).plan(reach_of(1))
    assert isinstance(bare, ReachPlan)
    most = 60.0 + check(model, robot(), reach_of(1), drives(), bare).violation["torque"]
    limits = replace(drives(), torque=0.8 * most)
    plan = OptimalPlanner(robot(), limits, library_of(ROBOT, False)).plan(reach_of(1))
    assert isinstance(plan, ReachPlan)
    assert plan.cost > bare.cost
    assert check(model, robot(), reach_of(1), limits, plan).violation["torque"] < 0.01 * most


def test_without_a_library_it_starts_from_rest() -> None:
    for keep_attitude in (False, True):
        reach = reach_of(2, keep_attitude)
        plan = OptimalPlanner(robot(), Limits()).plan(reach)
        assert isinstance(plan, ReachPlan)
        assert check(SingleArmTask().model, robot(), reach, Limits(), plan).violation["position_error"] < 1e-3


# Validation goals; two of them are those at which an early end costs most.
POLISHED = (0, 2, 14, 47)


@cache
def plans_to_goals(keep_attitude: bool) -> list[tuple[Reach, ReachPlan]]:
    """The shipped planner's motions to validation goals, within all limits."""
    goals = SingleArmTask().goals("validation", np.array(POLISHED))
    found = []
    for position, quaternion in zip(goals.position, goals.quaternion, strict=True):
        goal = Grapple.at_rest(position, quaternion)
        reach = Reach(robot().home, goal, keep_attitude=keep_attitude).checked(robot())
        plan = OptimalPlanner(robot(), drives(), library_of(ROBOT, keep_attitude)).plan(reach)
        assert isinstance(plan, ReachPlan)
        found.append((reach, plan))
    return found


@pytest.mark.parametrize("keep_attitude", [False, True])
def test_cost_is_that_of_a_dense_roll_out(keep_attitude: bool) -> None:
    for _, plan in plans_to_goals(keep_attitude):
        time = np.linspace(0.0, 10.0, 4001)
        q, qdot, _ = plan.sample(time)
        twist = robot().base_twist(q, qdot)
        assert plan.cost == pytest.approx(np.trapezoid((twist * twist).sum(axis=1), time), rel=1e-4)


@pytest.mark.parametrize("keep_attitude", [False, True])
def test_more_iterations_gain_little(keep_attitude: bool) -> None:
    planner = OptimalPlanner(robot(), drives())
    for reach, plan in plans_to_goals(keep_attitude):
        space, bounds, rows = planner.setting(reach)
        phase = plan.time / plan.time[-1]
        weights = np.linalg.lstsq(GaussianBasis().value(phase), plan.position, rcond=None)[0].T
        finest = minimise(space, bounds, space.coordinates(weights), keep_attitude, rows, 1e-7, 300)
        assert finest.goal_error < 1e-4
        assert plan.cost <= 1.01 * space.dense_cost(finest.y[None])[0]


def test_from_a_moving_start() -> None:
    reach = replace(reach_of(2), rate=np.full(7, 0.02), start=robot().home + 0.1, duration=8.0)
    plan = planner(False, True).plan(reach)
    assert isinstance(plan, ReachPlan)
    violation = check(SingleArmTask().model, robot(), reach, drives(), plan).violation
    assert violation["start"] < 1e-9
    assert violation["position_error"] < 1e-3


@pytest.mark.parametrize(
    ("changes", "limits", "cause"),
    [
        ({"goal": OUT_OF_REACH}, Limits(), Cause.OUT_OF_REACH),
        ({"duration": 0.5}, Limits(rate=0.3, acceleration=0.25), Cause.INFEASIBLE),
    ],
)
def test_failures_name_cause_and_figures(changes: dict, limits: Limits, cause: Cause) -> None:
    failure = OptimalPlanner(robot(), limits).plan(replace(reach_of(0), **changes))
    assert isinstance(failure, Failure)
    assert failure.cause is cause, failure
    assert any(letter.isdigit() for letter in failure.reason)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"start": np.zeros(6)}, "start"),
        ({"goal": Grapple.at_rest(np.zeros(3), np.zeros(4))}, "attitude of a grapple must not be zero"),
        ({"kind": "axes"}, "Did you mean 'axis'"),
        ({"duration": -1.0}, "duration"),
        ({"goal": Grapple.at_rest([np.nan, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])}, "centre of a grapple"),
        ({"spheres": np.array([[0.0, 0.0, 0.0, -1.0]])}, "radii"),
    ],
)
def test_bad_problems_are_refused_before_work(changes: dict, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        OptimalPlanner(robot()).plan(replace(reach_of(0), **changes))


def test_library_file_is_checked(tmp_path: Path) -> None:
    library = library_of(ROBOT, True)
    path = tmp_path / "library.npz"
    library.save(path)
    again = Library.load(path)
    assert np.array_equal(again.coordinates, library.coordinates)
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(StorageError):
        Library.load(path)
    reach = Reach(robot().home, Grapple.at_rest(library.position[5], library.quaternion[5]))
    assert np.array_equal(library.nearest(reach, 1)[0], library.coordinates[5])


def test_shipped_motions_lead_to_their_goals() -> None:
    for keep_attitude in (False, True):
        library = library_of(ROBOT, keep_attitude)
        for number in range(0, len(library.cost), len(library.cost) // 5):
            turn = to_matrix(library.quaternion[number])
            space = WeightSpace(
                robot(), GaussianBasis(), robot().home, np.zeros(7), 10.0, library.position[number], turn, 1.0
            )
            cost, miss = space.values(library.coordinates[number][None])
            assert cost[0] == pytest.approx(library.cost[number], rel=1e-4)
            assert np.abs(miss[0, : 9 if keep_attitude else 6]).max() < 1e-4
