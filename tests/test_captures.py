"""No built-in policy captures through a body, seen by MuJoCo's own distances; reactionless ones turn none."""

from functools import cache

import numpy as np
import pytest
from distance_oracle import Oracle
from rollouts import rollout_of

from agents.planners.common.plans import Cause
from agents.policies.registry import policies_for
from space_envs.evaluation.play.rollout import Rollout
from space_envs.registration import ENTRIES

INSIDE = 1e-6  # m
COSTLY = ("ocp", "promp_avoiding", "promp_optimal_kept")  # are left to the slow test
DULL = ("random", "hold")  # capture nothing
ALL = [(env_id, name) for env_id in sorted(ENTRIES) for name in policies_for(env_id) if name not in DULL]
REACTIONLESS = {"reactionless", "reactionless_local", "reactionless_free", "reactionless_ocp"}
DUAL = [env_id for env_id in sorted(ENTRIES) if "DualArm" in env_id]
CLUTTERED = "SpaceCapture/SingleArmCluttered-v0"


@cache
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
            gaps[name] = least_gap(oracle, played(env_id, name, "hard", 3 if name in REACTIONLESS else 2))
    assert min(gaps.values()) > -INSIDE, gaps
    assert sum(np.isfinite(gap) for gap in gaps.values()) >= 2


@pytest.mark.parametrize("env_id", DUAL)
def test_reactionless_planners_keep_the_attitude_or_say_why_they_rest(env_id: str) -> None:
    late: list[str] = []
    for name in REACTIONLESS & set(policies_for(env_id)):
        rollout = played(env_id, name, "hard", 3)
        assert "captured" in rollout.outcome, name
        for row, cause in enumerate(rollout.cause):
            if cause is None:
                assert rollout.outcome[row] == "captured" and rollout.reason[row] is None
                assert rollout.attitude[row].max() < 0.2 and rollout.attitude[row, -1] < 0.1
            elif cause == "timeout":  # hard goals may take longer than there is time
                late.append(name)
            else:
                assert cause in {str(each) for each in Cause} and rollout.reason[row]
                np.testing.assert_allclose(rollout.attitude[row], 0.0, atol=1e-6)  # the arms rest
        if name == "reactionless_free":
            assert set(rollout.outcome) == {"captured"}
            assert rollout.attitude[:, -1].max() < 0.01
    assert len(late) <= 1


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
