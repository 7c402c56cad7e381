"""Reactionless plans against an independent collocation by Ipopt."""

import numpy as np
import pytest

from agents.planners.single_arm.problem import ReachPlan
from agents.policies.single_arm.reactionless.problem import path_limits
from benchmarks.reactionless_collocation import (
    Collocation,
    CollocationResult,
    compare,
    momentum_functions,
    problems,
)


def test_momentum_of_the_collocation_is_that_of_the_robot() -> None:
    """Two derivations from two descriptions."""
    context, _, _ = problems("validation", 1)
    along, _ = momentum_functions(context.model)
    q, rate = np.random.default_rng(0).uniform(-2.0, 2.0, (2, 5, 7))
    twist = context.arm.base_twist(q, rate)
    still = np.linalg.svd(context.arm.base_map(q)[:, 3:])[2][:, 3:]  # (5, 4, 7) without base rotation
    for k in range(5):
        spin, _ = along(q[k], rate[k])
        assert np.linalg.norm(np.array(spin)) > 0.1 < np.linalg.norm(twist[k, 3:]) * 1e3
        quiet = still[k].T @ (still[k] @ rate[k])
        spin, square = along(q[k], quiet)
        assert np.abs(np.array(spin)).max() < 1e-10
        assert float(square) == pytest.approx((context.arm.base_twist(q[k], quiet)[:3] ** 2).sum(), rel=1e-9)


@pytest.mark.slow
def test_plans_are_feasible_for_a_collocation_and_not_far_above_its_optimum() -> None:
    context, policy, asked = problems("validation", 10)
    limits = path_limits(context).limits
    ratios = []
    for reach in asked:
        (plan,) = policy.plan([reach])
        assert isinstance(plan, ReachPlan)
        own, near, straight = compare(context, reach, plan, limits)
        assert own.measured.cost == pytest.approx(plan.cost, rel=1e-2)
        assert own.measured.peak < 1e-4 and own.measured.error < 1e-5
        assert within(context, reach, own, limits) < 1e-3
        assert near.status == "Solve_Succeeded"
        assert near.measured.peak < 1e-3 and near.measured.error < 1e-6
        ratios.append(own.measured.cost / min(near.measured.cost, straight.measured.cost))
    assert min(ratios) > 0.98 and np.median(ratios) < 2.5


def within(context, reach, own: CollocationResult, limits) -> float:
    """Largest excess of a motion over the bounds of the program, relative to 1 rad, rad/s or rad/s^2."""
    lower, upper = Collocation(context.model, limits).bounds(reach)
    values = np.stack(own.motion)
    return float(np.maximum(lower - values, values - upper).max())
