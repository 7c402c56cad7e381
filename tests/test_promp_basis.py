"""The basis functions and the ridge regression onto them (shyam2020, appendix I, eq. 16)."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from promp import GaussianBasis, PrompError, regress_weights

DURATION = 10.0
PHASE = np.linspace(0, 1, 100)
MINIMUM_JERK = 10 * PHASE**3 - 15 * PHASE**4 + 6 * PHASE**5
MINIMUM_JERK_RATE = 30 * PHASE**2 * (1 - PHASE) ** 2 / DURATION


def test_values_are_the_papers_formula():
    basis = GaussianBasis()
    assert basis.centres == (-0.142, 0.0, 0.142, 0.285, 0.428, 0.571, 0.714, 0.857, 1.0, 1.142)
    assert basis.bandwidth == 0.143
    # At phase 0.5 the fifth function, centred at 0.428: exp(-(0.072 / 0.143)^2) = exp(-0.25351...).
    assert basis.value(0.5)[4] == pytest.approx(0.776072, abs=1e-6)
    assert basis.value(0.0)[1] == 1.0
    assert basis.value(np.zeros((4, 3))).shape == (4, 3, 10)


@given(
    st.floats(0.001, 0.999),
    st.floats(0.05, 0.5),
    st.lists(st.floats(-0.2, 1.2), min_size=1, max_size=12),
)
def test_derivatives_agree_with_finite_differences(phase, bandwidth, centres):
    basis = GaussianBasis(tuple(centres), bandwidth)
    step = 1e-4 * bandwidth  # phases stay inside [0, 1]
    for function, derivative in (
        (basis.value, basis.derivative),
        (basis.derivative, basis.second_derivative),
    ):
        difference = (function(phase + step) - function(phase - step)) / (2 * step)
        scale = 1 / bandwidth if function == basis.value else 1 / bandwidth**2
        # The error of a central difference: step^2 / 6 times the third derivative, which is at most ~ 12 /
        # h^3.
        np.testing.assert_allclose(derivative(phase), difference, rtol=0, atol=1e-6 * scale)


def test_bandwidth_is_the_well_conditioned_choice():
    """The measurements behind PAPER_BANDWIDTH: positions and velocities, 100 points in 10 s."""

    def measure(bandwidth):
        basis = GaussianBasis(bandwidth=bandwidth)
        features = np.vstack([basis.value(PHASE), basis.derivative(PHASE) / DURATION])
        weights = regress_weights(
            MINIMUM_JERK[None, :, None],
            MINIMUM_JERK_RATE[None, :, None],
            basis=basis,
            duration=DURATION,
            ridge=0.0,
        )
        error = basis.value(PHASE) @ weights[0, 0] - MINIMUM_JERK
        return np.linalg.cond(features.T @ features), np.sqrt(np.mean(error**2))

    condition, error = measure(0.143)
    assert condition == pytest.approx(83.9, abs=0.1)
    assert error == pytest.approx(2.8e-4, rel=0.02)
    assert measure(0.1)[1] / error == pytest.approx(30, abs=0.5)
    wide_condition, wide_error = measure(0.3)
    assert wide_condition > 1e7 and wide_error > 0.5 * error


@pytest.mark.parametrize("with_velocity", [False, True])
@pytest.mark.parametrize("exact_ends", [False, True])
def test_regression_recovers_weights(with_velocity, exact_ends):
    basis = GaussianBasis()
    rng = np.random.default_rng(0)
    weights = rng.standard_normal((6, 3, basis.size))
    positions = np.einsum("tb,dnb->dtn", basis.value(PHASE), weights)
    velocities = (
        np.einsum("tb,dnb->dtn", basis.derivative(PHASE) / DURATION, weights) if with_velocity else None
    )
    found = regress_weights(
        positions, velocities, basis=basis, duration=DURATION, ridge=0.0, exact_ends=exact_ends
    )
    np.testing.assert_allclose(found, weights, rtol=0, atol=1e-11)


def test_regression_is_equation_16():
    basis = GaussianBasis()
    rng = np.random.default_rng(1)
    positions, velocities = rng.standard_normal((2, 5, 40, 2))
    phase = np.sort(rng.uniform(size=40))
    ridge = 0.3
    found = regress_weights(positions, velocities, basis=basis, phase=phase, duration=DURATION, ridge=ridge)
    features = np.vstack([basis.value(phase), basis.derivative(phase) / DURATION])
    for demonstration in range(5):
        for dof in range(2):
            observed = np.concatenate([positions[demonstration, :, dof], velocities[demonstration, :, dof]])
            expected = np.linalg.inv(features.T @ features + ridge * np.eye(10)) @ features.T @ observed
            np.testing.assert_allclose(found[demonstration, dof], expected, rtol=1e-9, atol=1e-12)


def test_exact_ends_are_exact_and_cost_the_fit_least():
    basis = GaussianBasis()
    rng = np.random.default_rng(2)
    positions, velocities = rng.standard_normal((2, 4, 100, 2))
    arguments = {"basis": basis, "duration": DURATION, "ridge": 1e-3}
    weights = regress_weights(positions, velocities, exact_ends=True, **arguments)
    ends = np.vstack([basis.value([0, 1]), basis.derivative([0, 1]) / DURATION])
    wanted = np.concatenate([positions[:, [0, -1]], velocities[:, [0, -1]]], axis=1)
    np.testing.assert_allclose(np.einsum("eb,dnb->den", ends, weights), wanted, rtol=0, atol=1e-10)

    # Stationary: the gradient of the ridge cost has no part in the directions that keep the ends.
    features = np.vstack([basis.value(PHASE), basis.derivative(PHASE) / DURATION])
    observed = np.concatenate([positions, velocities], axis=1)
    error = np.einsum("tb,dnb->dtn", features, weights) - observed
    gradient = np.einsum("tb,dtn->dnb", features, error) + 1e-3 * weights
    free = np.linalg.svd(ends)[2][4:]
    np.testing.assert_allclose(gradient @ free.T, 0, atol=1e-9)


def test_more_functions_than_samples_need_a_ridge():
    positions = np.random.default_rng(3).standard_normal((2, 6, 1))
    with pytest.raises(PrompError, match="6 values .* do not determine 10 weights"):
        regress_weights(positions, basis=GaussianBasis(), ridge=0.0)
    weights = regress_weights(positions, basis=GaussianBasis(), ridge=1e-9)
    fitted = np.einsum("tb,dnb->dtn", GaussianBasis().value(np.linspace(0, 1, 6)), weights)
    np.testing.assert_allclose(fitted, positions, atol=1e-5)


def test_bad_input_is_named():
    basis = GaussianBasis()
    good = np.zeros((2, 20, 3))
    bad = good.copy()
    bad[1, 4, 2] = np.nan
    cases = [
        (lambda: GaussianBasis(bandwidth=0.0), "bandwidth"),
        (lambda: GaussianBasis(bandwidth=float("nan")), "bandwidth"),
        (lambda: GaussianBasis(centres=()), "centres"),
        (lambda: basis.value(1.1), r"phase: expected values in \[0, 1\]"),
        (lambda: basis.value(float("nan")), "phase"),
        (lambda: regress_weights(bad, basis=basis), "positions: expected finite"),
        (
            lambda: regress_weights(good[0], basis=basis),
            r"positions: expected shape \(any, any, any\), got \(20, 3\)",
        ),
        (lambda: regress_weights(good[:0], basis=basis), "at least one demonstration"),
        (lambda: regress_weights(good, good, basis=basis), "duration"),
        (lambda: regress_weights(good, good[:, :3], basis=basis, duration=1.0), "velocities: expected shape"),
        (lambda: regress_weights(good, basis=basis, ridge=-1.0), "ridge"),
        (lambda: regress_weights(good, basis=basis, phase=np.linspace(0, 1, 19)), "phase: expected shape"),
        (lambda: regress_weights("motions", basis=basis), "positions: expected an array"),  # pyright: ignore
        (
            lambda: regress_weights(
                np.arange(20.0)[None, :, None], basis=GaussianBasis((0.5,)), exact_ends=True
            ),
            "exact_ends",
        ),
    ]
    for call, message in cases:
        with pytest.raises(PrompError, match=message):
            call()
