"""Search for an optimal motion of one goal: from initial guesses, then from its neighbours' motions."""

import numpy as np

from agents.planners.single_arm.library import Library
from agents.planners.single_arm.problem import Reach
from agents.planners.single_arm.promp.optimal import OptimalPlanner
from agents.planners.single_arm.promp.starts import VIOLATION_TOLERANCE
from agents.planners.single_arm.weights.ranking import predicted_costs
from agents.planners.single_arm.weights.sqp import GOAL_TOLERANCE, SqpResult, minimise
from space_envs.dynamics.rotations import Array

NEIGHBOURS = 48  # nearest goals, of whose motions some are drawn in a round
COMPARED = 16  # number of them that are compared
TRIED = 5  # number of them that are improved
STEP_COST = 1e-5  # m^2/rad^2 per unit of the integral of a step's squared rate, in predicted costs
COST_RATIO = 0.99  # predicted cost ratio below which a neighbour's motion is tried
STARTS = 3  # around the motion that is easiest to find, in the first round
SPREAD = 0.1  # of them, in coordinates
ITERATIONS = 40  # of a start in the first round
FINE = 1e-4  # relative gain of an iteration below which a motion is done, in the last round


def first_motion(
    planner: OptimalPlanner, reach: Reach, rng: np.random.Generator
) -> tuple[Array, float, float]:
    """The best of several starts: coordinates, cost (infinite if no start led to the goal), their number."""
    problem = planner.setting(reach)
    space, bounds, rows = problem
    rest = np.zeros((len(reach.start), space.free))
    # To first order an arm at rest cannot rotate its base back: these start around an unconstrained motion.
    centre = minimise(space, bounds, rest, False, rows).y if reach.keep_attitude else rest
    around = centre + SPREAD * rng.standard_normal((STARTS, *rest.shape))
    guesses = [*around] if reach.keep_attitude else [rest, *around]
    y, cost = rest, np.inf
    for guess in guesses:
        found = planner.solve(problem, guess, reach.keep_attitude, iterations=ITERATIONS)
        y, cost = _cheaper(found, y, cost)
    return y, cost, float(len(guesses))


def improved_motion(
    planner: OptimalPlanner,
    reach: Reach,
    before: Library,
    number: int,
    last: bool,
    rng: np.random.Generator,
) -> tuple[Array, float, float]:
    """The best so far, or the result from a neighbouring goal's solution whose predicted cost is lower.

    Neighbours are drawn, so that every round tries others.
    """
    problem = planner.setting(reach)
    y, cost = before.coordinates[number], float(before.cost[number])
    neighbours = before.order(reach)
    neighbours = neighbours[(neighbours != number) & np.isfinite(before.cost[neighbours])][:NEIGHBOURS]
    starts = before.coordinates[rng.permutation(neighbours)[:COMPARED]]
    predicted = predicted_costs(problem[0], starts, reach.keep_attitude, STEP_COST)
    order = np.argsort(predicted, kind="stable")[:TRIED]
    chosen = starts[order[predicted[order] < COST_RATIO * cost]]
    for guess in chosen:
        found = planner.solve(problem, guess, reach.keep_attitude)
        y, cost = _cheaper(found, y, cost)
    if last and np.isfinite(cost):
        found = planner.solve(problem, y, reach.keep_attitude, tolerance=FINE)
        y, cost = _cheaper(found, y, cost)
    return y, cost, float(before.attempts[number] + len(chosen))


def _cheaper(found: SqpResult, y: Array, cost: float) -> tuple[Array, float]:
    """Coordinates and cost of a solution if it is valid and costs less; otherwise those given."""
    if found.goal_error < GOAL_TOLERANCE and found.violation < VIOLATION_TOLERANCE and found.cost < cost:
        return found.y, found.cost
    return y, cost
