"""Reactionless motion with free paths (method d): exact, within limits, clear, and low in energy."""

from dataclasses import replace
from functools import cache
from typing import Any

import casadi as ca
import mujoco
import numpy as np
import pytest
from dual_arm_goals import IDS, at_meeting, task_of
from dual_arm_robots import DUAL_ARMS, END_EFFECTORS

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.common.smooth import Smooth
from agents.planners.dual_arm.check import held_dynamics
from agents.planners.dual_arm.clearance import gaps
from agents.planners.dual_arm.free_paths.planner import plan_free
from agents.planners.dual_arm.free_paths.solver import FreePathSolver, clear_program, free_program
from agents.planners.dual_arm.goals import EndGoals, end_configurations, spread
from agents.planners.dual_arm.held_attitude import HeldAttitude
from agents.planners.dual_arm.prescribed_paths.instantaneous import plan_local, plan_zeta_zero
from agents.planners.dual_arm.prescribed_paths.ocp import plan_ocp
from agents.planners.dual_arm.problem import Capture, CapturePlan
from agents.planners.dual_arm.surroundings import Surroundings, tumbling_target
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.errors import ConfigurationError
from space_envs.robots.models import robot_mechanics, robot_model
from space_envs.tasks.goals.tumbling import RENDEZVOUS_TIME

# The canonical planar case: configuration, target and half distance of the grapple points are our reading of
# shah2013, velocities are the paper's; the energy is that of a motion known to exist.
CANONICAL = Capture.at_end(
    start=np.array([0.0, 1.8, -1.5, 0.9, -0.6, 1.0]),
    duration=20.0,
    position=np.array([[2.0, 0.7, 0.0], [2.0, 1.3, 0.0]]),
    velocity=np.array([[-0.01, 0.0, 0.0], [0.01, 0.0, 0.0]]),
)
FAR = Capture.at_end(CANONICAL.start, 20.0, 3.0 * CANONICAL.position, CANONICAL.velocity)
KNOWN_ENERGY = 0.455773  # J s
every_kind = pytest.mark.parametrize("kind", ["planar", "spatial"])


def robot_of(kind: str) -> FloatingRobot:
    return robot_mechanics(DUAL_ARMS[kind])


def drives(kind: str, **changes: Any) -> Limits:
    room = robot_of(kind).range + np.array([0.1, -0.1])
    return replace(Limits(room, rate=0.3, acceleration=0.25, torque=60.0), **changes)


@cache
def cases(kind: str, difficulty: str, count: int) -> list[tuple[Capture, Surroundings]]:
    """Validation goals of the task as planning problems."""
    task = task_of(next(name for name in IDS if kind in name.lower()), difficulty=difficulty)
    goals = task.goals("validation", np.arange(count))
    _, spin, points, axes = at_meeting(task, goals)
    velocity = np.cross(spin[:, None], points - goals.position[:, None])
    found = []
    for k in range(count):
        axis = None if axes is None else axes[k]
        capture = Capture.at_end(goals.joint_position[k], RENDEZVOUS_TIME, points[k], velocity[k], axis)
        motion = tumbling_target(
            goals.position[k],
            goals.quaternion[k],
            goals.angular_velocity[k],
            np.array(task.target.inertia),
        )
        around = Surroundings(
            bus=None if kind == "planar" else np.full(3, 0.5),
            target=np.array(task.target.body) * goals.half_width[k] / task.target.half_width,
            motion=motion,
        )
        found.append((capture, around))
    return found


def planned(kind: str, capture: Capture, limits: Limits, around: Surroundings | None = None) -> CapturePlan:
    plan = plan_free(robot_of(kind), capture, limits, around)
    assert isinstance(plan, CapturePlan), plan
    return plan


@cache
def canonical() -> CapturePlan:
    """The plan of the canonical case within the drives."""
    return planned("planar", CANONICAL, drives("planar"))


class Mujoco:
    """The floating robot in MuJoCo, moved by its joints alone from rest."""

    def __init__(self, kind: str, start: Array) -> None:
        self.model = robot_model(DUAL_ARMS[kind])
        self.data = mujoco.MjData(self.model)
        self._linear, base = (3, 6) if kind == "spatial" else (2, 3)
        self._joints = slice(base, base + len(start))
        self._first = 7 if kind == "spatial" else 3
        self._begin = self._centre(start, np.zeros(3))

    def _centre(self, q: Array, base: Array) -> Array:
        self.data.qpos[:] = self.model.key_qpos[0]
        self.data.qpos[: self._linear] = base[: self._linear]
        self.data.qpos[self._first : self._first + len(q)] = q
        mujoco.mj_fwdPosition(self.model, self.data)
        return self.data.subtree_com[self.model.body("satellite").id].copy()

    def move(self, q: Array, qdot: Array, qddot: Array) -> tuple[Array, Array, Array]:
        """Base rate, base angular acceleration and joint torques; the base keeps the attitude of the start
        and is where the common centre of mass asks for it. Velocities are left in `data`."""
        self._centre(q, self._begin - self._centre(q, np.zeros(3)))
        size, joints, base = self._joints.stop, self._joints, slice(0, self._joints.start)
        mass = np.zeros((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, mass)
        mass = mass[:size, :size]
        self.data.qvel[:] = 0.0
        self.data.qvel[joints] = qdot
        self.data.qvel[base] = -np.linalg.solve(mass[base, base], mass[base, joints] @ qdot)
        mujoco.mj_fwdVelocity(self.model, self.data)
        bias = self.data.qfrc_bias[:size]
        change = -np.linalg.solve(mass[base, base], mass[base, joints] @ qddot + bias[base])
        torque = mass[joints, base] @ change + mass[joints, joints] @ qddot + bias[joints]
        return self.data.qvel[self._linear : base.stop].copy(), change[self._linear :], torque

    def end_effector(self, arm: int) -> tuple[Array, Array, Array]:
        """Position, velocity and approach axis, inertial."""
        site = self.model.site(END_EFFECTORS[arm]).id
        twist = np.empty(6)
        mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_SITE, site, twist, 0)
        return self.data.site_xpos[site], twist[3:], self.data.site_xmat[site].reshape(3, 3)[:, 2]


def check_plan(kind: str, capture: Capture, limits: Limits, plan: CapturePlan) -> None:
    """A plan does what it has to, measured in MuJoCo and at random times between its nodes."""
    robot = robot_of(kind)
    times = np.sort(np.random.default_rng(0).uniform(0.0, plan.time[-1], 200))
    times = np.concatenate([[0.0], times, [plan.time[-1]]])
    q, qdot, qddot = plan.sample(times)
    assert np.abs(robot.base_map(q)[:, 3:] @ qdot[..., None]).max() < 1e-9
    assert plan.time[0] == 0.0 and plan.time[-1] == pytest.approx(capture.duration, rel=1e-12)
    np.testing.assert_allclose(q[0], capture.start, atol=1e-12)
    assert np.abs(qdot[0]).max() < 1e-12 and np.abs(qddot[0]).max() < 1e-9
    # Accelerations are continuous: they change by no more than the splines' jerk allows between nodes.
    jumps = np.abs(np.diff(plan.acceleration, axis=0)) / np.diff(plan.time)[:, None]
    assert jumps.max() < 20.0 * max(np.abs(plan.acceleration).max(), 1e-3)
    if limits.position is not None:
        assert (q >= limits.position[:, 0]).all() and (q <= limits.position[:, 1]).all()
    if limits.rate is not None:
        assert np.abs(qdot).max() <= limits.rate
    if limits.acceleration is not None:
        assert np.abs(qddot).max() <= limits.acceleration
    simulated = Mujoco(kind, capture.start)
    for row in range(0, len(times), 10):
        rate, change, torque = simulated.move(q[row], qdot[row], qddot[row])
        assert np.abs(rate).max() < 1e-9
        assert np.abs(change).max() < 1e-6
        assert limits.torque is None or np.abs(torque).max() <= limits.torque
        np.testing.assert_allclose(
            held_dynamics(robot, q[[row]], qdot[[row]], qddot[[row]])[1][0], torque, atol=1e-5
        )
    simulated.move(q[-1], qdot[-1], qddot[-1])
    for arm in range(2):
        position, velocity, axis = simulated.end_effector(arm)
        np.testing.assert_allclose(position, capture.position[arm], atol=1e-6)
        np.testing.assert_allclose(velocity, capture.velocity[arm], atol=1e-6)
        if capture.axis is not None:
            np.testing.assert_allclose(axis, capture.axis[arm], atol=1e-6)


# Plans ------------------------------------------------------------------------------------------------


def test_canonical_case_needs_no_more_energy_than_a_known_motion() -> None:
    limits = Limits(robot_of("planar").range, rate=0.3, acceleration=0.1, torque=60.0)
    plan = planned("planar", CANONICAL, limits)
    assert plan.energy <= 1.02 * KNOWN_ENERGY
    check_plan("planar", CANONICAL, limits, plan)
    # The energy again, by the trapezoidal rule on the mass matrix of the floating robot.
    mass = SymbolicRobot(robot_of("planar")).reduced_mass.map(len(plan.time))(plan.position.T).full()
    mass = mass.reshape(6, len(plan.time), 6).swapaxes(0, 1)
    power = np.einsum("ki,kij,kj->k", plan.rate, mass, plan.rate)
    assert np.trapezoid(power, plan.time) == pytest.approx(plan.energy, rel=1e-3)
    assert max(plan.violation[name] for name in ("end_position", "end_velocity", "base_rate")) < 1e-9


def test_canonical_case_with_clearance_between_the_arms() -> None:
    # The arms of the optimal motion cross; with clearance between them it costs 2.5 J s, or 13.4 where the
    # solver settles in another optimum.
    limits = Limits(robot_of("planar").range, rate=0.3, acceleration=0.1, torque=60.0)
    around = Surroundings()
    plan = planned("planar", CANONICAL, limits, around)
    check_plan("planar", CANONICAL, limits, plan)
    assert KNOWN_ENERGY < plan.energy < 14.0
    gap = gaps(robot_of("planar"), around, plan.time, plan.position, 20.0, CANONICAL.start)
    assert gap.least >= around.margin


@pytest.mark.parametrize("number", range(4))
def test_planar_plans_are_exact_within_limits_and_clear(number: int) -> None:
    capture, around = cases("planar", "medium", 4)[number]
    plan = planned("planar", capture, drives("planar"), around)
    check_plan("planar", capture, drives("planar"), plan)
    gap = gaps(robot_of("planar"), around, plan.time, plan.position, RENDEZVOUS_TIME, capture.start)
    assert gap.least > 0.0


def test_spatial_plans_reach_places_velocities_and_axes() -> None:
    for capture, around in cases("spatial", "medium", 2):
        plan = planned("spatial", capture, drives("spatial"), around)
        check_plan("spatial", capture, drives("spatial"), plan)
        gap = gaps(robot_of("spatial"), around, plan.time, plan.position, RENDEZVOUS_TIME, capture.start)
        assert gap.least > 0.0


def test_limits_of_any_size_are_satisfied() -> None:
    free = planned("planar", CANONICAL, Limits())
    energies = [free.energy]
    narrow = np.tile([-2.0, 2.0], (6, 1))
    for changes in ({"rate": 0.06}, {"acceleration": 0.01}, {"torque": 0.5}, {"position": narrow}):
        limits = drives("planar", **changes)
        plan = planned("planar", CANONICAL, limits)
        check_plan("planar", CANONICAL, limits, plan)
        energies.append(plan.energy)
    assert min(energies) == free.energy


def test_other_durations_scale_the_motion() -> None:
    # Without limits the motion is the same at every speed, but for the velocities at its end.
    rest = Capture.at_end(CANONICAL.start, CANONICAL.duration, CANONICAL.position, np.zeros((2, 3)))
    slow = planned("planar", replace(rest, duration=40.0), Limits())
    fast = planned("planar", replace(rest, duration=10.0), Limits())
    assert fast.energy == pytest.approx(4.0 * slow.energy, rel=1e-6)
    np.testing.assert_allclose(fast.position, slow.position, atol=1e-4)


def test_motion_is_led_around_a_target_on_its_path() -> None:
    free = canonical()
    robot, middle = robot_of("planar"), len(free.time) // 2
    # A small box where arm 2 passes halfway, away from start and end.
    point = robot.end_effector_pose(free.position[middle], 1)[0]
    shift = robot.centre_of_mass(robot.kinematics(CANONICAL.start)) - robot.centre_of_mass(
        robot.kinematics(free.position[middle])
    )

    def still(times: Array) -> tuple[Array, Array]:
        return np.tile(point + shift, (len(times), 1)), np.tile([1.0, 0.0, 0.0, 0.0], (len(times), 1))

    around = Surroundings(target=np.array([0.03, 0.03, 0.1]), motion=still, arms=False)

    def gap(plan: CapturePlan) -> float:
        return gaps(robot, around, plan.time, plan.position, 20.0, CANONICAL.start).least

    assert gap(free) < -0.05
    plan = planned("planar", CANONICAL, drives("planar"), around)
    assert gap(plan) >= around.margin
    assert free.energy < plan.energy < 2.0 * free.energy
    assert "led around" in plan.notes
    check_plan("planar", CANONICAL, drives("planar"), plan)


# Failures ---------------------------------------------------------------------------------------------


def still_at(centre: list[float]) -> Surroundings:
    """A box that rests."""

    def still(times: Array) -> tuple[Array, Array]:
        return np.tile(centre, (len(times), 1)), np.tile([1.0, 0.0, 0.0, 0.0], (len(times), 1))

    return Surroundings(target=np.array([0.2, 0.2, 0.2]), motion=still)


@pytest.mark.parametrize(
    ("capture", "limits", "around", "cause", "message"),
    [
        (FAR, {}, None, Cause.OUT_OF_REACH, "reach"),
        (
            CANONICAL,
            {"position": CANONICAL.start[:, None] + np.array([-0.05, 0.05])},
            None,
            Cause.OUT_OF_REACH,
            "joint limits",
        ),
        (CANONICAL, {"position": np.tile([-1.0, 1.5], (6, 1))}, None, Cause.JOINT_LIMIT, "joint 3"),
        (replace(CANONICAL, duration=2.0), {}, None, Cause.INFEASIBLE, "0.3 rad/s"),
        (CANONICAL, {"torque": 0.02}, None, Cause.INFEASIBLE, "0.02 N m"),
        (CANONICAL, {}, still_at([1.27, 0.97, 0.0]), Cause.CLEARANCE, "start"),
        (CANONICAL, {}, still_at([2.0, 0.7, 0.0]), Cause.CLEARANCE, "end"),
    ],
)
def test_failures_have_cause_and_reason(
    capture: Capture, limits: dict, around: Surroundings | None, cause: Cause, message: str
) -> None:
    found = plan_free(robot_of("planar"), capture, drives("planar", **limits), around)
    assert isinstance(found, Failure), found
    assert (found.cause, found.method) == (cause, "reactionless_free")
    assert message in found.reason


def test_a_malformed_capture_is_refused() -> None:
    with pytest.raises(ConfigurationError, match="start"):
        plan_free(robot_of("planar"), replace(CANONICAL, start=np.zeros(5)))


# Parts ------------------------------------------------------------------------------------------------


@every_kind
def test_held_attitude_is_the_floating_robot_on_reactionless_motion(kind: str) -> None:
    robot, model = robot_of(kind), HeldAttitude.of(robot_of(kind))
    q, u, udot = np.random.default_rng(3).normal(size=(3, robot.n_joints))
    rate, acceleration = (out.full()[:, 0] for out in model.accelerated(q, u, udot))
    np.testing.assert_array_equal(model.projected(q, u).full()[:, 0], rate)
    assert np.abs(robot.base_map(q)[3:] @ rate).max() < 1e-12
    symbolic = SymbolicRobot(robot)
    assert float(model.energy.value(q, rate)) == pytest.approx(rate @ symbolic.reduced_mass(q).full() @ rate)
    energy, torque = held_dynamics(robot, q[None], rate[None], acceleration[None])
    assert energy[0] == pytest.approx(float(model.energy.value(q, rate)))
    expected = symbolic.inverse_dynamics(q, rate, acceleration).full()[:, 0]
    np.testing.assert_allclose(torque[0], expected, atol=1e-9)
    # The acceleration belongs to the rate as the joints move.
    ahead, behind = (
        model.projected(q + s * 1e-6 * rate, u + s * 1e-6 * udot).full()[:, 0] for s in (1.0, -1.0)
    )
    np.testing.assert_allclose((ahead - behind) / 2e-6, acceleration, rtol=1e-6, atol=1e-7)
    d = model.dimensions
    end = model.ending.value(q, rate, np.zeros((3, 4))).full()[:, 0]
    centre = robot.centre_of_mass(robot.kinematics(q))
    for arm in range(2):
        place = slice(d * arm, d * arm + d)
        position, _ = robot.end_effector_pose(q, arm)
        np.testing.assert_allclose(end[place], (position - centre)[:d], atol=1e-12)
        velocity = robot.generalized_jacobian(q, arm)[:3] @ rate
        np.testing.assert_allclose(end[2 * d :][place], velocity[:d], atol=1e-12)


@every_kind
def test_derivatives_of_the_functions_agree_with_differences(kind: str) -> None:
    model, n = HeldAttitude.of(robot_of(kind)), robot_of(kind).n_joints
    random = np.random.default_rng(4)
    y, direction = random.normal(size=(2, 2 * n))
    for f, extra in (
        (model.energy, []),
        (model.angular_momentum, []),
        (model.ending, [random.normal(size=(3, 4))]),
    ):
        outputs = f.value.numel_out(0)
        weight = random.normal(size=outputs)

        def at(point: Array, f: Smooth = f, extra: list = extra) -> tuple[Array, Array]:
            value, slope = (part(point[:n], point[n:], *extra).full() for part in (f.value, f.slope))
            return value[:, 0], slope

        (high, high_slope), (low, low_slope) = at(y + 1e-6 * direction), at(y - 1e-6 * direction)
        np.testing.assert_allclose(at(y)[1] @ direction, (high - low) / 2e-6, rtol=1e-6, atol=1e-6)
        bend = f.bend(y[:n], y[n:], *extra, weight).full()
        np.testing.assert_allclose(bend, bend.T, atol=1e-10)
        expected = weight @ (high_slope - low_slope) / 2e-6
        np.testing.assert_allclose(bend @ direction, expected, rtol=1e-6, atol=1e-5)


def test_derivatives_of_the_program_agree_with_differences() -> None:
    free, clear = free_program(robot_of("planar")), clear_program(robot_of("planar"))
    random = np.random.default_rng(5)
    for program in (free, clear):
        sizes = program.solver.size1_in("x0"), program.solver.size1_in("p"), program.solver.size1_out("g")
        x, direction = random.normal(size=(2, sizes[0]))
        p, multiplier = 0.3 * random.normal(size=sizes[1]), random.normal(size=sizes[2])
        parts = [program.solver.get_function(f"nlp_{name}") for name in ("grad_f", "jac_g", "hess_l")]

        def at(point: Array, p: Array = p, parts: list = parts) -> list[Array]:
            return [out.full() for part in parts[:2] for out in part(point, p)]

        high, low, here = at(x + 1e-6 * direction), at(x - 1e-6 * direction), at(x)
        scale = np.abs(here[1]).max()
        rise = float((high[0] - low[0]).item()) / 2e-6
        assert rise == pytest.approx(float((here[1].T @ direction).item()), rel=1e-5, abs=1e-6 * scale)
        np.testing.assert_allclose(here[3] @ direction, (high[2] - low[2])[:, 0] / 2e-6, rtol=1e-5, atol=1e-3)
        if program is free:  # the cost of nearness has Gauss and Newton's approximation only
            bend = ca.triu2symm(parts[2](x, p, 1.7, multiplier)).full()
            slopes = [1.7 * side[1][:, 0] + side[3].T @ multiplier for side in (high, low)]
            np.testing.assert_allclose(
                bend @ direction, (slopes[0] - slopes[1]) / 2e-6, rtol=1e-4, atol=1e-6 * np.abs(bend).max()
            )


@every_kind
def test_end_configurations_reach_the_goal_and_lie_apart(kind: str) -> None:
    robot, model = robot_of(kind), HeldAttitude.of(robot_of(kind))
    capture = cases(kind, "medium", 2)[1][0]
    ends = end_configurations(robot, model, capture, drives(kind), "test", 24)
    assert not isinstance(ends, Failure) and len(ends) > 4
    origin = robot.centre_of_mass(robot.kinematics(capture.start))
    base = origin - robot.centre_of_mass(robot.kinematics(ends))
    goals = EndGoals.of(robot, model, capture)
    assert (
        np.abs(goals.across[:, :2].T @ goals.across[:, :2] - (capture.axis is not None) * np.eye(2)).max()
        < 1e-12
    )
    for arm in range(2):
        position, rotation = robot.end_effector_pose(ends, arm)
        np.testing.assert_allclose(position + base, np.tile(capture.position[arm], (len(ends), 1)), atol=1e-5)
        if capture.axis is not None:
            np.testing.assert_allclose(
                rotation[..., 2], np.tile(capture.axis[arm], (len(ends), 1)), atol=1e-5
            )
    limits = drives(kind).position
    assert limits is not None and (ends >= limits[:, 0]).all() and (ends <= limits[:, 1]).all()
    chosen = spread(ends, 4)
    np.testing.assert_array_equal(chosen[0], ends[0])
    apart = np.linalg.norm(ends - ends[0], axis=1)
    np.testing.assert_array_equal(chosen[1], ends[apart.argmax()])


# Many cases -------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_free_paths_beat_given_ones_on_nearly_all_cases() -> None:
    better, savings = [], []
    for capture, _ in cases("planar", "hard", 60):
        given = plan_ocp(robot_of("planar"), capture, drives("planar"), from_rest=True)
        if isinstance(given, CapturePlan):
            free = planned("planar", capture, drives("planar"))
            better.append(free.energy <= given.energy)
            savings.append(1.0 - free.energy / given.energy)
    assert len(better) >= 20
    assert np.mean(better) >= 0.95
    assert np.median(savings) >= 0.3


@pytest.mark.slow
@every_kind
@pytest.mark.parametrize("difficulty", ["easy", "medium", "hard"])
def test_nearly_all_goals_of_the_tasks_have_a_plan(kind: str, difficulty: str) -> None:
    found = []
    for capture, around in cases(kind, difficulty, 24):
        plan = plan_free(robot_of(kind), capture, drives(kind), around)
        found.append(isinstance(plan, CapturePlan))
        if isinstance(plan, CapturePlan):
            check_plan(kind, capture, drives(kind), plan)
            gap = gaps(robot_of(kind), around, plan.time, plan.position, RENDEZVOUS_TIME, capture.start)
            assert gap.least > 0.0
        else:
            assert plan.cause == Cause.CLEARANCE
    assert np.mean(found) >= 0.9


PATH_METHODS = (plan_zeta_zero, plan_local, plan_ocp)


def test_no_motion_along_given_paths_costs_less() -> None:
    """They are among the starts, so that none of them is better than what comes of it."""
    for capture, _ in [(CANONICAL, None), *cases("planar", "medium", 2)]:
        plan = canonical() if capture is CANONICAL else planned("planar", capture, drives("planar"))
        assert "from 7 starts" in plan.notes
        for method in PATH_METHODS:
            given = method(robot_of("planar"), capture, Limits(position=drives("planar").position))
            assert not isinstance(given, CapturePlan) or plan.energy <= given.energy


@pytest.mark.slow
@every_kind
def test_free_paths_need_at_most_the_energy_of_given_ones(kind: str) -> None:
    """For every goal, within the same limits; in space (a) and (b) solve the same problem with any axes."""
    robot, limits, compared = robot_of(kind), drives(kind), 0
    for capture, _ in cases(kind, "medium", 8):
        for aligned in {capture.aligned, False}:
            goal = replace(capture, aligned=aligned)
            given = [plan_ocp(robot, goal, limits, from_rest=True)]
            given += [] if aligned else [plan(robot, goal, limits) for plan in PATH_METHODS[:2]]
            energies = [plan.energy for plan in given if isinstance(plan, CapturePlan)]
            if energies:
                assert planned(kind, goal, limits).energy <= min(energies) * (1.0 + 1e-9)
                compared += 1
    assert compared >= 6


@every_kind
def test_where_no_search_ends_the_best_given_motion_is_the_plan(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    capture, _ = cases(kind, "medium", 1)[0]
    capture = replace(capture, aligned=False)
    monkeypatch.setattr(
        FreePathSolver,
        "solve",
        lambda *_, **__: Failure("test", Cause.SOLVER, "Maximum_Iterations_Exceeded", 1.0),
    )
    plan = plan_free(robot_of(kind), capture, Limits())
    known = [method(robot_of(kind), capture, Limits()) for method in PATH_METHODS[:2]]
    known.append(plan_ocp(robot_of(kind), capture, Limits(), from_rest=True))
    energies = [given.energy for given in known if isinstance(given, CapturePlan)]
    assert isinstance(plan, CapturePlan) and plan.method == "reactionless_free"
    assert plan.energy == pytest.approx(min(energies)) and "no search improved" in plan.notes
    # Where it breaks a limit it is none.
    most = float(np.abs(plan.rate).max())
    assert isinstance(plan_free(robot_of(kind), capture, Limits(rate=0.2 * most)), Failure)
