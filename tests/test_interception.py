"""Choice of the time of interception, with planners whose best times are known."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from agents.planners.common.plans import Cause, Failure, Limits
from agents.planners.single_arm.check import check
from agents.planners.single_arm.interception import GRID, at_best_time, predictions
from agents.planners.single_arm.problem import Reach, ReachPlan
from space_envs.tasks.single_arm import SingleArmTask
from tests.moving_goals import circling, tumbling, windowed

TASK = SingleArmTask()
ROBOT = TASK.mechanics
LIMITS = Limits(ROBOT.range, 0.3, 0.25)
WINDOW = 5.0, 19.0


def planner(cost: Callable[[float], float], tried: list[float]) -> Callable[[Reach], ReachPlan | Failure]:
    """A planner that knows only its costs, NaN where it fails, and notes the times it was asked for."""

    def plan(reach: Reach) -> ReachPlan | Failure:
        assert reach.window is None
        tried.append(reach.duration)
        if np.isnan(value := cost(reach.duration)):
            return Failure("known", Cause.SOLVER, "no plan", reach.duration)
        ends = np.stack([reach.start, reach.start])
        return ReachPlan("known", np.array([0.0, reach.duration]), ends, 0.0 * ends, 0.0 * ends, value)

    return plan


def test_a_window_around_the_least_cost_leads_to_it() -> None:
    reach = windowed(circling(1), *WINDOW)
    best = predictions(ROBOT, LIMITS, reach, np.linspace(*WINDOW, GRID)).ranked[0]
    tried: list[float] = []
    found = at_best_time(planner(lambda time: (time - best - 0.4) ** 2, tried), ROBOT, LIMITS, reach)
    assert isinstance(found, ReachPlan)
    step = (WINDOW[1] - WINDOW[0]) / (GRID - 1)
    assert tried[0] == best and abs(found.time[-1] - best - 0.4) <= step / 4.0
    assert len(tried) == 5 and all(WINDOW[0] <= time <= WINDOW[1] for time in tried)


def test_times_without_a_plan_are_passed_over() -> None:
    reach, tried = windowed(circling(1), *WINDOW), list[float]()
    found = at_best_time(planner(lambda time: np.nan if time > 8.5 else time, tried), ROBOT, LIMITS, reach)
    assert isinstance(found, ReachPlan) and found.time[-1] == min(tried) < 8.5
    failed = at_best_time(planner(lambda time: np.nan, []), ROBOT, LIMITS, reach)
    assert isinstance(failed, Failure) and failed.method == "known" and failed.residual == WINDOW[0]
    far = replace(reach, goal=replace(reach.goal, centre=reach.goal.centre + 50.0))
    failed = at_best_time(planner(lambda time: time, []), ROBOT, LIMITS, far)
    assert isinstance(failed, Failure) and failed.cause is Cause.OUT_OF_REACH


def test_without_a_window_the_duration_is_the_given_one() -> None:
    tried: list[float] = []
    at_best_time(planner(lambda time: time, tried), ROBOT, LIMITS, circling(0, 7.5))
    assert tried == [7.5]


def test_predictions_are_costs_and_limits_of_motions_that_nearly_intercept() -> None:
    """Against the independent measurement of the same motions, on a finer grid."""
    for reach in (circling(0), tumbling(3)):
        times = np.array([6.0, 9.0, 14.0])
        found = predictions(ROBOT, LIMITS, reach, times)
        assert (found.time == times).all()
        for time, end, end_rate, cost, excess in zip(*vars(found).values(), strict=True):
            ends, rates = np.stack([reach.start, end]), np.stack([0.0 * end_rate, end_rate])
            plan = ReachPlan("quintic", np.array([0.0, time]), ends, rates, 0.0 * ends, 0.0)
            measured = check(TASK.model, ROBOT, replace(reach, duration=time), LIMITS, plan)
            assert cost == pytest.approx(measured.cost, rel=0.03)
            violation = measured.violation
            beyond = max(violation["rate"] / 0.3, violation["acceleration"] / 0.25)
            assert excess == pytest.approx(max(beyond, 0.0), abs=0.05)
            assert violation["linear_velocity_error"] < 0.01 and violation["position_error"] < 0.1
