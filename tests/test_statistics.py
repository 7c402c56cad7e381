"""Statistics against hand-worked cases, scipy, and coverage by simulation."""

import math

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.special import ndtri
from scipy.stats import binomtest, trim_mean

from space_envs.errors import ConfigurationError
from space_envs.evaluation.statistics.averages import interquartile_mean, median
from space_envs.evaluation.statistics.intervals import (
    Estimate,
    share_bootstrap,
    stratified_bootstrap,
    wilson_interval,
)
from space_envs.evaluation.statistics.resampling import named_generator, resampled_counts, strata_groups
from space_envs.evaluation.statistics.scores import capture_rate, kept_attitude, kept_attitude_score


def mean(values: np.ndarray) -> np.ndarray:
    return values.mean(axis=-1)


def test_interquartile_mean_by_hand() -> None:
    assert interquartile_mean(np.array([8, 1, 7, 2, 6, 3, 5, 4])) == 4.5
    assert interquartile_mean(np.array([100.0, 0.0, 1.0, 3.0])) == 2.0
    # Fewer than four values leave nothing to cut.
    assert interquartile_mean(np.array([0.0, 1.0, 8.0])) == 3.0
    assert interquartile_mean(np.array([5.0])) == 5.0


@pytest.mark.parametrize("count", [1, 3, 4, 7, 10, 50])
def test_interquartile_mean_is_scipys_trimmed_mean(count: int) -> None:
    values = np.random.default_rng(count).normal(size=(6, count))
    np.testing.assert_allclose(interquartile_mean(values), trim_mean(values, 0.25, axis=-1), rtol=1e-12)


def test_missing_values_rank_last_and_are_not_dropped() -> None:
    values = np.array([1.0, 2.0, 3.0, math.inf])
    assert interquartile_mean(values) == 2.5
    assert interquartile_mean(np.array([1.0, 2.0, math.inf, math.inf])) == math.inf
    assert median(np.array([4.0, math.inf, 2.0])) == 4.0
    assert median(np.array([4.0, math.inf])) == math.inf
    assert median(np.array([4.0, 1.0, 2.0, 3.0])) == 2.5


def test_bootstrap_by_hand() -> None:
    # Means of resamples of (0, 1) are 0, 1/2, 1 with probability 1/4, 1/2, 1/4.
    estimate = stratified_bootstrap(
        np.array([0.0, 1.0]), np.zeros(2), np.random.default_rng(0), mean, resamples=400
    )
    assert estimate == Estimate(0.5, 0.0, 1.0)


def test_bootstrap_resamples_inside_strata_only() -> None:
    values, strata = np.array([0.0, 0.0, 0.0, 1.0, 1.0, 1.0]), np.array([3, 3, 3, 9, 9, 9])
    inside = stratified_bootstrap(values, strata, np.random.default_rng(0), mean)
    assert inside == Estimate(0.5, 0.5, 0.5)
    across = stratified_bootstrap(values, np.zeros(6), np.random.default_rng(0), mean)
    assert across.low < 0.3 and across.high > 0.7


def test_bootstrap_pools_strata_of_one() -> None:
    values = np.random.default_rng(1).normal(size=30)
    single = stratified_bootstrap(values, np.arange(30), np.random.default_rng(0))
    pooled = stratified_bootstrap(values, np.zeros(30), np.random.default_rng(0))
    assert single == pooled
    assert single.low < single.value < single.high


def test_bootstrap_of_one_value_has_no_interval() -> None:
    assert stratified_bootstrap(np.array([2.0]), np.zeros(1), np.random.default_rng(0)) == Estimate(
        2.0, -math.inf, math.inf
    )


def test_bootstrap_with_missing_values_has_no_nan() -> None:
    values = np.r_[np.linspace(0, 1, 17), np.full(3, math.inf)]
    estimate = stratified_bootstrap(values, np.zeros(20), np.random.default_rng(0))
    assert math.isfinite(estimate.value) and math.isfinite(estimate.low)
    # Some resamples hold more than a quarter of missing values.
    assert estimate.high == math.inf


def test_bootstrap_repeats_with_its_generator_alone() -> None:
    values, strata = np.random.default_rng(2).normal(size=40), np.arange(40) % 4
    first = stratified_bootstrap(values, strata, np.random.default_rng(5))
    np.random.random(3)
    assert stratified_bootstrap(values, strata, np.random.default_rng(5)) == first
    assert stratified_bootstrap(values, strata, np.random.default_rng(6)) != first


# Means of the quantile functions over u in 1/4..3/4: by symmetry, in closed form, by quadrature.
TRUTHS = {
    "normal": 0.0,
    "exponential": 2 * (0.5 + 0.25 * math.log(0.25) - 0.75 * math.log(0.75)),
    "lognormal": 2 * quad(lambda u: math.exp(ndtri(u)), 0.25, 0.75)[0],
}


@pytest.mark.parametrize(("episodes", "seeds"), [(100, 1), (100, 5), (50, 1), (50, 5), (20, 4)])
@pytest.mark.parametrize("name", ["normal", "exponential", "lognormal"])
def test_bootstrap_coverage(episodes: int, seeds: int, name: str) -> None:
    # At 20 episodes in 4 strata plain percentiles cover 90 %.
    generator = np.random.default_rng(11)
    draw = getattr(generator, name)
    trials, hits = 1500, 0
    for _ in range(trials):
        estimate = stratified_bootstrap(
            draw(size=episodes), np.arange(episodes) % seeds, generator, resamples=400
        )
        hits += estimate.low <= TRUTHS[name] <= estimate.high
    assert 0.93 <= hits / trials <= 0.97


def test_bootstrap_coverage_where_seeds_differ() -> None:
    # Strata with means of their own: pooling them would cover nearly always.
    generator = np.random.default_rng(12)
    strata = np.arange(100) % 5
    trials, hits, pooled = 1000, 0, 0
    for _ in range(trials):
        values = generator.normal(size=100) + 3.0 * strata
        estimate = stratified_bootstrap(values, strata, generator, mean, resamples=400)
        hits += estimate.low <= 6.0 <= estimate.high
        estimate = stratified_bootstrap(values, np.zeros(100), generator, mean, resamples=400)
        pooled += estimate.low <= 6.0 <= estimate.high
    assert 0.93 <= hits / trials <= 0.97
    assert pooled / trials > 0.99


def test_resampled_counts_draw_inside_groups() -> None:
    groups = strata_groups(np.array([7, 3, 7, 3, 3, 9, 1]))
    # In the order of the strata, those of one value pooled at the end.
    assert [group.tolist() for group in groups] == [[1, 3, 4], [0, 2], [6, 5]]
    times = np.concatenate(list(resampled_counts(groups, np.random.default_rng(0), 4000)))
    assert times.shape == (4000, 7)
    for group in groups:
        assert np.all(times[:, group].sum(axis=1) == group.size)
    # Binomial(size, 1 / size) for each value.
    np.testing.assert_allclose(times.mean(axis=0), 1, atol=0.06)
    np.testing.assert_allclose(times.var(axis=0)[[1, 3, 4]], 2 / 3, atol=0.06)


def test_resampled_counts_come_in_pieces(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("space_envs.evaluation.statistics.resampling.HELD_VALUES", 50)
    pieces = list(resampled_counts([np.arange(10)], np.random.default_rng(0), 23))
    assert [len(piece) for piece in pieces] == [5, 5, 5, 5, 3]
    assert np.all(np.concatenate(pieces).sum(axis=1) == 10)


def test_share_by_hand() -> None:
    # Three of twelve and 0, 0, 1, 1: 5 of 16. Variances 12 (1/4) (3/4), times 12 / 11, and 4 (1/2) (1/2).
    values = np.repeat([[1.0], [0.0]], [3, 9], axis=0)
    found = share_bootstrap(values, np.zeros(12), np.random.default_rng(0), resamples=40_000)
    reach = 1.959964 * math.sqrt(2.25 * 12 / 11 + 1)
    assert found.value[0] == 0.25
    assert (found.low[0], found.high[0]) == pytest.approx(((5 - reach) / 16, (5 + reach) / 16), abs=0.005)


@pytest.mark.parametrize(("count", "won"), [(100, 100), (100, 0), (100, 97), (30, 30), (500, 250)])
def test_share_is_near_wilson(count: int, won: int) -> None:
    values = (np.arange(count) < won).astype(float)[:, None]
    found, wilson = (
        share_bootstrap(values, np.zeros(count), np.random.default_rng(0)),
        wilson_interval(won, count),
    )
    assert found.value[0] == wilson.value
    np.testing.assert_allclose([found.low[0], found.high[0]], [wilson.low, wilson.high], atol=1.2 / count)


def test_shares_of_one_episode_have_the_whole_range() -> None:
    found = share_bootstrap(np.array([[1.0, 0.5]]), np.zeros(1), np.random.default_rng(0))
    assert [found.value.tolist(), found.low.tolist(), found.high.tolist()] == [[1, 0.5], [0, 0], [1, 1]]


def test_shares_do_not_depend_on_other_columns() -> None:
    values = np.random.default_rng(1).integers(3, size=(40, 6)) / 2
    strata = np.arange(40) % 4
    together = share_bootstrap(values, strata, np.random.default_rng(0))
    alone = share_bootstrap(values[:, 2:3], strata, np.random.default_rng(0))
    assert (together.low[2], together.high[2]) == (alone.low[0], alone.high[0])


@pytest.mark.parametrize(("episodes", "seeds"), [(100, 1), (100, 5), (30, 1), (20, 4), (10, 5)])
def test_share_coverage(episodes: int, seeds: int) -> None:
    # Shares lie on a lattice, so that the coverage of each rate jumps; the mean over rates is what counts.
    generator = np.random.default_rng(13)
    rates = np.linspace(0.02, 0.98, 25)
    strata = np.arange(episodes) % seeds
    hits = []
    for _ in range(120):
        found = share_bootstrap(
            (generator.random((episodes, 25)) < rates).astype(float), strata, generator, resamples=1000
        )
        hits.append((found.low <= rates) & (rates <= found.high))
    assert 0.93 <= np.mean(hits) <= 0.97


def test_share_coverage_of_rare_failures() -> None:
    # Percentiles of resamples do not see what did not happen: they cover 63 % at 1 in 100, 87 % at 2.
    generator = np.random.default_rng(14)
    rare = np.array([0.004, 0.006, 0.008, 0.01, 0.015, 0.02, 0.03])
    rates = np.concatenate([rare, 1 - rare])
    hits = []
    for _ in range(300):
        won = (generator.random((100, 14)) < rates).astype(float)
        found = share_bootstrap(won, np.zeros(100), generator, resamples=1000)
        hits.append((found.low <= rates) & (rates <= found.high))
    assert 0.93 <= np.mean(hits) <= 0.97
    assert np.min(np.mean(hits, axis=0)) >= 0.89


def test_named_generators() -> None:
    first = named_generator(5, "a", "bc").random(3)
    assert np.array_equal(named_generator(5, "a", "bc").random(3), first)
    for other in (named_generator(6, "a", "bc"), named_generator(5, "ab", "c"), named_generator(5, "a")):
        assert not np.array_equal(other.random(3), first)


def test_wilson_by_hand() -> None:
    z = 1.959963984540054
    none, all_of_them, some = wilson_interval(0, 10), wilson_interval(10, 10), wilson_interval(8, 10)
    assert (none.value, none.low, all_of_them.value, all_of_them.high) == (0.0, 0.0, 1.0, 1.0)
    assert none.high == pytest.approx(z * z / (10 + z * z))
    assert all_of_them.low == pytest.approx(10 / (10 + z * z))
    assert (some.low, some.high) == pytest.approx((0.4901625, 0.9433178), abs=1e-6)


@pytest.mark.parametrize(("successes", "trials"), [(0, 1), (1, 3), (47, 50), (50, 50), (480, 500)])
def test_wilson_is_scipys(successes: int, trials: int) -> None:
    interval = binomtest(successes, trials).proportion_ci(method="wilson")
    estimate = wilson_interval(successes, trials)
    np.testing.assert_allclose((estimate.low, estimate.high), (interval.low, interval.high), atol=1e-12)


def test_wilson_coverage() -> None:
    # Exact, from the binomial distribution: the mean coverage over rates is what Wilson's interval promises.
    trials = 50
    intervals = [wilson_interval(k, trials) for k in range(trials + 1)]
    coverage = []
    for rate in np.linspace(0.02, 0.98, 97):
        chances = [math.comb(trials, k) * rate**k * (1 - rate) ** (trials - k) for k in range(trials + 1)]
        coverage.append(sum(c for c, e in zip(chances, intervals, strict=True) if e.low <= rate <= e.high))
    assert 0.945 <= np.mean(coverage) <= 0.96


def test_capture_rate_counts_failures_and_attitude() -> None:
    captured = np.array([True, True, True, False, False])
    attitude = np.array([0.05, 0.1, 4.0, 0.0, math.inf])
    assert capture_rate(captured).value == 0.6
    assert capture_rate(captured, attitude, 5.0).value == 0.6
    assert capture_rate(captured, attitude, 1.0).value == 0.4
    # The limit itself still counts, and a failure with a still base does not.
    assert capture_rate(captured, attitude, 0.1).value == 0.4
    assert capture_rate(captured, attitude, 0.09).value == 0.2


def test_kept_attitude_by_hand() -> None:
    captured = np.array([True, True, True, False, False])
    peak = np.array([0.0, 1.0, 3.0, 0.0, math.inf])
    assert kept_attitude(captured, peak).tolist() == [1, 1 / 2, 1 / 4, 0, 0]
    found = kept_attitude_score(captured, peak, np.zeros(5), np.random.default_rng(0))
    assert found.value == pytest.approx(1.75 / 5)
    assert 0 < found.low < found.value < found.high < 1


def test_score_of_captures_that_never_turn_is_that_of_the_rate() -> None:
    captured = np.arange(40) < 30
    found = kept_attitude_score(captured, np.zeros(40), np.zeros(40), np.random.default_rng(0))
    rate = wilson_interval(30, 40)
    assert vars(found) == pytest.approx(vars(rate))
    # Who never failed has an interval, and who never captured one as wide as the rate's.
    every = kept_attitude_score(np.ones(40, dtype=bool), np.zeros(40), np.zeros(40), np.random.default_rng(0))
    assert vars(every) == pytest.approx(vars(wilson_interval(40, 40)))
    none = kept_attitude_score(np.zeros(40, dtype=bool), np.zeros(40), np.zeros(40), np.random.default_rng(0))
    assert vars(none) == pytest.approx(vars(wilson_interval(0, 40)))


def test_score_of_one_episode_knows_little() -> None:
    found = kept_attitude_score(np.array([True]), np.array([1.0]), np.zeros(1), np.random.default_rng(0))
    assert (found.value, found.low) == (0.5, 0.0) and found.high == 1.0


@pytest.mark.parametrize(("rate", "seeds"), [(0.98, 1), (0.9, 5), (0.6, 1)])
def test_score_coverage(rate: float, seeds: int) -> None:
    generator, strata = np.random.default_rng(15), np.arange(100) % seeds
    truth = rate * quad(lambda u: 1 / (1 + math.exp(ndtri(u))), 0, 1)[0]
    trials, hits = 500, 0
    for _ in range(trials):
        captured, peak = generator.random(100) < rate, generator.lognormal(size=100)
        found = kept_attitude_score(captured, peak, strata, generator, resamples=400)
        hits += found.low <= truth <= found.high
    assert 0.93 <= hits / trials <= 0.975


def test_bad_input_is_refused() -> None:
    for call in (
        lambda: interquartile_mean(np.array([])),
        lambda: interquartile_mean(np.array([1.0, math.nan])),
        lambda: median(np.array([1.0, -math.inf])),
        lambda: wilson_interval(3, 2),
        lambda: wilson_interval(0, 0),
        lambda: wilson_interval(-1, 5),
        lambda: capture_rate(np.array([True]), None, 1.0),
        lambda: stratified_bootstrap(np.ones(3), np.ones(2), np.random.default_rng(0)),
        lambda: stratified_bootstrap(np.ones((3, 3)), np.ones((3, 3)), np.random.default_rng(0)),
        lambda: stratified_bootstrap(np.ones(3), np.ones(3), np.random.default_rng(0), resamples=0),
        lambda: share_bootstrap(np.ones(3), np.ones(3), np.random.default_rng(0)),
        lambda: share_bootstrap(np.ones((3, 2)), np.ones(2), np.random.default_rng(0)),
        lambda: share_bootstrap(np.ones((0, 2)), np.ones(0), np.random.default_rng(0)),
        lambda: share_bootstrap(np.full((3, 2), 0.7), np.ones(3), np.random.default_rng(0)),
        lambda: share_bootstrap(np.ones((3, 2)), np.ones(3), np.random.default_rng(0), resamples=0),
    ):
        with pytest.raises(ConfigurationError):
            call()
