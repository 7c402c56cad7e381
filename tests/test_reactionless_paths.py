"""End-effector paths and the two methods that follow them without looking ahead."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from dual_arm_robots import DUAL_ARMS
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.prescribed_paths.instantaneous import plan_local, plan_zeta_zero
from agents.planners.dual_arm.prescribed_paths.model import Matrices, PathModel
from agents.planners.dual_arm.prescribed_paths.null_space import least_energy, solutions, zeta_zero
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.reactionless import end_effectors, reach
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.errors import ConfigurationError
from space_envs.robots.models import robot_mechanics

# The canonical case of the lost Fig. 1 of shah2013 and its energies, J s, found by two implementations.
START = np.array([0.0, 1.8, -1.5, 0.9, -0.6, 1.0])
GOALS = np.array([[2.0, 0.7, 0.0], [2.0, 1.3, 0.0]])
VELOCITIES = np.array([[-0.01, 0.0, 0.0], [0.01, 0.0, 0.0]])
ENERGY = {"reactionless": 0.770365391, "reactionless_local": 0.907150386}
PLANNERS = {"reactionless": plan_zeta_zero, "reactionless_local": plan_local}
MOUNTS = ((0.4, 0.3), (-0.3, 0.4))

lengths = st.floats(-3.0, 3.0)
speeds = st.floats(-1.0, 1.0)


def robot_of(kind: str = "planar", mounts: tuple[tuple[float, float], ...] | None = None) -> FloatingRobot:
    robot = DUAL_ARMS[kind]
    return robot_mechanics(robot if mounts is None else robot.mounted_at(mounts))


def canonical(**changes: object) -> Capture:
    ends = {"start": START, "duration": 20.0, "position": GOALS, "velocity": VELOCITIES}
    return Capture.at_end(**ends | changes)  # type: ignore[arg-type]


@cache
def canonical_plan(method: str) -> CapturePlan:
    plan = PLANNERS[method](robot_of(), canonical())
    assert isinstance(plan, CapturePlan), plan
    return plan


def near(robot: FloatingRobot, start: Array, away: float, duration: float = 12.0) -> Capture:
    """A capture whose goals a reactionless motion from `start` is known to reach, `away` rad from it."""
    centre = robot.centre_of_mass(robot.kinematics(start))
    there = start + away * np.cos(np.arange(robot.n_joints))
    moved = end_effectors(robot, there).position + centre - robot.centre_of_mass(robot.kinematics(there))
    found = reach(robot, start[None], moved[None])
    assert found.distance[0] < 1e-3
    return Capture.at_end(start, duration, moved, np.zeros((2, 3)))


def scalar_path(start: float, end: float, first: float, last: float, duration: float) -> PolynomialPath:
    return PolynomialPath(np.array([start]), np.array([end]), np.array([first]), np.array([last]), duration)


def split(at: Matrices, velocity: Array) -> tuple[Array, Array]:
    """A particular solution and the null space."""
    found = solutions(at, velocity)
    assert not isinstance(found, Failure)
    return found


def task_rows(robot: FloatingRobot, q: Array) -> Array:
    """[J_g linear; Ibm~ up to a factor] (5, 6) by the numpy mathematics."""
    now = end_effectors(robot, q)
    return np.concatenate([now.linear[:, :2].reshape(4, 6), now.base_angular[2:]])


@given(start=lengths, end=lengths, first=speeds, last=speeds, duration=st.floats(0.5, 60.0))
def test_polynomial_has_its_end_conditions(start, end, first, last, duration):
    path = scalar_path(start, end, first, last, duration)
    ends = np.array([0.0, duration])
    np.testing.assert_allclose(path.position(ends)[:, 0], [start, end], atol=1e-9 * (1 + duration))
    np.testing.assert_allclose(path.velocity(ends)[:, 0], [first, last], atol=1e-9)
    # Accelerations vanish there: to first order the velocity stays.
    step = 1e-4 * duration
    inner = path.velocity(np.array([step, duration - step]))[:, 0]
    most = 60.0 * (abs(end - start) / duration + abs(first) + abs(last))
    assert np.abs(inner - [first, last]).max() <= most * 1e-8 * 2 + 1e-12


@given(end=lengths, last=speeds, duration=st.floats(0.5, 60.0), share=st.floats(0.01, 0.99), first=speeds)
def test_velocity_is_the_derivative_of_position(end, last, duration, share, first):
    path = scalar_path(0.2, end, first, last, duration)
    step, time = 1e-4 * duration, share * duration
    slope = (path.position(time + step) - path.position(time - step)) / (2 * step)
    np.testing.assert_allclose(path.velocity(time), slope, atol=1e-5)


@pytest.mark.parametrize("method", PLANNERS)
def test_canonical_energy(method):
    plan = canonical_plan(method)
    assert plan.method == method
    assert plan.energy == pytest.approx(ENERGY[method], rel=1e-8)
    assert plan.violation["base_rate"] < 1e-9
    assert plan.violation["end_position"] < 1e-8
    assert plan.violation["path"] < 1e-8


def test_zeta_vanishes_for_one_and_jumps_late_for_the_other():
    zero, local = (canonical_plan(method) for method in PLANNERS)
    assert zero.zeta is not None and np.abs(zero.zeta).max() < 1e-9
    assert local.zeta is not None and np.abs(local.zeta).max() > 1e-2
    time = np.linspace(0.0, 20.0, 4001)
    q, rate, _ = local.sample(time)
    spins = (end_effectors(robot_of(), q).angular @ rate[:, None, :, None])[..., 2, 0]
    fastest = time[np.abs(np.diff(spins, axis=0)).argmax(axis=0)]
    # Arm 1's at 18.2 s, as the reference has it; arm 2's change is larger, and both together peak at 16 s.
    np.testing.assert_allclose(fastest, [18.2, 16.1], atol=0.1)


@pytest.mark.parametrize("method", PLANNERS)
def test_an_integration_of_its_own_agrees(method):
    """Classical Runge-Kutta with numpy's mathematics alone, from eq. 7 to 9 and 12 to 14."""
    robot, plan = robot_of(), canonical_plan(method)
    mass = SymbolicRobot(robot).reduced_mass
    place = end_effectors(robot, START).position[:, :2].ravel()
    path = PolynomialPath(place, GOALS[:, :2].ravel(), np.zeros(4), VELOCITIES[:, :2].ravel(), 20.0)

    def law(time: float, q: Array) -> Array:
        rows = task_rows(robot, q)
        some = np.linalg.pinv(rows) @ np.append(path.velocity(time), 0.0)
        direction = np.linalg.svd(rows)[2][-1]
        if method == "reactionless":
            spin = end_effectors(robot, q).angular[:, 2]
            metric = spin.T @ spin
        else:
            metric = np.array(mass(q))
        return some - direction * (direction @ metric @ some) / (direction @ metric @ direction)

    # Up to 12 s, where coarse steps are still good to 1e-6.
    q, steps, h = START, 120, 0.1
    for step in range(steps):
        k1 = law(step * h, q)
        k2 = law((step + 0.5) * h, q + 0.5 * h * k1)
        k3 = law((step + 0.5) * h, q + 0.5 * h * k2)
        k4 = law((step + 1) * h, q + h * k3)
        q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    np.testing.assert_allclose(plan.sample(np.array(12.0))[0], q, atol=2e-6)


def test_zeta_zero_is_coordinate_partitioning():
    """Eq. 6 to 9 literally, where J_g can be inverted."""
    robot, model, rng = robot_of(), PathModel.of(robot_of()), np.random.default_rng(5)
    tried = 0
    for q in rng.uniform(-2.5, 2.5, (40, 6)):
        now = end_effectors(robot, q)
        jg = np.concatenate([now.linear[:, :2].reshape(4, 6), now.angular[:, 2]])
        if np.linalg.cond(jg) > 50.0:
            continue
        tried += 1
        velocity = rng.normal(size=4)
        turning = now.base_angular[2] @ np.linalg.inv(jg)  # I_be~ up to a factor; independent ones first here
        independent, dependent = turning[:4], turning[None, 4:]
        spins = -np.linalg.pinv(dependent) @ (independent[None] @ velocity)
        expected = np.linalg.solve(jg, np.concatenate([velocity, spins]))
        at = model(q)
        some, null = split(at, velocity)
        share = zeta_zero(at, some, null)
        assert not isinstance(share, Failure), share
        found = some + null @ share
        np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())
    assert tried >= 10


def test_local_choice_is_the_minimum_of_eq_12():
    robot, model, rng = robot_of(), PathModel.of(robot_of()), np.random.default_rng(6)
    mass = SymbolicRobot(robot).reduced_mass
    for q in rng.uniform(-2.0, 2.0, (8, 6)):
        velocity, metric = 0.1 * rng.normal(size=4), np.array(mass(q))
        at = model(q)
        some, null = split(at, velocity)
        direction = np.linalg.svd(task_rows(robot, q))[2][-1]
        assert np.abs(null.ravel() @ direction) == pytest.approx(1.0, abs=1e-9)

        def cost(
            share: Array, some: Array = some, direction: Array = direction, metric: Array = metric
        ) -> float:
            rate = some + direction * share[0]
            return float(rate @ metric @ rate)

        searched = minimize(cost, np.zeros(1), method="BFGS", options={"gtol": 1e-9})
        share = least_energy(at, some, null)
        assert not isinstance(share, Failure), share
        found = some + null @ share
        np.testing.assert_allclose(found, some + direction * searched.x[0], atol=1e-6 * np.abs(found).max())
        assert found @ metric @ found <= searched.fun * (1.0 + 1e-12)


@pytest.mark.parametrize("method", PLANNERS)
@pytest.mark.parametrize("kind", ["other mounts", "spatial"])
def test_other_robots_follow_their_paths(method, kind):
    # In space zeta = 0 soon asks for fast joints: near home two motions of the null space hardly turn the
    # end-effectors (singular value 0.05), so the goals are near.
    robot = robot_of("spatial") if kind == "spatial" else robot_of("planar", MOUNTS)
    capture = near(robot, robot.home, 0.05) if kind == "spatial" else near(robot, START, 0.25)
    plan = PLANNERS[method](robot, capture)
    assert isinstance(plan, CapturePlan), plan
    time = np.linspace(0.0, plan.time[-1], 997)
    q, rate, _ = plan.sample(time)
    assert np.abs(robot.base_twist(q, rate)[:, 3:]).max() < 1e-8
    centre = robot.centre_of_mass(robot.kinematics(capture.start))
    end = end_effectors(robot, q[-1]).position + centre - robot.centre_of_mass(robot.kinematics(q[-1]))
    np.testing.assert_allclose(end, capture.position, atol=1e-6)
    np.testing.assert_allclose(q[0], capture.start, atol=0.0)


def test_local_needs_least_at_each_instant():
    """At one configuration and time of (a), the rates that (b) would choose cost no more."""
    model, plan = PathModel.of(robot_of()), canonical_plan("reactionless")
    for q, rate in zip(plan.position[20::40], plan.rate[20::40], strict=True):
        at = model(q)
        some, null = split(at, (at.task @ rate)[:4])
        share = least_energy(at, some, null)
        assert not isinstance(share, Failure), share
        best = some + null @ share
        assert best @ at.mass @ best <= rate @ at.mass @ rate * (1.0 + 1e-9)


def test_sample_interpolates_and_differentiates():
    plan = canonical_plan("reactionless_local")
    for found, nodes in zip(
        plan.sample(plan.time), (plan.position, plan.rate, plan.acceleration), strict=True
    ):
        np.testing.assert_allclose(found, nodes, atol=1e-9)
    times, step = np.random.default_rng(0).uniform(0.1, 19.9, 200), 1e-5
    position, rate, acceleration = plan.sample(times)
    after, before = plan.sample(times + step), plan.sample(times - step)
    np.testing.assert_allclose((after[0] - before[0]) / (2 * step), rate, atol=1e-8)
    np.testing.assert_allclose((after[1] - before[1]) / (2 * step), acceleration, atol=1e-6)
    assert position.shape == (200, 6)
    assert plan.sample(np.zeros((2, 3)))[0].shape == (2, 3, 6)
    np.testing.assert_array_equal(plan.sample(np.array(99.0))[0], plan.sample(np.array(20.0))[0])


@pytest.mark.parametrize("method", PLANNERS)
def test_out_of_reach_is_a_typed_failure(method):
    found = PLANNERS[method](robot_of(), canonical(position=GOALS + np.array([3.0, 0.0, 0.0])))
    assert isinstance(found, Failure)
    assert (found.method, found.cause) == (method, Cause.OUT_OF_REACH)
    assert "reach" in found.reason and " m" in found.reason


@pytest.mark.parametrize("method", PLANNERS)
def test_singular_path_is_a_typed_failure(method):
    """The goal of arm 1 is within the sum of its links, yet not with where the rest has to be."""
    goals = GOALS.copy()
    robot = robot_of()
    centre = robot.centre_of_mass(robot.kinematics(START))
    away = np.array([1.0, 0.35, 0.0]) / np.linalg.norm([1.0, 0.35])
    goals[0] = centre + 0.999 * robot.reach(0) * away
    found = PLANNERS[method](robot, canonical(position=goals))
    assert isinstance(found, Failure)
    assert found.cause is Cause.SINGULAR
    assert "t = " in found.reason


@pytest.mark.parametrize("method", PLANNERS)
def test_joint_limit_is_a_typed_failure(method):
    plan = canonical_plan(method)
    low, high = plan.position.min(axis=0), plan.position.max(axis=0)
    joint = int((high - START).argmax())
    bounds = np.column_stack([low - 0.1, high + 0.1])
    bounds[joint, 1] = 0.5 * (START[joint] + high[joint])
    found = PLANNERS[method](robot_of(), canonical(), Limits(position=bounds))
    assert isinstance(found, Failure)
    assert found.cause is Cause.JOINT_LIMIT
    assert f"joint {joint + 1} " in found.reason
    bounds[joint, 1] = high[joint] + 0.1
    assert isinstance(PLANNERS[method](robot_of(), canonical(), Limits(position=bounds)), CapturePlan)


def test_lost_rank_is_a_typed_failure():
    """The planner's own factorisation has to notice constraints that depend on each other."""
    model = PathModel.of(robot_of())
    at = model(START)
    dependent = at.task.copy()
    dependent[1] = 0.7 * dependent[0] - 0.2 * dependent[4]
    some, null = split(at, np.ones(4))
    for found, message in (
        (solutions(replace(at, task=dependent), np.ones(4)), "depend"),
        (zeta_zero(replace(at, angular=np.zeros((2, 6))), some, null), "null space"),
    ):
        assert isinstance(found, Failure)
        assert found.cause is Cause.SINGULAR
        assert message in found.reason


@pytest.mark.parametrize(
    "changes",
    [
        {"start": START[:5]},
        {"start": np.full(6, np.nan)},
        {"duration": 0.0},
        {"duration": float("nan")},
        {"position": GOALS[:, :2]},
        {"velocity": np.full((2, 3), np.inf)},
        {"axis": np.zeros((2, 3))},
    ],
)
def test_malformed_captures_are_refused(changes):
    with pytest.raises(ConfigurationError):
        plan_zeta_zero(robot_of(), canonical(**changes))
