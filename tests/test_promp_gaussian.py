"""Conditioning and density of Gaussians with singular covariances (shyam2020, eq. 18, 19)."""

import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from movement_primitives.promp import ProMP as ReferenceProMP
from scipy.stats import multivariate_normal

from promp import ConditioningError, PrompError, condition_gaussian
from promp.gaussian import factor_covariance, log_density


def random_gaussian(rng, dimension, rank):
    directions = rng.standard_normal((dimension, rank))
    return rng.standard_normal(dimension), directions @ directions.T


@given(st.integers(0, 2**32 - 1), st.integers(1, 8), st.integers(1, 4))
def test_textbook_formula_with_noise(seed, dimension, rows):
    rng = np.random.default_rng(seed)
    mean, covariance = random_gaussian(rng, dimension, dimension + 2)
    features, target = rng.standard_normal((rows, dimension)), rng.standard_normal(rows)
    root = rng.standard_normal((rows, rows)) + 2 * np.eye(rows)
    noise = root @ root.T + 0.1 * np.eye(rows)
    got_mean, got_covariance = condition_gaussian(mean, covariance, features, target, noise)
    gain = covariance @ features.T @ np.linalg.inv(noise + features @ covariance @ features.T)
    np.testing.assert_allclose(got_mean, mean + gain @ (target - features @ mean), atol=1e-8)
    np.testing.assert_allclose(got_covariance, covariance - gain @ features @ covariance, atol=1e-8)


@given(st.integers(0, 2**32 - 1), st.integers(2, 10), st.data())
def test_exact_rows_are_met_and_uncertainty_never_grows(seed, dimension, data):
    rng = np.random.default_rng(seed)
    rank = data.draw(st.integers(1, dimension))
    rows = data.draw(st.integers(1, dimension + 2))
    mean, covariance = random_gaussian(rng, dimension, rank)
    features = rng.standard_normal((rows, dimension))
    # A feasible target is one that a sample has; rows beyond the rank are then redundant, and harmless.
    factor = factor_covariance(covariance)
    target = features @ (mean + factor.directions @ rng.standard_normal(factor.deviations.size))
    got_mean, got_covariance = condition_gaussian(mean, covariance, features, target)
    np.testing.assert_allclose(features @ got_mean, target, rtol=0, atol=1e-9)
    np.testing.assert_allclose(
        features @ got_covariance @ features.T, 0, atol=1e-12 * max(1, factor.largest**2)
    )
    size = np.linalg.eigvalsh(covariance).max()
    assert np.linalg.eigvalsh(got_covariance).min() >= -1e-14 * size
    assert np.linalg.eigvalsh(covariance - got_covariance).min() >= -1e-10 * size


@given(st.integers(0, 2**32 - 1), st.floats(0, 2), st.floats(0, 2))
def test_order_does_not_matter(seed, first_noise, second_noise):
    rng = np.random.default_rng(seed)
    mean, covariance = random_gaussian(rng, 8, 6)
    features, target = rng.standard_normal((4, 8)), rng.standard_normal(4)
    noise = np.array([first_noise, first_noise, second_noise, second_noise])
    together = condition_gaussian(mean, covariance, features, target, noise)
    first, second = slice(0, 2), slice(2, 4)
    for order in ((first, second), (second, first)):
        step = (mean, covariance)
        for part in order:
            step = condition_gaussian(*step, features[part], target[part], noise[part])
        scale = np.abs(together[0]).max()
        np.testing.assert_allclose(step[0], together[0], rtol=0, atol=1e-6 * scale)
        np.testing.assert_allclose(step[1], together[1], rtol=0, atol=1e-8 * np.abs(covariance).max())


def test_small_noise_tends_to_no_noise():
    rng = np.random.default_rng(0)
    mean, covariance = random_gaussian(rng, 6, 6)
    features, target = rng.standard_normal((2, 6)), rng.standard_normal(2)
    exact = condition_gaussian(mean, covariance, features, target)
    for deviation in (1e-3, 1e-5, 1e-7, 1e-12, 1e-160):
        got = condition_gaussian(mean, covariance, features, target, deviation**2)
        np.testing.assert_allclose(got[0], exact[0], rtol=0, atol=100 * deviation**2 + 1e-12)
        np.testing.assert_allclose(features @ got[1] @ features.T, 0, atol=2 * deviation**2 + 1e-12)


def test_mixed_exact_and_noisy_rows_of_very_different_noise():
    rng = np.random.default_rng(1)
    mean, covariance = random_gaussian(rng, 6, 6)
    features, target = rng.standard_normal((3, 6)), rng.standard_normal(3)
    got = condition_gaussian(mean, covariance, features, target, [0.0, 1e-8, 1e12])
    assert features[0] @ got[0] == pytest.approx(target[0], abs=1e-12)
    assert features[1] @ got[1] @ features[1] == pytest.approx(1e-8, rel=1e-3)
    alone = condition_gaussian(mean, covariance, features[:2], target[:2], [0.0, 1e-8])
    np.testing.assert_allclose(got[0], alone[0], atol=1e-9)  # a row of noise 1e6 says nothing


def fixed_first():
    """Mean (5,) and covariance (5, 5) of a Gaussian whose first entry is fixed at 0.7."""
    mean, covariance = random_gaussian(np.random.default_rng(2), 5, 5)
    covariance[0] = covariance[:, 0] = 0.0
    mean[0] = 0.7
    return mean, covariance, np.eye(5)[:1]


def test_fixed_row_that_agrees_is_a_no_op():
    mean, covariance, row = fixed_first()
    cases = (([0.7], 0.0), ([np.float32(0.7)], 0.0), ([0.7], 1e-6), ([0.7], 4.0), ([0.9], 0.01))
    for target, noise in cases:
        got = condition_gaussian(mean, covariance, row, target, noise)
        np.testing.assert_allclose(got[0], mean, rtol=0, atol=1e-12)
        np.testing.assert_allclose(got[1], covariance, rtol=0, atol=1e-11)


def test_rounding_in_a_fixed_row_is_not_read_as_motion():
    """A covariance that fixes a row only up to rounding, asked with a small noise for something far away."""
    mean, covariance, _ = fixed_first()
    rotation = np.linalg.qr(np.random.default_rng(3).standard_normal((5, 5)))[0]
    mean, covariance, row = rotation @ mean, rotation @ covariance @ rotation.T, rotation[:, :1].T
    got = condition_gaussian(mean, covariance, row, [0.8], 1e-5**2)
    np.testing.assert_allclose(got[0], mean, rtol=0, atol=1e-4)


def test_fixed_row_that_disagrees_is_refused():
    mean, covariance, row = fixed_first()
    with pytest.raises(
        ConditioningError, match="row 0: target 0.8 has a residual of 0.1, since there is no variance"
    ) as caught:
        condition_gaussian(mean, covariance, row, [0.8])
    np.testing.assert_allclose(caught.value.residual, [0.1])
    copy = pickle.loads(pickle.dumps(caught.value))
    assert str(copy) == str(caught.value) and copy.row == 0
    with pytest.raises(ConditioningError):
        condition_gaussian(mean, covariance, row, [0.7 + 1e-5])
    condition_gaussian(mean, covariance, row, [0.7 + 1e-5], tolerance=1e-4)
    # A noise too small to be told from rounding still widens the tolerance, but not by more than itself.
    deviation = 3e-7 * factor_covariance(covariance).largest
    condition_gaussian(mean, covariance, row, [0.7 + 0.9 * deviation], deviation**2, tolerance=0.0)
    with pytest.raises(ConditioningError):
        condition_gaussian(mean, covariance, row, [0.8], deviation**2)


def test_tolerance_is_relative_for_large_targets():
    mean, covariance, row = fixed_first()
    mean[0] = 1000.0
    condition_gaussian(mean, covariance, row, [1000.0 + 9e-4])
    with pytest.raises(ConditioningError):
        condition_gaussian(mean, covariance, row, [1000.0 + 2e-3])


def test_contradicting_rows_are_refused():
    mean, covariance = random_gaussian(np.random.default_rng(4), 4, 4)
    row = np.ones((1, 4))
    with pytest.raises(ConditioningError):
        condition_gaussian(mean, covariance, np.vstack([row, 2 * row]), [1.0, 2.1])
    got = condition_gaussian(mean, covariance, np.vstack([row, 2 * row]), [1.0, 2.0])
    assert got[0].sum() == pytest.approx(1.0, abs=1e-12)


def test_target_absurdly_many_deviations_away_is_refused():
    covariance = np.diag([1e-10, 1.0])
    covariance[0, 1] = covariance[1, 0] = 0.5e-5
    np.testing.assert_allclose(
        condition_gaussian(np.zeros(2), covariance, np.eye(2)[:1], [1e-3])[0], [1e-3, 50.0], rtol=1e-6
    )
    with pytest.raises(ConditioningError, match="row 0: target 0.1 lies 1e[+]04 standard deviations"):
        condition_gaussian(np.zeros(2), covariance, np.eye(2)[:1], [0.1])


def test_point_distribution():
    mean, nothing = np.array([1.0, 2.0]), np.zeros((2, 2))
    for noise in (0.0, 1.0):
        got = condition_gaussian(mean, nothing, np.eye(2), mean, noise)
        np.testing.assert_array_equal(got[0], mean)
        np.testing.assert_array_equal(got[1], nothing)
    with pytest.raises(ConditioningError):
        condition_gaussian(mean, nothing, np.eye(2), [1.0, 3.0])


@given(st.integers(0, 2**32 - 1), st.floats(0, 1), st.floats(0, 1))
@settings(deadline=None)
def test_agreement_with_movement_primitives(seed, phase, accuracy):
    """The same prior in the other library, its own (normalised) basis, one position conditioned."""
    rng = np.random.default_rng(seed)
    reference = ReferenceProMP(n_dims=3, n_weights_per_dim=6)
    mean, covariance = random_gaussian(rng, 18, 30)
    reference.from_weight_distribution(mean, covariance)
    target = rng.standard_normal(3)
    noise = accuracy**2 * np.eye(3)
    expected = reference.condition_position(target, noise, t=phase)
    features = np.kron(np.eye(3), reference._rbfs_1d_point(phase))
    got_mean, got_covariance = condition_gaussian(mean, covariance, features, target, noise)
    np.testing.assert_allclose(got_mean, expected.weight_mean, rtol=0, atol=1e-8)
    np.testing.assert_allclose(got_covariance, expected.weight_cov, rtol=0, atol=1e-8)


@given(st.integers(0, 2**32 - 1), st.integers(1, 6), st.data())
def test_log_density_agrees_with_scipy(seed, dimension, data):
    rng = np.random.default_rng(seed)
    mean, covariance = random_gaussian(rng, dimension, data.draw(st.integers(1, dimension)))
    factor = factor_covariance(covariance)
    points = mean + rng.standard_normal((7, factor.deviations.size)) @ factor.directions.T
    expected = multivariate_normal.logpdf(points, mean, covariance, allow_singular=True)  # pyright: ignore[reportArgumentType]
    np.testing.assert_allclose(log_density(mean, factor, points), expected, rtol=1e-6, atol=1e-6)


def test_log_density_off_the_support():
    mean, covariance, _ = fixed_first()
    factor = factor_covariance(covariance)
    points = np.tile(mean, (2, 2, 1))
    points[0, 1, 0] += 1e-3
    points[1, 1, 0] += 1e-9
    density = log_density(mean, factor, points)
    assert density.shape == (2, 2)
    assert density[0, 1] == -np.inf
    assert (
        density[1, 1]
        == density[0, 0]
        == density[1, 0]
        == pytest.approx(-np.log(factor.deviations).sum() - 2 * np.log(2 * np.pi))
    )
    point = factor_covariance(np.zeros((5, 5)))
    np.testing.assert_array_equal(log_density(mean, point, np.array([mean, mean + 1e-6])), [0.0, -np.inf])


def test_bad_input_is_named():
    mean, covariance = random_gaussian(np.random.default_rng(5), 4, 4)
    row, target = np.ones((1, 4)), [0.0]
    skewed = covariance.copy()
    skewed[0, 1] += 1.0
    cases = [
        ((mean, skewed, row, target), "covariance: expected a symmetric matrix"),
        ((mean, -covariance, row, target), "covariance: expected no negative eigenvalue"),
        ((mean, covariance[:3], row, target), "covariance: expected a square matrix"),
        ((mean[:3], covariance, row[:, :3], target), "covariance: expected 3 rows"),
        ((mean, covariance, row[0], target), "features: expected shape"),
        ((mean, covariance, row, [0.0, 1.0]), "target: expected shape"),
        ((mean, covariance, row, [np.nan]), "target: expected finite"),
        ((mean * np.inf, covariance, row, target), "mean: expected finite"),
        ((mean, covariance, row, target, -1.0), "noise: expected variances of at least 0"),
        ((mean, covariance, row, target, [1.0, 2.0]), "noise: expected shape"),
        ((mean, covariance, row, target, np.nan), "noise: expected finite"),
        ((mean, covariance, np.eye(4)[:2], [0, 0], [[0.0, 1.0], [1.0, 0.0]]), "noise: expected no negative"),
        ((mean, covariance, row, target, 0.0, -1.0), "tolerance"),
    ]
    for arguments, message in cases:
        with pytest.raises(PrompError, match=message):
            condition_gaussian(*arguments)
