"""The multiple-shooting program of benchmarks.shooting: the collocation's problem, with right derivatives."""

import numpy as np
import pytest
from known_reaches import drives, reach_of, robot

from agents.planners.common.plans import Limits
from agents.planners.single_arm.collocation.mesh import INTERVALS
from agents.planners.single_arm.collocation.program import ReachProgram
from agents.planners.single_arm.collocation.solver import ReachSolver
from benchmarks.shooting import PROGRAM, SOLVERS, compared, rows_of, shooting_inputs
from benchmarks.shooting_program import equalities, shooting_expressions
from space_envs.dynamics.rotations import Array

RANDOM = np.random.default_rng(0)
LIMITS = Limits(drives().position, drives().rate, drives().acceleration)


def collocation() -> tuple[ReachSolver, Array]:
    """A problem of the collocation and random variables, near the start."""
    solver = ReachSolver(robot(), reach_of(0).checked(robot()), LIMITS)
    path = solver.reach.start + 0.1 * RANDOM.normal(size=(len(solver.abscissae), 7))
    guess = solver.variables(path)
    guess[-3 * INTERVALS :] = 0.1 * RANDOM.normal(size=3 * INTERVALS)
    return solver, guess


def test_a_motion_has_the_cost_bounds_and_end_that_it_has_in_the_collocation() -> None:
    solver, guess = collocation()
    given, inputs = solver.inputs(guess, np.zeros(7)), shooting_inputs(solver, guess, LIMITS)
    program = ReachProgram.of(robot(), PROGRAM).solver
    cost, rows = (program.get_function(f"nlp_{name}")(guess, given["p"]).full()[:, 0] for name in "fg")
    functions = shooting_expressions(robot())
    f, g = (functions[f"nlp_{name}"](inputs["x0"], inputs["p"]).full()[:, 0] for name in "fg")
    np.testing.assert_allclose(f, cost, rtol=1e-10)
    dynamics = np.concatenate([g[:24], g[41:497]]).reshape(INTERVALS, 24)
    np.testing.assert_allclose(dynamics[:, :21], 0.0, atol=1e-9)  # splines of the same kind
    np.testing.assert_allclose(g[24:41], 0.0, atol=1e-12)  # the start
    np.testing.assert_allclose(g[497:503], rows[60:66], atol=1e-10)  # the pose at the end
    # Bounds are violated by as much: on coefficients of angles and rates, accelerations, the last angles.
    by_rows = np.maximum(rows - given["ubg"], 0.0)[66:], np.maximum(guess - given["ubx"], 0.0)
    by_states = np.maximum(inputs["x0"] - inputs["ubx"], 0.0), np.maximum(g - inputs["ubg"], 0.0)[-7:]
    expected, violations = (np.concatenate(parts) for parts in (by_rows, by_states))
    expected, violations = (np.sort(each[each > 1e-6]) for each in (expected, violations))
    assert len(expected) > 20
    np.testing.assert_allclose(violations, expected, atol=1e-8)


def test_derivatives_agree_with_differences() -> None:
    functions, step = shooting_expressions(robot()), 1e-6
    solver, guess = collocation()
    inputs = shooting_inputs(solver, guess, LIMITS)
    x, p = inputs["x0"], inputs["p"]
    x = x + 0.01 * RANDOM.normal(size=x.shape)
    factor, multipliers = 0.7, RANDOM.normal(size=len(equalities(7)))
    aside = RANDOM.normal(size=x.shape)
    given = {"nlp_f": "nlp_grad_f", "nlp_g": "nlp_jac_g"}

    def change(name: str, *more: Array | float) -> Array:
        ends = (functions[name](x + sign * step * aside, p, *more) for sign in (1.0, -1.0))
        one, two = (np.asarray(end[0] if isinstance(end, tuple) else end).ravel() for end in ends)
        return (one - two) / (2.0 * step)

    slopes = {name: functions[derivative](x, p) for name, derivative in given.items()}
    gradient, jacobian = slopes["nlp_f"].full(), slopes["nlp_g"][1].full()
    pull, hessian = (each.full() for each in functions["nlp_hess_l"](x, p, factor, multipliers))
    np.testing.assert_allclose(gradient[:, 0] @ aside, change("nlp_f"), rtol=1e-6)
    np.testing.assert_allclose(jacobian @ aside, change("nlp_g"), atol=1e-6)
    np.testing.assert_allclose(pull, factor * gradient + jacobian.T @ multipliers[:, None], atol=1e-10)
    scale = np.abs(hessian @ aside).max()
    bent = change("nlp_hess_l", factor, multipliers)
    np.testing.assert_allclose(hessian @ aside / scale, bent / scale, atol=1e-6)
    upper = functions["hess_lag"](x, p, factor, multipliers).full()
    np.testing.assert_allclose(upper, np.triu(hessian), atol=1e-12)


@pytest.mark.slow
def test_all_solvers_find_the_same_optimum() -> None:
    found = compared("validation", 1)
    assert len(found) == 1 + len(SOLVERS)
    costs = [each.cost for results in found.values() for each in results]
    np.testing.assert_allclose(costs, costs[0], rtol=1e-4)
    for row, results in zip(rows_of("medium", found), found.values(), strict=True):
        assert row[2] == "1 of 1" and 0.0 < results[0].directions and 0.0 < results[0].functions
