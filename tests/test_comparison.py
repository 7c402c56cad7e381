"""Comparison of policies: hand-worked cases, scipy, slow loops, and coverage by simulation."""

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import pytest
from scipy.special import ndtr
from scipy.stats import mannwhitneyu
from synthetic_results import changed, entry, make_record, make_result, played, rows_of

from space_envs.errors import ConfigurationError
from space_envs.evaluation.leaderboard.comparison import COSTS, improvements, profiles
from space_envs.evaluation.leaderboard.normalised import normalised_scores
from space_envs.evaluation.leaderboard.pareto import dominance, pareto_front
from space_envs.evaluation.records.episode import EpisodeRecord
from space_envs.evaluation.statistics.improvement import (
    paired_improvement,
    performance_profile,
    unpaired_improvement,
)
from space_envs.evaluation.statistics.intervals import Estimates

INF = math.inf


def bytes_of(found: Estimates) -> bytes:
    return found.value.tobytes() + found.low.tobytes() + found.high.tobytes()


# Performance profiles


def test_profile_by_hand() -> None:
    found = performance_profile(
        np.array([1.0, 2.0, INF, 2.0]),
        np.zeros(4),
        np.array([0.5, 1.0, 1.5, 2.0, 1e9]),
        np.random.default_rng(0),
    )
    # A failure is never reached, however large the cost.
    assert found.value.tolist() == [0, 0.25, 0.25, 0.75, 0.75]
    assert np.all((found.low <= found.value) & (found.value <= found.high))
    assert np.all(np.diff(found.low) >= 0) and np.all(np.diff(found.high) >= 0)


def test_profile_resamples_inside_seeds() -> None:
    # Each seed has one cost only, so that nothing varies but the four added episodes.
    costs, seeds = np.repeat([1.0, 3.0], 200), np.repeat([0, 1], 200)
    inside = performance_profile(costs, seeds, np.array([2.0]), np.random.default_rng(0))
    across = performance_profile(costs, np.zeros(400), np.array([2.0]), np.random.default_rng(0))
    assert inside.value[0] == across.value[0] == 0.5
    assert inside.high[0] - inside.low[0] < 0.02 < 0.08 < across.high[0] - across.low[0]


def test_profiles_of_records_count_failures() -> None:
    records = played("a", [1.0, 3.0, None, None]) + played("b", [None] * 4)
    found = profiles(records, "final_attitude", np.array([2.0, 10.0]), np.random.default_rng(0))
    assert found[entry("a")].value.tolist() == [0.25, 0.5]
    # The failures' 8 deg do not count: doing nothing is not gentle.
    assert found[entry("b")].value.tolist() == [0, 0]


@pytest.mark.parametrize("seeds", [1, 5])
def test_profile_coverage(seeds: int) -> None:
    generator, strata = np.random.default_rng(21), np.arange(100) % seeds
    tau = np.linspace(-2, 2, 17)
    hits = []
    for _ in range(250):
        found = performance_profile(generator.normal(size=100), strata, tau, generator, resamples=600)
        hits.append((found.low <= ndtr(tau)) & (ndtr(tau) <= found.high))
    assert 0.93 <= np.mean(hits) <= 0.97


# Probability of improvement


def test_paired_improvement_by_hand() -> None:
    costs = np.array([[1.0, 2.0, INF, 3.0, 5.0], [2.0, 2.0, INF, 1.0, INF], [0.0, 0.0, 0.0, 0.0, 9.0]])
    found = paired_improvement(costs, np.zeros(5), np.random.default_rng(0))
    # First against second: won, tied, tied (both failed), lost, won.
    np.testing.assert_allclose(found.value, [[0.5, 0.6, 0.2], [0.4, 0.5, 0.0], [0.8, 1.0, 0.5]], atol=1e-12)
    for low, high in ((found.low, found.high), (1 - found.high.T, 1 - found.low.T)):
        assert np.all((low <= found.value) & (found.value <= high))
    np.testing.assert_allclose(found.low, 1 - found.high.T)


def test_unpaired_improvement_by_hand() -> None:
    first, second = np.array([1.0, 2.0, 3.0]), np.array([2.0, 3.0, 4.0])
    found = unpaired_improvement(first, second, np.zeros(3), np.zeros(3), np.random.default_rng(0))
    # 1 beats three, 2 beats two and ties, 3 beats one and ties; goal by goal all three are won.
    assert found.value == pytest.approx((3 + 2.5 + 1.5) / 9)
    paired = paired_improvement(np.stack([first, second]), np.zeros(3), np.random.default_rng(0))
    assert paired.value[0, 1] == 1


def test_unpaired_improvement_is_scipys_u() -> None:
    generator = np.random.default_rng(1)
    first, second = generator.integers(6, size=23).astype(float), generator.integers(8, size=31).astype(float)
    first[:4], second[:3] = INF, INF
    found = unpaired_improvement(first, second, np.arange(23) % 3, np.arange(31) % 2, generator)
    # Scipy counts first > second; ranks are the same with a large number for infinity.
    u = mannwhitneyu(np.minimum(first, 99), np.minimum(second, 99)).statistic
    assert found.value == pytest.approx(1 - u / (23 * 31))
    assert found.low < found.value < found.high


def test_unpaired_interval_is_that_of_a_slow_loop() -> None:
    generator = np.random.default_rng(2)
    first, second = (
        generator.integers(9, size=14).astype(float),
        generator.integers(12, size=17).astype(float),
    )
    strata, others = np.arange(14) % 2, np.arange(17) % 3
    found = unpaired_improvement(first, second, strata, others, generator, resamples=20_000, confidence=0.8)
    drawn = []
    for _ in range(4000):
        x = np.concatenate([generator.choice(first[strata == s], size=(strata == s).sum()) for s in range(2)])
        y = np.concatenate(
            [generator.choice(second[others == s], size=(others == s).sum()) for s in range(3)]
        )
        # The added episode of each, better or worse than all others.
        x, y = np.r_[x, generator.choice([-1, 99])], np.r_[y, generator.choice([-1, 99])]
        drawn.append(np.mean((x[:, None] < y) + 0.5 * (x[:, None] == y)))
    # 31 values in 5 strata: t of 26 degrees of freedom at 90 % is 1.3150, times (31 / 26)^(1/2).
    tail = ndtr(-1.3150 * math.sqrt(31 / 26))
    np.testing.assert_allclose([found.low, found.high], np.quantile(drawn, [tail, 1 - tail]), atol=0.012)


def test_improvement_of_what_never_overlaps_has_a_width() -> None:
    first, second = np.linspace(0, 1, 20), np.linspace(2, 3, 20)
    zeros, generator = np.zeros(20), np.random.default_rng(0)
    apart = unpaired_improvement(first, second, zeros, zeros, generator)
    assert apart.value == apart.high == 1 and 0.8 < apart.low < 0.95
    pairs = paired_improvement(np.stack([first, second]), zeros, generator)
    assert pairs.value[0, 1] == pairs.high[0, 1] == 1 and 0.75 < pairs.low[0, 1] < 0.95
    # All tied: half, as far as 20 goals tell.
    ties = paired_improvement(np.full((2, 20), INF), zeros, generator)
    assert ties.value[0, 1] == 0.5 and 0.4 < ties.low[0, 1] < 0.5 < ties.high[0, 1] < 0.6


def test_improvement_of_single_episodes_knows_nothing() -> None:
    one, generator = np.ones(1), np.random.default_rng(0)
    found = unpaired_improvement(one, 2 * one, one, one, generator)
    assert (found.value, found.low, found.high) == (1, 0, 1)
    pairs = paired_improvement(np.array([[1.0], [2.0]]), one, generator)
    assert (pairs.value[0, 1], pairs.low[0, 1], pairs.high[0, 1]) == (1, 0, 1)


@pytest.mark.parametrize("seeds", [1, 5])
def test_improvement_coverage(seeds: int) -> None:
    generator, strata = np.random.default_rng(22), np.arange(100) % seeds
    common, trials = 0.6, 900
    paired = unpaired = 0
    for trial in range(trials):
        shift = (0.0, 0.5, 1.2)[trial % 3]
        # Goals of different difficulty are common to both policies, which each add what is their own.
        difficulty = math.sqrt(common) * generator.normal(size=100)
        own = math.sqrt(1 - common) * generator.normal(size=(2, 100))
        costs = np.stack([difficulty + own[0], difficulty + own[1] + shift])
        found = paired_improvement(costs, strata, generator, resamples=600)
        truth = ndtr(shift / math.sqrt(2 * (1 - common)))
        paired += found.low[0, 1] <= truth <= found.high[0, 1]
        first, second = generator.normal(size=(2, 100))
        estimate = unpaired_improvement(first, second + shift, strata, strata, generator, resamples=600)
        unpaired += estimate.low <= ndtr(shift / math.sqrt(2)) <= estimate.high
    assert 0.93 <= paired / trials <= 0.97
    assert 0.93 <= unpaired / trials <= 0.97


def test_improvements_pair_the_same_goals_only() -> None:
    records = (
        played("a", [1.0, 4.0, None])
        + list(reversed(played("b", [2.0, 3.0, 4.0])))
        + played("elsewhere", [0.5, 2.5, None], start=10)
        + played("otherwise", [0.5, 2.5, None], seed=4)
        + played("nowhere", [None] * 3)
    )
    found = improvements(records, "final_attitude", np.random.default_rng(0))
    names = [each.policy for each in found.entries]
    assert names == ["a", "b", "elsewhere", "nowhere", "otherwise"]
    same = [0, 1, 3]
    assert found.paired.sum() == 6 and (found.paired | np.eye(5, dtype=bool))[np.ix_(same, same)].all()
    # a beats b on the first goal and loses on the second; the third counts for nobody, since a failed there.
    assert found.probability.value[0, 1] == pytest.approx(1 / 2)
    assert (found.count[0, 1], found.count[1, 0], found.count[1, 1]) == (2, 2, 3)
    # Elsewhere 0.5 beats 1 and 4, 2.5 beats 4.
    assert found.probability.value[2, 0] == pytest.approx(3 / 4)
    assert (found.count[2, 0], found.count[0, 2]) == (2, 2)
    # Nothing can be said of the cost of what captured nothing.
    assert np.isnan(found.probability.value[3, same[:2]]).all() and (found.count[3] == 0).all()
    rest = np.ix_([0, 1, 2, 4], [0, 1, 2, 4])
    np.testing.assert_allclose((found.probability.value + found.probability.value.T)[rest], 1)


def test_costs_are_compared_where_both_captured_and_scores_everywhere() -> None:
    """Doing the easy half of the goals is cheap, but on these goals the other is cheaper still."""
    easy = played("easy", [1.0] * 10 + [None] * 10, attitude_cost=0.02)
    every = [
        changed(record, policy="every", attitude_cost=0.01 if number < 10 else 0.05)
        for number, record in enumerate(played("easy", [1.0] * 20))
    ]
    generator = np.random.default_rng(0)
    rows = {row.policy: row for row in rows_of(easy + every)}
    assert rows["easy"].figures["attitude_cost"].value < rows["every"].figures["attitude_cost"].value
    cost = improvements(easy + every, "attitude_cost", generator)
    assert (cost.probability.value[1, 0], cost.count[1, 0]) == (1.0, 10)
    score = improvements(easy + every, "kept_attitude_score", generator)
    # Half of the goals tie, on the other half one captured.
    assert (score.probability.value[1, 0], score.count[1, 0]) == (0.75, 20)


def test_improvements_do_not_match_a_goal_that_stands_twice() -> None:
    records = [
        make_record(policy=p, episode=e, index=3, final_attitude=e + 1.0) for p in "ab" for e in (0, 1)
    ]
    found = improvements(records, "final_attitude", np.random.default_rng(0))
    assert not found.paired.any()
    assert found.probability.value[0, 1] == 0.5


def test_a_pair_does_not_depend_on_the_others() -> None:
    records = make_result(episodes=30, seeds=3).records
    some = [record for record in records if record.policy in ("gjm", "ppo")]
    whole, pair = (
        improvements(each, "time_to_capture", np.random.default_rng(0), 500) for each in (records, some)
    )
    place = [whole.entries.index(each) for each in pair.entries]
    for name in ("value", "low", "high"):
        both = getattr(whole.probability, name)[np.ix_(place, place)]
        assert np.array_equal(both, getattr(pair.probability, name))
    tau = np.linspace(5, 15, 9)
    bands = [
        profiles(each, "time_to_capture", tau, np.random.default_rng(0), 500) for each in (records, some)
    ]
    assert bytes_of(bands[0][entry("ppo")]) == bytes_of(bands[1][entry("ppo")])


def test_same_seed_same_bytes() -> None:
    records = make_result(episodes=40, seeds=4).records
    # One policy on other goals, so that both forms are drawn.
    records = [dataclasses.replace(r, index=r.index + 7 * (r.policy == "bc"), checksum="") for r in records]
    tau = np.linspace(0, 10, 21)

    def drawn(seed: int, these: Sequence[EpisodeRecord]) -> list[bytes]:
        generator = np.random.default_rng(seed)
        parts = [bytes_of(e) for e in profiles(these, "final_attitude", tau, generator, 400).values()]
        parts.append(bytes_of(improvements(these, "final_attitude", generator, 400).probability))
        scores = normalised_scores(these, {"mpc", "gjm"}, generator, 400)
        parts.append(repr(scores).encode())
        return parts

    first = drawn(3, records)
    np.random.random(5)
    assert drawn(3, records) == first
    # Neither does the order of the records matter.
    assert drawn(3, list(reversed(records))) == first
    assert all(one != other for one, other in zip(drawn(4, records)[-2:], first[-2:], strict=True))


# Pareto front


def test_dominance_by_hand() -> None:
    points = np.array([[0, 1, 5], [0, 1, 5], [0, 2, 5], [1, 0, INF], [1, 0, INF], [1, 2, INF]])
    assert [np.flatnonzero(column).tolist() for column in dominance(points).T] == [
        [],
        [],  # equal points leave each other alone
        [0, 1],
        [],
        [],
        [0, 1, 2, 3, 4],
    ]


def test_dominance_is_that_of_a_slow_loop() -> None:
    points = np.random.default_rng(3).integers(4, size=(40, 3))
    found = dominance(points)
    for i, one in enumerate(points):
        for j, other in enumerate(points):
            assert found[i, j] == (all(one <= other) and any(one < other))


def test_pareto_front_by_hand() -> None:
    def timed(policy: str, attitudes: Sequence[float | None], planning: float | None, action: float | None):
        timing = {"planning_ms": planning, "action_ms": action, "processor": "made up", "threads": 1}
        return played(policy, attitudes, timing=timing)

    records = (
        timed("good", [1.0] * 4, 20.0, 1.0)
        + timed("slower", [1.0] * 4, 30.0, 1.0)
        + timed("quick", [3.0] * 4, None, 2.0)
        + timed("untimed", [0.5] * 4, None, None)
        + timed("often", [0.0, 2.0, 2.0, None], 30.0, 1.0)
        + timed("hold", [0.0] * 4, None, 0.5)
        + timed("never", [None] * 4, None, 0.5)
    )
    found = {each.entry.policy: each for each in pareto_front(rows_of(records))}
    assert {name: [other.policy for other in each.dominated_by] for name, each in found.items()} == {
        "good": [],
        "slower": ["good"],
        "quick": [],
        "untimed": [],
        "often": ["good", "slower"],  # scores 5/12 with waiting as long, theirs is 1/2
        "hold": [],
        "never": [],
    }
    assert {name for name, each in found.items() if each.on_front} == {"good", "quick", "untimed"}
    assert (found["good"].wait, found["quick"].wait, found["untimed"].wait) == (21, 2, INF)
    assert (found["often"].success, found["often"].score) == (0.75, pytest.approx(5 / 12))


# Input


@pytest.mark.parametrize(
    "call",
    [
        lambda g: performance_profile(np.array([1.0, math.nan]), np.zeros(2), np.ones(1), g),
        lambda g: performance_profile(np.ones(2), np.zeros(2), np.array([INF]), g),
        lambda g: performance_profile(np.ones(2), np.zeros(3), np.ones(1), g),
        lambda g: performance_profile(np.ones(0), np.zeros(0), np.ones(1), g),
        lambda g: paired_improvement(np.ones(3), np.zeros(3), g),
        lambda g: paired_improvement(np.full((2, 2), math.nan), np.zeros(2), g),
        lambda g: unpaired_improvement(np.ones(0), np.ones(2), np.zeros(0), np.zeros(2), g),
        lambda g: unpaired_improvement(np.array([math.nan]), np.ones(2), np.zeros(1), np.zeros(2), g),
        lambda g: unpaired_improvement(np.ones(2), np.ones(2), np.zeros(2), np.zeros(2), g, resamples=0),
        lambda g: dominance(np.ones(3)),
        lambda g: dominance(np.full((2, 2), math.nan)),
        lambda g: profiles(played("a", [1.0]), "final_atitude", np.ones(1), g),
        lambda g: improvements(played("a", [1.0]) + played("a", [1.0], difficulty="easy"), COSTS[0], g),
        lambda g: pareto_front(rows_of(played("a", [1.0]) + played("a", [1.0], difficulty="easy"))),
    ],
)
def test_bad_input_is_refused(call) -> None:
    with pytest.raises(ConfigurationError):
        call(np.random.default_rng(0))


def test_a_wrong_cost_is_answered_with_the_nearest() -> None:
    with pytest.raises(ConfigurationError, match="final_attitude"):
        profiles(played("a", [1.0]), "final_atitude", np.ones(1), np.random.default_rng(0))
