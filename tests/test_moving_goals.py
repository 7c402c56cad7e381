"""Planners and moving goals of the single arm, and the measurement of plans against such goals."""

from dataclasses import replace

import numpy as np
import pytest

from agents.planners.common.plans import Limits
from agents.planners.single_arm.check import check
from agents.planners.single_arm.library import library_of
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.promp.avoiding import AvoidingPlanner
from agents.planners.single_arm.promp.demonstrated import DemonstratedPlanner
from space_envs.dynamics import roll_out_base
from space_envs.dynamics.grapples import Grapple, PoseTwist
from space_envs.dynamics.rotations import conjugate, from_matrix, logarithm, multiply, rotate
from space_envs.errors import ConfigurationError
from space_envs.tasks.single_arm import SingleArmTask
from tests.moving_goals import ENDS, circling, windowed

TASK = SingleArmTask()
ROBOT = TASK.mechanics


def swept(reach: Reach) -> ReachPlan:
    """A motion from home that ends with moving joints."""
    time = np.linspace(0.0, reach.duration, 101)[:, None]
    pace = np.linspace(-0.05, 0.05, ROBOT.n_joints)
    position = reach.start + pace * time**2 / reach.duration
    rate = 2.0 * pace * time / reach.duration
    return ReachPlan("swept", time[:, 0], position, rate, 0.0 * time + 2.0 * pace / reach.duration, 0.0)


def end_by_differences(plan: ReachPlan, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pose and twist of the end-effector in the middle of the last two steps, from the poses around it."""
    last = plan.time[-1]
    time = np.arange(0.0, last + step / 2, step)
    q, qdot, _ = plan.sample(time)
    base, attitude = roll_out_base(ROBOT, q, qdot, step)
    local, axes = ROBOT.end_effector_pose(q)
    place, turn = base + rotate(attitude, local), multiply(attitude, from_matrix(axes))
    linear = (1.5 * place[-1] - 2.0 * place[-2] + 0.5 * place[-3]) / step
    angular = [logarithm(multiply(turn[-1], conjugate(turn[-k]))) / ((k - 1) * step) for k in (2, 3)]
    return place[-1], turn[-1], linear, 2.0 * angular[0] - angular[1]


def test_check_measures_pose_and_twist_against_the_moving_goal() -> None:
    plan = swept(circling(0))
    place, turn, linear, angular = end_by_differences(plan, 0.01)
    body = PoseTwist(place, turn, linear, angular)
    goal = Grapple.on_body(body, np.ones(3), place, turn).after(-plan.time[-1])
    reach = replace(circling(0), goal=goal)
    exact = check(TASK.model, ROBOT, reach, Limits(), plan).violation
    assert max(exact[name] for name in ENDS) < 1e-5
    assert "end_rate" not in exact
    other = replace(goal, centre=goal.centre + [0.0, 0.02, 0.0], linear_velocity=goal.linear_velocity + 0.01)
    wrong = check(TASK.model, ROBOT, replace(reach, goal=other), Limits(), plan).violation
    assert wrong["linear_velocity_error"] == pytest.approx(0.01 * np.sqrt(3.0), abs=1e-5)
    moved = np.array([0.0, 0.02, 0.0]) + 0.01 * plan.time[-1]
    assert wrong["position_error"] == pytest.approx(float(np.linalg.norm(moved)), abs=1e-5)
    still = Grapple.at_rest(place, turn)
    rest = check(TASK.model, ROBOT, replace(reach, goal=still), Limits(), plan).violation
    assert rest["linear_velocity_error"] == pytest.approx(float(np.linalg.norm(linear)), abs=1e-5)
    assert rest["angular_velocity_error"] == pytest.approx(float(np.linalg.norm(angular)), abs=1e-5)
    assert rest["end_rate"] == pytest.approx(0.1)


@pytest.mark.parametrize("planner", [DemonstratedPlanner, AvoidingPlanner])
def test_planners_to_goals_at_rest_refuse_others(
    planner: type[DemonstratedPlanner | AvoidingPlanner],
) -> None:
    plan = planner(ROBOT, Limits(), library_of(TASK.robot, False)).plan
    with pytest.raises(ConfigurationError, match="moves at 0.02.* m/s and 0.087.* rad/s"):
        plan(circling(0))
    rest = replace(circling(0), goal=Grapple.at_rest(np.ones(3), np.array([1.0, 0.0, 0.0, 0.0])))
    with pytest.raises(ConfigurationError, match="window"):
        plan(windowed(rest, 5.0, 15.0))
