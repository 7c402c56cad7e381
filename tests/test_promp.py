"""ProMP: learning, the distribution of motions, conditioning, sampling (shyam2020, sec. V)."""

import dataclasses
import pickle

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from movement_primitives.promp import ProMP as ReferenceProMP

from promp import ConditioningError, ProMP, PrompError, ViaPoint, regress_weights

DURATION = 10.0
PHASE = np.linspace(0, 1, 101)
HOME = np.array([0.0, 5 * np.pi / 4, 0.0, 0.0, np.pi / 2, -np.pi / 2, 0.0])
REST = np.zeros(7)


def random_promp(seed, n_dof=3, rank=None):
    rng = np.random.default_rng(seed)
    size = n_dof * 10
    directions = rng.standard_normal((size, size if rank is None else rank)) / np.sqrt(size)
    return ProMP(rng.standard_normal((n_dof, 10)), directions @ directions.T)


@pytest.fixture(scope="module")
def demonstrations():
    """540 motions, at rest at both ends, from HOME to scattered goals: positions, velocities."""
    rng = np.random.default_rng(7)
    z = PHASE[:, None]
    goal = rng.uniform(-1, 1, (540, 1, 7))
    positions = HOME + goal * (10 * z**3 - 15 * z**4 + 6 * z**5)
    rates = goal * 30 * z**2 * (1 - z) ** 2
    for wave in range(5):
        amplitude = 10 * rng.standard_normal((540, 1, 7))
        bump, bump_rate = (z * (1 - z)) ** 3, 3 * (z * (1 - z)) ** 2 * (1 - 2 * z)
        angle = np.pi * wave * z
        positions = positions + amplitude * bump * np.cos(angle)
        rates = rates + amplitude * (bump_rate * np.cos(angle) - bump * np.pi * wave * np.sin(angle))
    return positions, rates / DURATION


def start_and_goal(goal):
    return [ViaPoint(0, HOME, REST, DURATION), ViaPoint(1, goal, REST, DURATION)]


def test_mean_and_covariance_are_equation_17(demonstrations):
    positions, velocities = demonstrations
    learned = ProMP.fit(positions, velocities, duration=DURATION)
    weights = regress_weights(positions, velocities, basis=learned.basis, duration=DURATION).reshape(540, 70)
    np.testing.assert_allclose(learned.mean.ravel(), weights.mean(axis=0), rtol=0, atol=1e-12)
    np.testing.assert_allclose(learned.covariance, np.cov(weights.T, bias=True), rtol=0, atol=1e-12)
    noisy = ProMP.fit(positions, velocities, duration=DURATION, weight_noise=0.1)
    np.testing.assert_allclose(noisy.covariance, learned.covariance + 0.01 * np.eye(70), rtol=0, atol=1e-15)


def test_learned_mean_follows_the_demonstrations(demonstrations):
    positions, velocities = demonstrations
    for exact_ends in (False, True):
        learned = ProMP.fit(positions, velocities, duration=DURATION, exact_ends=exact_ends)
        assert np.abs(learned.position(PHASE) - positions.mean(axis=0)).max() < 0.02
        assert np.abs(learned.velocity(PHASE, DURATION) - velocities.mean(axis=0)).max() < 0.03


@pytest.mark.parametrize("exact_ends", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_start_and_goal_at_rest_are_met_by_every_sample(demonstrations, exact_ends, seed):
    """The covariance is singular: all demonstrations share the start and end at rest."""
    rng = np.random.default_rng(seed)
    learned = ProMP.fit(*demonstrations, duration=DURATION, exact_ends=exact_ends)
    assert learned.factor.deviations.size < 70
    goal = HOME + rng.uniform(-1, 1, 7)
    conditioned = learned.condition_on(start_and_goal(goal))
    motions = conditioned.trajectories(conditioned.sample(rng, 100), PHASE, DURATION)
    np.testing.assert_allclose(motions.position[:, 0], np.tile(HOME, (100, 1)), rtol=0, atol=1e-9)
    np.testing.assert_allclose(motions.position[:, -1], np.tile(goal, (100, 1)), rtol=0, atol=1e-9)
    np.testing.assert_allclose(motions.velocity[:, [0, -1]], 0, atol=1e-9)
    assert motions.position[:, 50].std(axis=0).min() > 0.01  # the way between is still free

    again = conditioned.condition_on(start_and_goal(goal))
    np.testing.assert_allclose(again.mean, conditioned.mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(again.covariance, conditioned.covariance, rtol=0, atol=1e-9)


def test_exact_ends_fix_the_start_and_a_wrong_one_is_refused(demonstrations):
    learned = ProMP.fit(*demonstrations, duration=DURATION, exact_ends=True)
    same = learned.condition(0, HOME, REST, duration=DURATION)
    np.testing.assert_allclose(same.mean, learned.mean, rtol=0, atol=1e-9)
    np.testing.assert_allclose(same.covariance, learned.covariance, rtol=0, atol=1e-9)
    wrong = HOME + np.eye(7)[2] * 0.01
    with pytest.raises(
        ConditioningError, match="position of DoF 2 at phase 0 cannot be met.*residual of 0.01"
    ):
        learned.condition(0, wrong)
    near = learned.condition(0, wrong, accuracy=0.01)
    np.testing.assert_allclose(near.position(0), HOME, rtol=0, atol=1e-6)
    with_noise = ProMP.fit(*demonstrations, duration=DURATION, exact_ends=True, weight_noise=1e-3)
    np.testing.assert_allclose(with_noise.condition(0, wrong).position(0), wrong, rtol=0, atol=1e-9)


@given(st.integers(0, 2**32 - 1), st.floats(0, 1), st.booleans(), st.booleans())
@settings(deadline=None)
def test_via_point_is_met_at_any_phase(seed, phase, with_position, with_velocity):
    rng = np.random.default_rng(seed)
    prior = random_promp(seed)
    position = rng.standard_normal(3) if with_position or not with_velocity else None
    velocity = rng.standard_normal(3) if with_velocity else None
    conditioned = prior.condition(phase, position, velocity, duration=2.5)
    mean, covariance = conditioned.state(phase, 2.5)
    for rows, wanted in ((slice(0, 3), position), (slice(3, 6), velocity)):
        if wanted is not None:
            np.testing.assert_allclose(mean[rows], wanted, rtol=0, atol=1e-9)
            np.testing.assert_allclose(covariance[rows, rows], 0, atol=1e-12)


@given(st.integers(0, 2**32 - 1), st.floats(0, 1), st.floats(1e-4, 1))
@settings(deadline=None)
def test_accuracy_bounds_what_remains(seed, phase, accuracy):
    """Posterior variance is the harmonic combination of prior variance and accuracy, for one DoF."""
    prior = random_promp(seed)
    variance = prior.state(phase, 1.0)[1][1, 1]
    before = prior.position(phase)[1]
    conditioned = prior.condition(phase, [before + 1.0], accuracy=accuracy, dofs=[1])
    expected = 1 / (1 / variance + 1 / accuracy**2)
    assert conditioned.state(phase, 1.0)[1][1, 1] == pytest.approx(expected, rel=1e-5, abs=1e-12)
    moved = conditioned.position(phase)[1] - before
    assert moved == pytest.approx(variance / (variance + accuracy**2), rel=1e-6)


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=30)
def test_one_update_equals_two_in_any_order_and_variance_shrinks(seed):
    rng = np.random.default_rng(seed)
    prior = random_promp(seed)
    points = [
        ViaPoint(0.1, rng.standard_normal(3), rng.standard_normal(3), 2.0),
        ViaPoint(0.7, rng.standard_normal(2), accuracy=0.1, dofs=[2, 0]),
        ViaPoint(
            1.0, rng.standard_normal(3), rng.standard_normal(3), 2.0, accuracy=1e-3, velocity_accuracy=0.3
        ),
    ]
    together = prior.condition_on(points)
    for order in ([0, 1, 2], [2, 1, 0], [1, 2, 0]):
        step = prior
        for index in order:
            before = step
            step = step.condition_on([points[index]])
            assert np.linalg.eigvalsh(before.covariance - step.covariance).min() > -1e-9
        scale = np.abs(together.mean).max()
        np.testing.assert_allclose(step.mean, together.mean, rtol=0, atol=1e-6 * scale)
        np.testing.assert_allclose(step.covariance, together.covariance, rtol=0, atol=1e-7)


def test_values_go_to_the_dofs_named():
    prior = random_promp(6)
    met = prior.condition(0.3, [0.5, -0.7], [0.1, 0.2], duration=2.0, dofs=[2, 0])
    np.testing.assert_allclose(met.position(0.3)[[2, 0]], [0.5, -0.7], atol=1e-12)
    np.testing.assert_allclose(met.velocity(0.3, 2.0)[[2, 0]], [0.1, 0.2], atol=1e-12)
    assert met.state(0.3, 2.0)[1][1, 1] > 1e-3  # the other DoF is still free


def test_covariance_of_a_via_point_couples_position_and_velocity():
    prior = random_promp(1, n_dof=2)
    joint = np.array([[0.04, 0.01], [0.01, 0.09]])
    arguments = {"position": [0.5], "velocity": [0.2], "duration": 2.0, "dofs": [1]}
    diagonal = prior.condition(0.4, covariance=np.diag([0.04, 0.09]), **arguments)
    by_accuracy = prior.condition(0.4, accuracy=0.2, velocity_accuracy=0.3, **arguments)
    np.testing.assert_allclose(diagonal.mean, by_accuracy.mean, atol=1e-12)
    coupled = prior.condition(0.4, covariance=joint, **arguments)
    own = prior.state(0.4, 2.0)[1][np.ix_([1, 3], [1, 3])]
    expected = np.linalg.inv(np.linalg.inv(own) + np.linalg.inv(joint))
    np.testing.assert_allclose(coupled.state(0.4, 2.0)[1][np.ix_([1, 3], [1, 3])], expected, atol=1e-9)


@pytest.mark.parametrize("rank", [None, 4, 1])
def test_sample_moments(rank):
    prior = random_promp(2, n_dof=2, rank=rank)
    count = 40_000
    samples = prior.sample(np.random.default_rng(3), count).reshape(count, 20)
    variance = np.diag(prior.covariance)
    # The mean's standard error, and that of a Gaussian's sample covariance; 5 sigma over at most 400 entries
    # is passed by chance once in 4000 seeds, and the seed is fixed.
    assert (np.abs(samples.mean(axis=0) - prior.mean.ravel()) <= 5 * np.sqrt(variance / count)).all()
    error = np.cov(samples.T, bias=True) - prior.covariance
    deviation = np.sqrt((np.outer(variance, variance) + prior.covariance**2) / count)
    assert (np.abs(error) <= 5 * deviation).all()
    assert np.isfinite(prior.log_likelihood(samples.reshape(count, 2, 10))).all()  # all on the support


def test_log_likelihood_of_demonstrations_and_off_support(demonstrations):
    positions, velocities = demonstrations
    arguments = {"duration": DURATION, "exact_ends": True}
    learned = ProMP.fit(positions, velocities, **arguments)
    weights = regress_weights(positions, velocities, basis=learned.basis, **arguments)
    values = learned.log_likelihood(weights)
    assert values.shape == (540,) and np.isfinite(values).all()
    rank = learned.factor.deviations.size
    # By eq. 17 the squared Mahalanobis distances of the data average to the rank.
    expected = -0.5 * rank * (1 + np.log(2 * np.pi)) - np.log(learned.factor.deviations).sum()
    assert values.mean() == pytest.approx(expected, rel=1e-9)
    assert learned.log_likelihood(weights[0] + 0.01) == -np.inf


def test_trajectories_and_state_against_loops_and_finite_differences():
    prior = random_promp(4, n_dof=2)
    weights = prior.sample(np.random.default_rng(5), 3)
    phase = np.linspace(0.01, 0.99, 9)
    motions = prior.trajectories(weights, phase, 4.0)
    assert motions.position.shape == motions.velocity.shape == motions.acceleration.shape == (3, 9, 2)
    for sample in range(3):
        for dof in range(2):
            expected = prior.basis.value(phase) @ weights[sample, dof]
            np.testing.assert_allclose(motions.position[sample, :, dof], expected, atol=1e-12)
    step = 1e-5  # s
    ahead = prior.trajectories(weights, phase + step / 4.0, 4.0)
    behind = prior.trajectories(weights, phase - step / 4.0, 4.0)
    np.testing.assert_allclose((ahead.position - behind.position) / (2 * step), motions.velocity, atol=1e-7)
    np.testing.assert_allclose(
        (ahead.velocity - behind.velocity) / (2 * step), motions.acceleration, atol=1e-6
    )

    mean, covariance = prior.state(phase, 4.0)
    np.testing.assert_allclose(
        mean, np.hstack([prior.position(phase), prior.velocity(phase, 4.0)]), atol=1e-12
    )
    for index, z in enumerate(phase):
        rows = np.vstack(
            [np.kron(np.eye(2), prior.basis.value(z)), np.kron(np.eye(2), prior.basis.derivative(z) / 4.0)]
        )
        np.testing.assert_allclose(covariance[index], rows @ prior.covariance @ rows.T, atol=1e-10)
    assert prior.position(0.5).shape == (2,)
    assert prior.state(0.5, 4.0)[1].shape == (4, 4)


@given(st.integers(0, 2**32 - 1), st.floats(0, 1), st.floats(1e-3, 1))
@settings(deadline=None, max_examples=30)
def test_agreement_with_movement_primitives(seed, phase, accuracy):
    """Both libraries on one prior and, by handing it our basis, on one set of features."""
    prior = random_promp(seed)
    reference = ReferenceProMP(n_dims=3, n_weights_per_dim=10)
    reference.from_weight_distribution(prior.mean.ravel(), prior.covariance)
    reference._rbfs_1d_point = lambda t, t_max=1.0, overlap=0.7: prior.basis.value(t / t_max)
    target = np.random.default_rng(seed).standard_normal(3)
    expected = reference.condition_position(target, accuracy**2 * np.eye(3), t=phase)
    got = prior.condition(phase, target, accuracy=accuracy)
    np.testing.assert_allclose(got.mean.ravel(), expected.weight_mean, rtol=0, atol=1e-6)
    np.testing.assert_allclose(got.covariance, expected.weight_cov, rtol=0, atol=1e-8)


def test_is_immutable_and_keeps_its_own_copy():
    mean, covariance = np.zeros(20), np.eye(20)
    made = ProMP(mean, covariance)
    mean[0] = covariance[0, 0] = 5.0
    assert made.mean.shape == (2, 10) and made.n_dof == 2
    assert made.mean[0, 0] == 0.0 and made.covariance[0, 0] == 1.0
    for copy in (made, pickle.loads(pickle.dumps(made))):
        with pytest.raises(ValueError, match="read-only"):
            copy.mean[0, 0] = 1.0
        with pytest.raises(dataclasses.FrozenInstanceError):
            copy.mean = mean  # pyright: ignore[reportAttributeAccessIssue]
        np.testing.assert_array_equal(
            copy.sample(np.random.default_rng(0), 2), made.sample(np.random.default_rng(0), 2)
        )


def test_one_demonstration_is_a_point():
    weights = np.random.default_rng(0).standard_normal((1, 2, 10))
    made = ProMP.fit_weights(weights)
    np.testing.assert_array_equal(made.sample(np.random.default_rng(0), 3), np.repeat(weights, 3, axis=0))
    assert made.log_likelihood(weights[0]) == 0.0


def test_bad_input_is_named():
    made = random_promp(0)
    rng = np.random.default_rng(0)
    good = np.zeros(3)
    cases = [
        (lambda: ProMP(np.zeros((3, 9)), np.eye(27)), r"mean: expected shape \(any, 10\), got \(3, 9\)"),
        (lambda: ProMP(np.zeros(25), np.eye(25)), "mean: expected shape"),
        (lambda: ProMP(np.zeros(0), np.eye(0)), "at least one DoF"),
        (lambda: ProMP(np.zeros(20), np.eye(10)), r"covariance: expected shape \(20, 20\)"),
        (lambda: ProMP(np.zeros(20), -np.eye(20)), "no negative eigenvalue"),
        (lambda: ProMP(np.full(20, np.nan), np.eye(20)), "mean: expected finite"),
        (lambda: ProMP.fit_weights(np.zeros((0, 3, 10))), "at least one demonstration"),
        (lambda: ProMP.fit_weights(np.zeros((2, 3, 10)), weight_noise=-1.0), "weight_noise"),
        (lambda: made.condition(0.5), "got neither"),
        (lambda: made.condition_on([]), "at least one, got none"),
        (lambda: made.condition(1.5, good), "phase"),
        (lambda: made.condition(0.5, good[:2]), r"position: expected shape \(3,\), got \(2,\)"),
        (lambda: made.condition(0.5, good * np.nan), "position: expected finite"),
        (lambda: made.condition(0.5, velocity=good), "duration: expected the seconds"),
        (lambda: made.condition(0.5, velocity=good, duration=0.0), "duration: expected a number above 0"),
        (lambda: made.condition(0.5, good, accuracy=-1.0), "accuracy"),
        (lambda: made.condition(0.5, good, accuracy=np.nan), "accuracy: expected finite"),
        (lambda: made.condition(0.5, good, accuracy=[1.0, 2.0]), "accuracy"),
        (lambda: made.condition(0.5, good, accuracy=1.0, covariance=np.eye(3)), "either accuracies or"),
        (lambda: made.condition(0.5, good, covariance=np.eye(2)), r"covariance: expected shape \(3, 3\)"),
        (lambda: made.condition(0.5, good, dofs=[0, 1, 3]), "dofs: expected different integers from 0 to 2"),
        (lambda: made.condition(0.5, good, dofs=[0, 1, 1]), "dofs"),
        (lambda: made.condition(0.5, [0.0], dofs=[0.5]), "dofs"),  # pyright: ignore[reportArgumentType]
        (lambda: made.sample(rng, -1), "n: expected"),
        (lambda: made.trajectories(np.zeros((2, 3, 9)), PHASE, 1.0), "weights: expected shape"),
        (lambda: made.trajectories(made.mean, 0.5, 1.0), "phase: expected shape"),
        (lambda: made.log_likelihood(np.full((3, 10), np.inf)), "weights: expected finite"),
        (lambda: made.velocity(0.5, -1.0), "duration"),
    ]
    for call, message in cases:
        with pytest.raises(PrompError, match=message):
            call()
