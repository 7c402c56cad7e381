"""No built-in policy captures through a body: states of captures, seen by MuJoCo's own distances."""

import numpy as np
import pytest
from distance_oracle import Oracle
from rollouts import rollout_of

from agents.policies.registry import policies_for
from space_envs.evaluation.play.rollout import Rollout
from space_envs.registration import ENTRIES

INSIDE = 1e-6  # m
COSTLY = ("ocp", "promp_avoiding", "promp_optimal_kept")  # are left to the slow test
DULL = ("random", "hold")  # capture nothing
ALL = [(env_id, name) for env_id in sorted(ENTRIES) for name in policies_for(env_id) if name not in DULL]
CLUTTERED = "SpaceCapture/SingleArmCluttered-v0"


def played(env_id: str, name: str, difficulty: str, goals: int) -> Rollout:
    """Validation episodes of a built-in policy."""
    return rollout_of(name, goals, env_id, "validation", difficulty=difficulty)[0]


def least_gap(oracle: Oracle, rollout: Rollout) -> float:
    """Of all captures at all control steps, m; infinity without captures."""
    captured = [row for row, outcome in enumerate(rollout.outcome) if outcome == "captured"]
    return min(
        (
            min(oracle.gaps(rollout.scene[row, step], rollout.goals, row).values())
            for row in captured
            for step in range(rollout.length[row] + 1)
        ),
        default=np.inf,
    )


@pytest.mark.parametrize("env_id", sorted(ENTRIES))
def test_captures_never_lead_through_a_body(env_id: str) -> None:
    oracle, gaps = Oracle(env_id), {}
    for name in policies_for(env_id):
        if name not in (*DULL, *COSTLY):
            gaps[name] = least_gap(oracle, played(env_id, name, "hard", 2))
    assert min(gaps.values()) > -INSIDE, gaps
    assert sum(np.isfinite(gap) for gap in gaps.values()) >= 2


@pytest.mark.slow
@pytest.mark.parametrize(("env_id", "name"), ALL)
def test_captures_of_many_goals_never_lead_through_a_body(env_id: str, name: str) -> None:
    assert least_gap(Oracle(env_id), played(env_id, name, "hard", 64)) > -INSIDE


def test_the_straight_way_through_a_sphere_is_seen() -> None:
    """MuJoCo sees what ends an episode among spheres; no states in it are deeper."""
    rollout = played(CLUTTERED, "gjm", "medium", 8)
    oracle, ended = Oracle(CLUTTERED), 0
    for row, outcome in enumerate(rollout.outcome):
        if outcome == "collision":
            last = rollout.scene[row, rollout.length[row]]
            gap = oracle.gaps(last, rollout.goals, row)["obstacle"]
            assert gap < 0.03
            ended += gap < 0.0
    assert ended > 3
