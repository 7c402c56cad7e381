"""Optimal control of the single arm: derivatives, known costs, limits, refusals; measured independently."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from known_reaches import KNOWN, OUT_OF_REACH, ROBOT, drives, reach_of, robot

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.check import check
from agents.planners.single_arm.collocation.assembly import OptionalConstraints
from agents.planners.single_arm.collocation.mesh import INTERVALS
from agents.planners.single_arm.collocation.model import SingleArm
from agents.planners.single_arm.collocation.ocp import plan_ocp
from agents.planners.single_arm.collocation.program import ReachProgram
from agents.planners.single_arm.collocation.solver import ReachSolution, ReachSolver
from agents.planners.single_arm.library import library_of
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.policies.single_arm.optimal import OptimalControl
from space_envs.dynamics import roll_out_base
from space_envs.dynamics.rotations import rotate
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError
from space_envs.policy import PolicyContext
from space_envs.robots.models import robot_model
from space_envs.robots.zoo import find_robot
from tests.moving_goals import assert_intercepted, circling, windowed

MODEL = robot_model(find_robot("shyam2020"))


def planned(reach: Reach, limits: Limits = Limits(), starts: int = 3) -> ReachPlan:
    library = library_of(ROBOT, reach.keep_attitude, limits.rate is not None)
    motion = plan_ocp(MODEL, robot(), reach, limits, library=library, starts=starts)
    assert isinstance(motion, ReachPlan), motion
    return motion


def check_motion(reach: Reach, limits: Limits, motion: ReachPlan) -> dict[str, float]:
    """What was measured, after it was found to keep everything."""
    found = check(MODEL, robot(), reach, limits, motion)
    assert found.cost == pytest.approx(motion.cost, rel=1e-6)
    assert found.violation["position_error"] < 1e-4
    assert found.violation["rotation_error"] < 1e-4
    assert found.violation["start"] < 1e-8
    assert found.violation["end_rate"] < 1e-8
    for name in ("position", "rate", "acceleration", "torque", "coriolis", "clearance"):
        assert found.violation.get(name, 0.0) < 1e-5, name
    assert not reach.keep_attitude or found.violation["end_attitude"] < np.deg2rad(0.01)
    return dict(found.violation)


def known_ratio(number: int, keep_attitude: bool, starts: int) -> float:
    reach = reach_of(number, keep_attitude)
    motion = planned(reach, starts=starts)
    check_motion(reach, Limits(), motion)
    return motion.cost / KNOWN[number]["kept" if keep_attitude else "free"]


@pytest.mark.parametrize(("number", "keep_attitude"), [(2, False), (5, True)])
def test_costs_no_more_than_is_known(number: int, keep_attitude: bool) -> None:
    assert known_ratio(number, keep_attitude, 3) < 1.02


@pytest.mark.slow
@pytest.mark.parametrize("keep_attitude", [False, True])
@pytest.mark.parametrize("number", range(len(KNOWN)))
def test_all_known_goals(number: int, keep_attitude: bool) -> None:
    assert known_ratio(number, keep_attitude, 8) < 1.02


@pytest.mark.parametrize("keep_attitude", [False, True])
def test_limits_are_satisfied_between_nodes_too(keep_attitude: bool) -> None:
    reach = reach_of(4, keep_attitude)
    violation = check_motion(reach, drives(), planned(reach, drives()))
    # They bind: without them the motion would be another.
    assert max(violation["rate"] / 0.3, violation["acceleration"] / 0.25) > -1e-2


def test_torque_limit_is_active_where_accelerations_are_large() -> None:
    reach = reach_of(4, True)
    limits = replace(drives(), torque=30.0)
    motion = planned(reach, limits)
    violation = check_motion(reach, limits, motion)
    assert -1.0 < violation["torque"]
    assert motion.cost > planned(reach, drives()).cost * (1.0 - 1e-3)


def test_a_limit_violated_by_more_than_itself_stays_positive() -> None:
    """Between the nodes a torque may be passed by more than its limit, which must not turn negative."""
    reach = reach_of(2).checked(robot())
    solver = ReachSolver(robot(), reach, drives())
    path = planned(reach, drives()).sample(solver.abscissae * reach.duration)[0]
    solution = solver.solve(solver.variables(path))
    for _ in range(3):
        assert isinstance(solution, ReachSolution)
        solution = solver.tightened(solution, {"torque": 1000.0})
    assert isinstance(solution, ReachSolution | Failure)


def test_coriolis_forces_are_limited_on_their_own() -> None:
    reach = reach_of(5, True)
    without = check_motion(reach, replace(drives(), coriolis=100.0), planned(reach, drives(), starts=1))
    limits = replace(drives(), coriolis=0.6 * (100.0 + without["coriolis"]))
    check_motion(reach, limits, planned(reach, limits, starts=1))


def test_links_stay_out_of_spheres() -> None:
    bare, limits = reach_of(2), replace(drives(), torque=None)
    motion = planned(bare, limits)
    q, qdot, _ = motion.sample(np.linspace(0.0, 4.0, 101))
    place, turn = roll_out_base(robot(), q, qdot, 0.04)
    end_effector = place[-1] + rotate(turn[-1], robot().end_effector_pose(q[-1])[0])
    reach = replace(bare, spheres=np.array([[*(end_effector + [0.08, 0.0, 0.0]), 0.1]]))
    assert check(MODEL, robot(), reach, limits, motion).violation["clearance"] > 0.05
    clear = planned(reach, limits)
    check_motion(reach, limits, clear)
    assert clear.cost > motion.cost


@pytest.mark.parametrize("keep_attitude", [False, True])
def test_intercepts_a_grapple_that_circles(keep_attitude: bool) -> None:
    """Pose and twist are matched, as measured."""
    reach = replace(circling(0), keep_attitude=keep_attitude)
    motion = planned(reach, drives(), 1)
    assert_intercepted(reach, motion, check(MODEL, robot(), reach, drives(), motion))


def test_time_of_interception_is_chosen_within_a_window() -> None:
    reach = circling(3)
    motion = planned(windowed(reach, 9.0, 12.0), drives(), 1)
    assert 9.0 <= motion.time[-1] <= 12.0
    ends = [planned(replace(reach, duration=time), drives(), 1).cost for time in (9.0, 12.0)]
    assert motion.cost <= min(ends) * (1.0 + 1e-9)
    assert_intercepted(reach, motion, check(MODEL, robot(), reach, drives(), motion))


def test_tracked_in_the_simulation_it_ends_where_it_was_planned() -> None:
    env = CaptureVectorEnv("SpaceCapture/SingleArm-v0", 2, hold_time=100.0)
    context = PolicyContext.from_env(env)
    policy = OptimalControl(context)
    observation, _ = env.reset(options={"split": "validation", "index": np.arange(2)})
    state, start = None, None
    for _ in range(101):
        action, state = policy.predict(observation, state, start)
        start = np.zeros(2, dtype=bool)
        observation, *_ = env.step(action)
    assert state is not None
    assert state.failures.tolist() == [None, None]
    assert np.abs(context.layout.read(observation, "position_error")).max() < 2e-3


@pytest.mark.parametrize(
    ("changes", "limits", "cause"),
    [
        ({"goal": OUT_OF_REACH}, Limits(), Cause.OUT_OF_REACH),
        ({"duration": 1.0}, Limits(rate=0.3, acceleration=0.25), Cause.INFEASIBLE),
        ({"rate": np.full(7, 0.5)}, Limits(rate=0.3), Cause.INFEASIBLE),
        ({"spheres": np.array([[0.0, 0.3, 1.6, 1.0]])}, Limits(), Cause.CLEARANCE),  # at the start
        ({"spheres": np.array([[*KNOWN[0]["position"], 0.1]])}, Limits(), Cause.CLEARANCE),  # at the goal
    ],
)
def test_failures_name_cause_and_figures(changes: dict, limits: Limits, cause: Cause) -> None:
    failure = plan_ocp(MODEL, robot(), replace(reach_of(0), **changes), limits, starts=2)
    assert isinstance(failure, Failure)
    assert failure.cause is cause, failure
    assert any(letter.isdigit() for letter in failure.reason)


def test_bad_arguments_are_refused() -> None:
    with pytest.raises(ConfigurationError, match="starts"):
        plan_ocp(MODEL, robot(), reach_of(0), starts=0)


@pytest.mark.parametrize(("loads", "spheres"), [((), 2), ((True, False), 0)])
def test_derivatives_of_the_program_agree_with_differences(loads: tuple[bool, ...], spheres: int) -> None:
    program = ReachProgram.of(robot(), OptionalConstraints(True, loads, spheres))
    rng = np.random.default_rng(0)
    solver = program.solver
    x = 0.2 * rng.standard_normal(solver.size1_in("x0"))
    p = 0.3 * rng.standard_normal(solver.size1_in("p"))
    slope = solver.get_function("nlp_jac_g")
    gradient = solver.get_function("nlp_grad_f")
    hessian = solver.get_function("nlp_hess_l")
    direction = rng.standard_normal(x.shape)
    weight = rng.standard_normal(slope.size1_out(0))

    def at(where: np.ndarray) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
        g, jacobian = slope(where, p)
        f, pull = gradient(where, p)
        return float(f), pull.full()[:, 0], g.full()[:, 0], jacobian.full()

    high, low, here = at(x + 1e-6 * direction), at(x - 1e-6 * direction), at(x)
    scale = np.abs(here[1]).max()
    assert (high[0] - low[0]) / 2e-6 == pytest.approx(here[1] @ direction, rel=1e-5, abs=1e-6 * scale)
    difference = (high[2] - low[2]) / 2e-6
    np.testing.assert_allclose(
        here[3] @ direction, difference, rtol=1e-5, atol=1e-6 * np.abs(difference).max()
    )
    if loads:
        return  # whose curvature is left out of the Hessian
    bend = ca.triu2symm(hessian(x, p, 1.7, weight)).full() @ direction
    slopes = [1.7 * side[1] + side[3].T @ weight for side in (high, low)]
    np.testing.assert_allclose(
        bend, (slopes[0] - slopes[1]) / 2e-6, rtol=1e-4, atol=1e-5 * np.abs(bend).max()
    )


@pytest.mark.parametrize("number", [2, 3])
def test_no_motion_in_weights_costs_less(number: int) -> None:
    """The one that it starts from is fitted closely, base included, and improved."""
    reach = reach_of(number, True).checked(robot())
    weights = OptimalPlanner(robot(), drives(), library_of(ROBOT, True)).plan(reach)
    assert isinstance(weights, ReachPlan)
    solver = ReachSolver(robot(), reach, drives())
    begin = solver.fitted(weights)
    motion = solver.motion(ReachSolution(0.0, begin, np.zeros(7)))
    time = np.linspace(0.0, 10.0, 201)
    np.testing.assert_allclose(motion.sample(time)[0], weights.sample(time)[0], atol=2e-3)
    gibbs = begin[-3 * INTERVALS :].reshape(-1, 3)
    base = roll_out_base(robot(), *weights.sample(np.linspace(0.0, 10.0, 801))[:2], 10.0 / 800)[1][40::40]
    np.testing.assert_allclose(gibbs, base[:, 1:] / base[:, :1], atol=2e-4)
    assert planned(reach, drives(), 1).cost <= weights.cost


def test_model_is_that_of_the_robot() -> None:
    model, rng = SingleArm.of(robot()), np.random.default_rng(3)
    q = rng.standard_normal(7)
    mass = robot().mass
    com = mass[1:] @ robot().kinematics(q).com + mass[0] * robot().com[0]
    np.testing.assert_allclose(model.com(q).full()[:, 0], com / mass.sum(), atol=1e-12)
