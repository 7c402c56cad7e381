"""Optimal control along given paths: its value, that it is stationary, its bounds, and how it refuses."""

from functools import cache

import numpy as np
import pytest
from dual_arm_robots import DUAL_ARMS

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.prescribed_paths.instantaneous import plan_local, plan_zeta_zero
from agents.planners.dual_arm.prescribed_paths.ocp import plan_ocp
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.problem import Capture, CapturePlan
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.reactionless import end_effectors
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.errors import ConfigurationError
from space_envs.robots.models import robot_mechanics

# The canonical case of the lost Fig. 1 of shah2013 and its energies, J s, found by two implementations.
CANONICAL = Capture.at_end(
    start=np.array([0.0, 1.8, -1.5, 0.9, -0.6, 1.0]),
    duration=20.0,
    position=np.array([[2.0, 0.7, 0.0], [2.0, 1.3, 0.0]]),
    velocity=np.array([[-0.01, 0.0, 0.0], [0.01, 0.0, 0.0]]),
)
FREE_START, FROM_REST = 0.750548977, 0.750552310
ACCELERATION = 0.1  # rad/s^2
MOUNTS = ((0.4, 0.3), (-0.3, 0.4))


@cache
def robot_of(mounts: tuple[tuple[float, float], ...] | None = None) -> FloatingRobot:
    planar = DUAL_ARMS["planar"]
    return robot_mechanics(planar if mounts is None else planar.mounted_at(mounts))


def planned(
    robot: FloatingRobot, capture: Capture, limits: Limits = Limits(), rest: bool = False
) -> CapturePlan:
    plan = plan_ocp(robot, capture, limits, from_rest=rest)
    assert isinstance(plan, CapturePlan), plan
    return plan


@cache
def canonical_plan(rest: bool = False) -> CapturePlan:
    return planned(robot_of(), CANONICAL, Limits(acceleration=ACCELERATION) if rest else Limits(), rest)


def random_capture(robot: FloatingRobot, seed: int) -> Capture:
    """Near the canonical start: another posture, duration, end and end velocity."""
    rng = np.random.default_rng(seed)
    start = CANONICAL.start + rng.uniform(-0.3, 0.3, 6)
    there = start + rng.uniform(-0.35, 0.35, 6)
    base = robot.centre_of_mass(robot.kinematics(start)) - robot.centre_of_mass(robot.kinematics(there))
    velocity = np.zeros((2, 3))
    velocity[:, :2] = rng.uniform(-0.02, 0.02, (2, 2))
    return Capture.at_end(
        start, float(rng.uniform(10.0, 30.0)), end_effectors(robot, there).position + base, velocity
    )


def dense(plan: CapturePlan) -> tuple[Array, Array, Array, Array]:
    time = np.linspace(0.0, plan.time[-1], 5003)
    return (time, *plan.sample(time))


def cost_beside(
    robot: FloatingRobot, capture: Capture, plan: CapturePlan, bumps: Array, steps: int = 240
) -> Array:
    """C (B,) of motions whose control differs from the plan's by columns of `bumps` (2 steps + 1, B).

    The control is the share of the null space, of unit length in I_m: C counts its square. Numpy alone,
    classical Runge-Kutta.
    """
    mass_of = SymbolicRobot(robot).reduced_mass
    place = end_effectors(robot, capture.start).position[:, :2].ravel()
    ends = capture.position[:, :2].ravel(), np.zeros(4), capture.velocity[:, :2].ravel()
    path = PolynomialPath(place, *ends, capture.duration)

    def split(q: Array, time: float) -> tuple[Array, Array, Array]:
        now = end_effectors(robot, q)
        rows = np.concatenate([now.linear[:, :, :2].reshape(-1, 4, 6), now.base_angular[:, 2:]], axis=1)
        mass = np.array(mass_of(np.ascontiguousarray(q.T))).reshape(6, -1, 6).transpose(1, 0, 2)
        direction = np.linalg.svd(rows)[2][:, -1]
        direction = (
            direction * np.sign(np.linalg.det(np.concatenate([rows, direction[:, None]], axis=1)))[:, None]
        )
        pushed = (mass @ direction[..., None])[..., 0]
        direction = direction / np.sqrt((pushed * direction).sum(axis=1))[:, None]
        pushed = (mass @ direction[..., None])[..., 0]
        some = np.linalg.pinv(rows) @ np.append(path.velocity(time), 0.0)
        return some - direction * (pushed * some).sum(axis=1)[:, None], direction, mass

    half = 0.5 * capture.duration / steps
    at, rate, _ = plan.sample(half * np.arange(2 * steps + 1))
    control = np.empty(2 * steps + 1)
    for k in range(len(control)):
        _, direction, mass = split(at[k : k + 1], k * half)
        control[k] = direction[0] @ mass[0] @ rate[k]

    def law(q: Array, k: int) -> tuple[Array, Array]:
        least, direction, mass = split(q, k * half)
        found = least + direction * (control[k] + bumps[k])[:, None]
        return found, (found * (mass @ found[..., None])[..., 0]).sum(axis=1)

    q, total, h = np.tile(capture.start, (bumps.shape[1], 1)), np.zeros(bumps.shape[1]), 2 * half
    for step in range(steps):
        k1, e1 = law(q, 2 * step)
        k2, e2 = law(q + half * k1, 2 * step + 1)
        k3, e3 = law(q + half * k2, 2 * step + 1)
        k4, e4 = law(q + h * k3, 2 * step + 2)
        q = q + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        total = total + h / 6 * (e1 + 2 * e2 + 2 * e3 + e4)
    return total


def test_canonical_energy_with_a_free_start():
    plan = canonical_plan()
    assert plan.energy == pytest.approx(FREE_START, rel=1e-6)
    assert plan.violation["base_rate"] < 1e-9
    assert plan.violation["path"] < 1e-7
    assert np.abs(plan.rate[0]).max() > 1e-3


def test_canonical_energy_from_rest():
    plan = canonical_plan(rest=True)
    assert plan.energy == pytest.approx(FROM_REST, rel=1e-4)
    assert plan.energy >= canonical_plan().energy


def test_from_rest_starts_at_rest_and_keeps_the_acceleration_bound_between_nodes():
    robot = robot_of()
    for capture in (CANONICAL, random_capture(robot, 1)):
        plan = planned(robot, capture, Limits(acceleration=ACCELERATION), rest=True)
        _, _, rate, acceleration = dense(plan)
        assert np.abs(rate[0]).max() < 1e-6
        assert np.abs(acceleration).max() <= ACCELERATION * (1.0 + 1e-4)


def test_control_is_stationary():
    """Changes of the control of either sign cost more, to second order only."""
    time = np.linspace(0.0, 20.0, 481)
    size = 0.02
    shapes = [np.exp(-(((time - centre) / 2.0) ** 2)) for centre in (3.0, 9.0, 15.0)]
    bumps = np.column_stack([np.zeros(481), *(sign * size * each for each in shapes for sign in (1, -1))])
    cost = cost_beside(robot_of(), CANONICAL, canonical_plan(), bumps)
    assert cost[0] == pytest.approx(FREE_START, rel=1e-6)
    above, below = cost[1::2] - cost[0], cost[2::2] - cost[0]
    assert (above > 0.0).all() and (below > 0.0).all()
    assert (np.abs(above - below) < 0.05 * (above + below)).all()


@pytest.mark.parametrize("seed", [1, 2, 3, 6])
def test_never_worse_than_the_methods_that_do_not_look_ahead(seed):
    robot = robot_of() if seed % 2 else robot_of(MOUNTS)
    capture = random_capture(robot, seed)
    plan = planned(robot, capture)
    others = [each(robot, capture) for each in (plan_zeta_zero, plan_local)]
    energies = [other.energy for other in others if isinstance(other, CapturePlan)]
    assert energies
    assert plan.energy <= min(energies) * (1.0 + 1e-9)
    time, q, rate, _ = dense(plan)
    assert np.abs(robot.base_twist(q, rate)[:, 5]).max() < 1e-8
    centre = robot.centre_of_mass(robot.kinematics(capture.start))
    k = robot.kinematics(q)
    place = end_effectors(robot, q, k).position + (centre - robot.centre_of_mass(k))[:, None]
    path = PolynomialPath(
        place[0].ravel(), capture.position.ravel(), np.zeros(6), capture.velocity.ravel(), capture.duration
    )
    assert np.abs(place.reshape(len(time), 6) - path.position(time)).max() < 1e-6
    np.testing.assert_allclose(place[-1], capture.position, atol=1e-6)


def test_joint_and_rate_bounds_are_satisfied_between_nodes():
    robot, free = robot_of(), canonical_plan()
    _, q, rate, _ = dense(free)
    fastest = float(np.abs(rate).max())
    plan = planned(robot, CANONICAL, Limits(rate=0.97 * fastest))
    _, _, slower, _ = dense(plan)
    assert np.abs(slower).max() <= 0.97 * fastest * (1.0 + 1e-5)
    assert plan.energy > free.energy


def test_control_bound_is_satisfied():
    robot, free = robot_of(), canonical_plan()
    assert free.zeta is not None
    bound = 0.8 * float(np.linalg.norm(free.zeta, axis=1).max())
    plan = planned(robot, CANONICAL, Limits(control=bound))
    assert plan.zeta is not None
    assert np.linalg.norm(plan.zeta, axis=1).max() <= bound * (1.0 + 1e-3)
    assert plan.energy > free.energy


def test_time_and_size_scale_as_they_must():
    """Twice the time, half the end velocities: the same curve at half the speed, half the energy."""
    slow = Capture.at_end(CANONICAL.start, 40.0, CANONICAL.position, 0.5 * CANONICAL.velocity)
    assert planned(robot_of(), slow).energy == pytest.approx(0.5 * FREE_START, rel=1e-6)


def test_refusals_are_typed():
    robot = robot_of()
    there = CANONICAL.position + np.array([3.0, 0.0, 0.0])
    far = Capture.at_end(CANONICAL.start, 20.0, there, CANONICAL.velocity)
    found = plan_ocp(robot, far)
    assert isinstance(found, Failure)
    assert (found.method, found.cause) == ("reactionless_ocp", Cause.OUT_OF_REACH)
    tight = plan_ocp(robot, CANONICAL, Limits(rate=0.01))
    assert isinstance(tight, Failure)
    assert tight.cause is Cause.INFEASIBLE
    assert tight.reason


@pytest.mark.parametrize("seed", [0, 4])
def test_singular_captures_are_failures_of_every_method(seed):
    robot = robot_of(MOUNTS)
    capture = random_capture(robot, seed)
    for each in (plan_zeta_zero, plan_local):
        found = each(robot, capture)
        assert isinstance(found, Failure)
        assert found.cause is Cause.SINGULAR
    found = plan_ocp(robot, capture)
    assert isinstance(found, Failure)
    assert "singular at t = " in found.reason


def test_space_is_refused_by_name():
    robot = robot_mechanics(DUAL_ARMS["spatial"])
    capture = Capture.at_end(robot.home, 20.0, np.zeros((2, 3)), np.zeros((2, 3)))
    with pytest.raises(ConfigurationError, match="planar"):
        plan_ocp(robot, capture)
