"""Initial guesses of the weight-space planner: which go on, which wait, and a finer basis."""

import numpy as np
from known_reaches import ROBOT, drives, reach_of, robot

from agents.planners.single_arm.check import check
from agents.planners.single_arm.library import library_of
from agents.planners.single_arm.problem import Reach, ReachPlan
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.planners.single_arm.promp.starts import Starts
from agents.planners.single_arm.weights.shapes import in_basis
from agents.planners.single_arm.weights.sqp import Descent, minimise
from promp import GaussianBasis
from space_envs.dynamics.grapples import Grapple
from space_envs.tasks.single_arm import SingleArmTask


def test_interrupted_iterations_go_on_where_they_were() -> None:
    reach = reach_of(1, True)
    space, bounds, rows = OptimalPlanner(robot(), drives()).setting(reach)
    guess = library_of(ROBOT, True).nearest(reach, 1)[0]
    descent = Descent(space, bounds, guess, True, rows)
    assert descent.run(3).iterations == 3
    np.testing.assert_array_equal(descent.run(60).y, minimise(space, bounds, guess, True, rows).y)


def test_starts_far_from_the_goal_wait() -> None:
    reach = reach_of(1, True)
    problem = OptimalPlanner(robot(), drives()).setting(reach)
    library = library_of(ROBOT, True)
    far, near = (library.coordinates[library.order(reach)[k]] for k in (-1, 0))
    starts = Starts(problem, True, in_stages=True)
    starts.add(far)
    assert not starts.found
    starts.add(near)
    assert len(starts.found) == 1
    assert [end.goal_error for end in starts.ends] == sorted(end.goal_error for end in starts.ends)
    alone = Starts(problem, True, in_stages=True)
    alone.add(far)
    alone.resume()
    assert alone.found[0].iterations > 6


def test_a_finer_basis_holds_the_same_motion() -> None:
    coarse, fine = GaussianBasis(), GaussianBasis(tuple(np.linspace(-0.15, 1.15, 14)), 0.17)
    weights, phase = np.random.default_rng(0).normal(size=(7, coarse.size)), np.linspace(0.0, 1.0, 57)
    motion = coarse.value(phase) @ weights.T
    np.testing.assert_allclose(fine.value(phase) @ in_basis(fine, coarse, weights).T, motion, atol=1e-2)


def test_goals_beyond_ten_functions_are_reached_in_a_finer_basis() -> None:
    goals = SingleArmTask(difficulty="hard").goals("validation", np.array([75]))
    goal = Grapple.at_rest(goals.position[0], goals.quaternion[0])
    reach = Reach(robot().home, goal, keep_attitude=True).checked(robot())
    plan = OptimalPlanner(robot(), drives(), library_of(ROBOT, True)).plan(reach)
    assert isinstance(plan, ReachPlan)
    violation = check(SingleArmTask().model, robot(), reach, drives(), plan).violation
    assert violation["position_error"] < 1e-3
    assert violation["end_attitude"] < np.deg2rad(0.05)
    assert violation["rate"] <= 1e-4 * 0.3
    phase = plan.time / plan.time[-1]
    weights = np.linalg.lstsq(GaussianBasis().value(phase), plan.position, rcond=None)[0]
    assert np.abs(GaussianBasis().value(phase) @ weights - plan.position).max() > 1e-3
