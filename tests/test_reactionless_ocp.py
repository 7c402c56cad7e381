"""Optimal control along given paths: its value, that it is stationary, its bounds, and how it refuses."""

from functools import cache
from pathlib import Path

import mujoco
import numpy as np
import pytest
from dual_arm_robots import DUAL_ARMS, END_EFFECTORS

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.dual_arm.prescribed_paths.instantaneous import plan_local, plan_zeta_zero
from agents.planners.dual_arm.prescribed_paths.ocp import plan_ocp
from agents.planners.dual_arm.prescribed_paths.polynomial import PolynomialPath
from agents.planners.dual_arm.problem import Capture, CapturePlan
from reproduce.shah2013.cases import Sampler
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.reactionless import end_effectors
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.robots.models import robot_mechanics, robot_model
from space_envs.robots.zoo import find_robot

# The canonical case of the lost Fig. 1 of shah2013 and its energies, J s, found by two implementations.
CANONICAL = Capture.at_end(
    start=np.array([0.0, 1.8, -1.5, 0.9, -0.6, 1.0]),
    duration=20.0,
    position=np.array([[2.0, 0.7, 0.0], [2.0, 1.3, 0.0]]),
    velocity=np.array([[-0.01, 0.0, 0.0], [0.01, 0.0, 0.0]]),
)
FREE_START, FROM_REST = 0.750548977, 0.750552310
ACCELERATION = 0.1  # rad/s^2
ROBOTS = Path(__file__).parent / "data" / "robots"
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


def test_zeta_is_searched_for_a_way_past_singularities():
    """A drawn case whose path zeta = 0, the local choice and the optima near them do not follow."""
    robot, capture = robot_of(), Sampler().draw(0, 56).capture
    for each in (plan_zeta_zero, plan_local):
        found = each(robot, capture)
        assert isinstance(found, Failure) and found.cause is Cause.SINGULAR
    plan = planned(robot, capture, Limits(position=robot.range))
    assert "passage" in plan.notes
    _, q, rate, _ = dense(plan)
    assert np.abs(robot.base_twist(q, rate)[:, 5]).max() < 1e-8
    assert np.abs(rate).max() < 2.0
    np.testing.assert_allclose(plan.violation["path"], 0.0, atol=1e-6)


# In space ----------------------------------------------------------------------------------------------


@cache
def spatial_capture(name: str = "spatial", aligned: bool = False) -> Capture:
    """A capture whose ends are those of a posture near home."""
    robot, rng = robot_of_name(name), np.random.default_rng(5)
    there = robot.home + rng.uniform(-0.15, 0.15, robot.n_joints)
    base = robot.centre_of_mass(robot.kinematics(robot.home)) - robot.centre_of_mass(robot.kinematics(there))
    axis = end_effectors(robot, there).axis if aligned else None
    return Capture.at_end(
        robot.home,
        20.0,
        end_effectors(robot, there).position + base,
        np.array([[-0.01, 0.0, 0.005], [0.01, 0.002, 0.0]]),
        axis,
    )


@cache
def robot_of_name(name: str) -> FloatingRobot:
    return robot_mechanics(DUAL_ARMS.get(name) or find_robot(str(ROBOTS / f"{name}.toml")))


@cache
def spatial_plan(aligned: bool = False, rest: bool = False) -> CapturePlan:
    limits = Limits(rate=0.3, acceleration=0.25) if rest else Limits()
    return planned(robot_of_name("spatial"), spatial_capture(aligned=aligned), limits, rest)


@pytest.mark.parametrize(("aligned", "rest"), [(False, False), (True, True)])
def test_spatial_plans_are_reactionless_on_their_paths_in_mujoco(aligned: bool, rest: bool) -> None:
    """On a dense grid: the base does not turn, and the end-effectors are on their polynomials."""
    plan, capture = spatial_plan(aligned, rest), spatial_capture(aligned=aligned)
    model = robot_model(DUAL_ARMS["spatial"])
    data = mujoco.MjData(model)
    satellite = model.body("satellite").id
    sites = [model.site(name).id for name in END_EFFECTORS]
    mass, path = np.zeros((model.nv, model.nv)), None
    for time in np.linspace(0.0, capture.duration, 401):
        q, rate, _ = plan.sample(time)
        data.qpos[:] = model.key_qpos[0]
        data.qpos[:7], data.qpos[7 : 7 + len(q)] = [0, 0, 0, 1, 0, 0, 0], q
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fullM(model, data, mass)
        size = 6 + len(q)
        base = -np.linalg.solve(mass[:6, :6], mass[:6, 6:size] @ rate)
        assert np.abs(base[3:]).max() < 1e-8
        centre = data.subtree_com[satellite]
        if path is None:
            first = np.concatenate([data.site_xpos[site] - centre for site in sites])
            ends = (capture.position - centre).ravel()
            path = PolynomialPath(first, ends, np.zeros(6), capture.velocity.ravel(), capture.duration)
        now = np.concatenate([data.site_xpos[site] - centre for site in sites])
        np.testing.assert_allclose(now, path.position(time), atol=1e-6)
    if aligned:
        assert capture.axis is not None
        axes = np.array([data.site_xmat[site].reshape(3, 3)[:, 2] for site in sites])
        assert (np.cross(axes, capture.axis) ** 2).sum(axis=1).max() < 1e-10
        assert ((axes * capture.axis).sum(axis=1) > 0.0).all()


@pytest.mark.parametrize("aligned", [False, True])
def test_spatial_energies_by_a_quadrature_of_the_mass_matrix(aligned: bool) -> None:
    plan, robot = spatial_plan(aligned, aligned), robot_of_name("spatial")
    time, q, rate, _ = dense(plan)
    mass_of = SymbolicRobot(robot).reduced_mass.map(len(time))
    mass = mass_of(q.T).full().reshape(14, -1, 14).swapaxes(0, 1)
    power = np.einsum("ki,kij,kj->k", rate, mass, rate)
    assert np.trapezoid(power, time) == pytest.approx(plan.energy, rel=1e-5)


def test_spatial_optimum_is_below_the_instantaneous_ones_and_stationary() -> None:
    """Nearby motions along the same paths cost more: those that are led aside by bumps in the null space."""
    robot, capture, plan = robot_of_name("spatial"), spatial_capture(), spatial_plan()
    for each in (plan_zeta_zero, plan_local):
        other = each(robot, capture)
        assert not isinstance(other, CapturePlan) or plan.energy < other.energy
    rng = np.random.default_rng(1)
    directions = rng.normal(size=(2, 14))
    excess = [led_aside(robot, capture, plan, 0.003 * sign * each) for each in directions for sign in (1, -1)]
    at_zero = led_aside(robot, capture, plan, np.zeros(14))
    assert at_zero == pytest.approx(plan.energy, rel=1e-5)
    assert min(excess) > at_zero
    above, below = np.array(excess[::2]) - at_zero, np.array(excess[1::2]) - at_zero
    assert (np.abs(above - below) < 0.2 * (above + below)).all()


def led_aside(robot: FloatingRobot, capture: Capture, plan: CapturePlan, direction: Array) -> float:
    """C of the motion along the same paths that follows the plan's rates in the null space, changed by a bump
    along `direction` (n,) rad/s. Numpy alone, classical Runge-Kutta."""
    reduced = SymbolicRobot(robot).reduced_mass
    centre = robot.centre_of_mass(robot.kinematics(capture.start))
    first = (end_effectors(robot, capture.start).position - centre).ravel()
    ends = (capture.position - centre).ravel()
    path = PolynomialPath(first, ends, np.zeros(6), capture.velocity.ravel(), capture.duration)

    def law(time: float, q: Array) -> Array:
        now = end_effectors(robot, q)
        rows = np.concatenate([now.linear.reshape(6, -1), now.base_angular])
        inverse = np.linalg.pinv(rows)
        _, rate, _ = plan.sample(np.array(time))
        bump = direction * np.exp(-(((time - 9.0) / 3.0) ** 2))
        wanted = rate + bump
        return wanted + inverse @ (np.append(path.velocity(time), np.zeros(3)) - rows @ wanted)

    q, steps, total = capture.start, 80, 0.0
    h = capture.duration / steps
    for step in range(steps):
        t = step * h
        k = [law(t, q)]
        for share in (0.5, 0.5, 1.0):
            k.append(law(t + share * h, q + share * h * k[-1]))
        places = q, q + 0.5 * h * k[0], q + 0.5 * h * k[1], q + h * k[2]
        power = [float(each @ reduced(at).full() @ each) for at, each in zip(places, k, strict=True)]
        total += h / 6 * (power[0] + 2 * power[1] + 2 * power[2] + power[3])
        q = q + h / 6 * (k[0] + 2 * k[1] + 2 * k[2] + k[3])
    return total


def test_other_robots_with_two_arms_in_space() -> None:
    robot = robot_of_name("spatial_six_and_six")
    capture = spatial_capture("spatial_six_and_six")
    plan = planned(robot, capture)
    _, q, rate, _ = dense(plan)
    assert np.abs(robot.base_map(q)[:, 3:] @ rate[..., None]).max() < 1e-8
    others = [each(robot, capture) for each in (plan_zeta_zero, plan_local)]
    assert all(plan.energy <= other.energy for other in others if isinstance(other, CapturePlan))
