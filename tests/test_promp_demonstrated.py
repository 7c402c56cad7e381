"""ProMPs fitted to optimal motions: goals, limits and costs of their plans, and motions around spheres."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from known_reaches import OUT_OF_REACH

from agents.demonstrations.optimal.library import robot_limits
from agents.planners.common.plans import Cause, Failure
from agents.planners.single_arm.check import check
from agents.planners.single_arm.inequalities.spheres import Spheres
from agents.planners.single_arm.library import library_of
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.promp.avoiding import AvoidingPlanner
from agents.planners.single_arm.promp.demonstrated import GROUP, DemonstratedPlanner
from agents.policies.clearance import link_radii
from agents.policies.single_arm.promp import ProMPPolicy
from agents.policies.single_arm.weights import PrompAvoiding, PrompDemonstrated
from promp import ProMP, ViaPoint
from space_envs.dynamics import FloatingRobot, roll_out_base, trajectory_cost
from space_envs.dynamics.grapples import Grapple
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.spheres import link_ends, sphere_gaps
from space_envs.envs import CaptureVectorEnv
from space_envs.policy import PolicyContext
from space_envs.robots.models import robot_model
from space_envs.robots.zoo import find_robot
from space_envs.tasks.single_arm import SingleArmTask
from space_envs.tasks.single_arm_cluttered import SingleArmClutteredTask

ROBOT = find_robot("shyam2020")
GOALS = 6


def robot() -> FloatingRobot:
    return SingleArmTask().mechanics


@cache
def planner(keep_attitude: bool = False) -> DemonstratedPlanner:
    return DemonstratedPlanner(robot(), robot_limits(ROBOT), library_of(ROBOT, keep_attitude))


def reach_of(number: int, keep_attitude: bool = False) -> Reach:
    goals = SingleArmTask().goals("validation", np.arange(GOALS))
    goal = Grapple.at_rest(goals.position[number], goals.quaternion[number])
    reach = Reach(robot().home, goal, keep_attitude=keep_attitude)
    return reach.checked(robot())


def cluttered(number: int) -> Reach:
    goals = SingleArmClutteredTask().goals("validation", np.arange(GOALS))
    start, place, turn = goals.joint_position, goals.position, goals.quaternion
    near = {"spheres": goals.spheres[number], "link_radius": link_radii(ROBOT)}
    return Reach(start[number], Grapple.at_rest(place[number], turn[number]), **near)


def measured(reach: Reach, plan: ReachPlan | Failure) -> ReachPlan:
    assert isinstance(plan, ReachPlan), plan
    return check(robot_model(ROBOT), robot(), reach.checked(robot()), robot_limits(ROBOT), plan)


def assert_within_limits(plan: ReachPlan) -> None:
    violation = plan.violation
    assert violation["position_error"] < 1e-3
    assert violation["rotation_error"] < np.deg2rad(0.05)
    assert violation["position"] <= 0.0
    assert violation["rate"] <= 0.03 * ROBOT.rate_limit.min()
    assert violation["acceleration"] <= 0.03 * ROBOT.acceleration_limit.min()
    assert violation["torque"] <= 0.03 * ROBOT.torque_limit.min()
    assert violation["start"] < 1e-9
    assert violation["end_rate"] < 1e-9


def test_plans_reach_goals_within_limits_at_less_cost_than_demonstrations() -> None:
    env = CaptureVectorEnv("SpaceCapture/SingleArm-v0", GOALS)
    context = PolicyContext.from_env(env)
    observation, _ = env.reset(options={"split": "validation", "index": np.arange(GOALS)})
    other, _ = ProMPPolicy(context).plan(context.check_observation(observation))
    cost = trajectory_cost(robot(), other.position, other.velocity, other.dt)
    share = []
    for number in range(GOALS):
        plan = planner().plan(reach_of(number))
        found = measured(reach_of(number), plan)
        assert_within_limits(found)
        assert isinstance(plan, ReachPlan)
        assert found.cost == pytest.approx(plan.cost, rel=0.03)
        share.append(found.cost / cost[number])
    assert np.median(share) < 0.7


def test_attitude_constraint_is_satisfied() -> None:
    plans = [planner(True).plan(reach_of(number, True)) for number in range(GOALS)]
    solved = [number for number, plan in enumerate(plans) if isinstance(plan, ReachPlan)]
    assert len(solved) >= 0.6 * GOALS
    for number in solved:
        found = measured(reach_of(number, True), plans[number])
        assert_within_limits(found)
        assert found.violation["end_attitude"] < np.deg2rad(0.05)
    for plan in plans:
        if isinstance(plan, Failure):
            assert plan.cause in (Cause.INFEASIBLE, Cause.SOLVER)


def test_samples_are_worth_drawing_and_several_groups_too() -> None:
    def costs(**changes: int) -> Array:
        made = DemonstratedPlanner(robot(), robot_limits(ROBOT), library_of(ROBOT, False), **changes)
        plans = [made.plan(reach_of(number)) for number in range(GOALS)]
        return np.array([plan.cost if isinstance(plan, ReachPlan) else np.inf for plan in plans])

    best = costs()
    assert (best <= costs(samples=0) * (1.0 + 1e-9)).all()
    assert np.median(best / costs(groups=1)) < 1.0


def test_samples_of_the_conditioned_promp_reach_the_goal() -> None:
    reach = reach_of(1)
    space, bounds, _ = planner().planner.setting(reach)
    for found in planner().distributions(reach, space, bounds).found:
        assert np.abs(space.values(space.coordinates(found.promp.mean[None]))[1][0, :6]).max() < 1e-8
        samples, met = found.project(found.promp.sample(np.random.default_rng(0), 30), 1e-5)
        assert met.mean() > 0.9
        assert np.abs(space.values(space.coordinates(samples[met]))[1][:, :6]).max() <= 1e-5


def test_moving_to_another_start_is_conditioning_on_it() -> None:
    home, start, rate = robot().home, robot().home + 0.05, np.full(7, 0.01)
    at_home = replace(reach_of(2), start=home)
    moved = replace(at_home, start=start, rate=rate)
    spaces = [planner().planner.setting(reach)[0] for reach in (at_home, moved)]
    priors = [
        planner().priors(reach, space)[0] for reach, space in zip((at_home, moved), spaces, strict=True)
    ]
    # Starts that vary by the quietest functions, independently of the rest.
    directions = np.kron(np.eye(7), spaces[0].shapes.fixed[:, :2])
    wide = ProMP(priors[0].mean, priors[0].covariance + 0.04 * directions @ directions.T)
    found = wide.condition_on([ViaPoint(0.0, start, rate, duration=10.0)])
    np.testing.assert_allclose(found.mean, priors[1].mean, atol=1e-6)
    np.testing.assert_allclose(found.covariance, priors[1].covariance, atol=1e-7)
    assert priors[0].factor.deviations.size == 7 * spaces[0].free > GROUP


def test_goals_out_of_reach_are_refused() -> None:
    failure = planner().plan(replace(reach_of(0), goal=OUT_OF_REACH))
    assert isinstance(failure, Failure)
    assert failure.cause is Cause.SOLVER
    assert any(letter.isdigit() for letter in failure.reason)


def test_clearances_agree_with_an_independent_roll_out() -> None:
    reach = cluttered(0).checked(robot())
    space, _, _ = planner().planner.setting(reach)
    assert reach.spheres is not None
    y = 0.02 * np.random.default_rng(0).standard_normal((3, 7, space.free))
    gaps = Spheres(space, robot(), reach.spheres, link_radii(ROBOT)).gaps(y)
    fine = np.linspace(0.0, 1.0, 401)
    basis = space.shapes.basis
    for one, gap in zip(space.weights(y), gaps, strict=True):
        q, qdot = basis.value(fine) @ one.T, basis.derivative(fine) @ one.T / 10.0
        ends = link_ends(robot(), q, *roll_out_base(robot(), q, qdot, 10.0 / 400))
        expected = sphere_gaps(ends, reach.spheres, link_radii(ROBOT))
        np.testing.assert_allclose(gap, expected[:: 400 // (len(gap) - 1)], atol=3e-3)


def test_motions_around_spheres_are_clear_and_within_limits() -> None:
    avoiding = AvoidingPlanner(robot(), robot_limits(ROBOT), library_of(ROBOT, False))
    blind = []
    for number in range(3):
        reach = cluttered(number)
        blind.append(measured(reach, planner().plan(reach)).violation["clearance"])
        found = measured(reach, avoiding.plan(reach))
        assert_within_limits(found)
        assert found.violation["clearance"] < -2e-3
    assert max(blind) > 0.01  # a motion that does not look runs into a sphere


def test_a_sphere_around_the_goal_is_a_typed_collision() -> None:
    reach = reach_of(3)
    blocked = replace(reach, spheres=np.append(reach.end.position, 0.2)[None])
    failure = AvoidingPlanner(robot(), robot_limits(ROBOT), library_of(ROBOT, False)).plan(blocked)
    assert isinstance(failure, Failure)
    assert failure.cause in (Cause.CLEARANCE, Cause.SOLVER)


def test_the_policy_follows_its_plans() -> None:
    env = CaptureVectorEnv("SpaceCapture/SingleArm-v0", 4, hold_time=100.0)
    policy = PrompDemonstrated(PolicyContext.from_env(env))
    observation, _ = env.reset(options={"split": "validation", "index": np.arange(4)})
    state, start = None, None
    for _ in range(101):
        action, state = policy.predict(observation, state, start)
        start = np.zeros(4, dtype=bool)
        observation, *_ = env.step(action)
    assert state is not None
    planned = np.array([failure is None for failure in state.failures])
    assert planned.any()
    miss = np.linalg.norm(policy.context.layout.read(observation, "position_error"), axis=1)
    assert miss[planned].max() < 5e-3


def test_the_avoiding_policy_sees_the_spheres() -> None:
    env = CaptureVectorEnv("SpaceCapture/SingleArmCluttered-v0", 1)
    policy = PrompAvoiding(PolicyContext.from_env(env))
    observation, _ = env.reset(options={"split": "validation", "index": np.array([1])})
    _, state = policy.predict(observation)
    assert state.failures[0] is None
    reach = cluttered(1)
    assert reach.spheres is not None
    base = roll_out_base(robot(), state.position[0], state.rate[0], policy.context.control_period)
    ends = link_ends(robot(), state.position[0], *base)
    assert sphere_gaps(ends, reach.spheres, link_radii(ROBOT)).min() > 2e-3
