"""Conditioning a ProMP on nonlinear functions of its weights, and on poses in task space."""

import numpy as np
import pytest
from scipy.optimize import minimize

from agents.planners.single_arm.weights.task_space import PoseTarget
from agents.planners.single_arm.weights.weight_space import WeightSpace
from promp import ConditioningError, GaussianBasis, ProMP, PrompError, ViaPoint
from promp.nonlinear import NonlinearTarget, condition_nonlinear
from space_envs.dynamics import roll_out_base
from space_envs.dynamics.rotations import Array, exponential, rotate, to_matrix
from space_envs.errors import ConfigurationError
from space_envs.tasks.single_arm import SingleArmTask

BASIS = GaussianBasis()
END = BASIS.value(1.0)


def promp_of(seed: int, n: int = 3, rank: int | None = None, scale: float = 0.3) -> ProMP:
    rng = np.random.default_rng(seed)
    size = n * BASIS.size
    directions = scale * rng.standard_normal((size, rank or size)) / np.sqrt(rank or size)
    return ProMP(0.5 * rng.standard_normal((n, BASIS.size)), directions @ directions.T)


class Tip:
    """Where the end of a planar three-link arm is at the end of the motion, from a place."""

    def __init__(self, place: Array) -> None:
        self.place = place

    def __call__(self, weights: Array) -> tuple[Array, Array]:
        angle = np.cumsum(weights @ END, axis=1)  # (S, 3)
        missed = np.stack([np.cos(angle).sum(axis=1), np.sin(angle).sum(axis=1)], axis=1) - self.place
        by_angle = np.stack([-np.sin(angle), np.cos(angle)], axis=1)  # (S, 2, 3)
        by_joint = by_angle[..., ::-1].cumsum(axis=2)[..., ::-1]
        return missed, (by_joint[..., None] * END).reshape(len(weights), 2, -1)


def tip_target(promp: ProMP, shift: tuple[float, float] = (0.2, -0.3), accuracy: float = 0.0):
    return NonlinearTarget(Tip(Tip(np.zeros(2))(promp.mean[None])[0][0] + shift), accuracy)


@pytest.mark.parametrize("accuracy", [0.0, 0.05])
@pytest.mark.parametrize("rank", [None, 11])
def test_linear_function_gives_linear_conditioning(accuracy: float, rank: int | None) -> None:
    promp, goal = promp_of(1, rank=rank), np.array([0.3, -0.2, 0.1])
    features = np.kron(np.eye(3), END)

    def function(weights: Array) -> tuple[Array, Array]:
        missed = weights.reshape(len(weights), -1) @ features.T - goal
        return missed, np.broadcast_to(features, (len(weights), *features.shape))

    found = condition_nonlinear(promp, NonlinearTarget(function, accuracy)).promp
    expected = promp.condition_on([ViaPoint(1.0, goal, accuracy=accuracy)])
    np.testing.assert_allclose(found.mean, expected.mean, atol=1e-8)
    np.testing.assert_allclose(found.covariance, expected.covariance, atol=1e-9)


@pytest.mark.parametrize("rank", [None, 9])
def test_mean_is_the_most_likely_motion_that_meets_the_target(rank: int | None) -> None:
    promp = promp_of(2, rank=rank)
    target = tip_target(promp)
    found = condition_nonlinear(promp, target)
    assert np.abs(target.function(found.promp.mean[None])[0]).max() < 1e-9
    directions = promp.factor.directions
    mean = promp.mean.ravel()

    def missed(latent: Array) -> Array:
        return target.function((mean + directions @ latent).reshape(1, 3, -1))[0][0]

    other = minimize(
        lambda z: 0.5 * z @ z,
        1e-3 * np.ones(directions.shape[1]),
        jac=lambda z: z,
        constraints={"type": "eq", "fun": missed},
        options={"ftol": 1e-14, "maxiter": 300},
    )
    np.testing.assert_allclose(found.promp.mean.ravel(), mean + directions @ other.x, atol=1e-4)
    # It stays where the prior lives.
    off = found.promp.mean.ravel() - mean
    axes = promp.factor.axes
    assert np.linalg.norm(off - axes @ (axes.T @ off)) < 1e-9


def test_accuracy_weighs_the_target_against_the_prior() -> None:
    promp = promp_of(3)
    target = tip_target(promp, accuracy=0.1)
    found = condition_nonlinear(promp, target).promp
    precision, mean = np.linalg.inv(promp.covariance), promp.mean.ravel()

    def total(flat: Array) -> float:
        missed = target.function(flat.reshape(1, 3, -1))[0][0] / 0.1
        return float((flat - mean) @ precision @ (flat - mean) + missed @ missed)

    best, at = total(found.mean.ravel()), found.mean.ravel()
    assert 0.0 < best < total(mean)
    for step in np.random.default_rng(0).standard_normal((20, at.size)):
        assert total(at + 1e-3 * step / np.linalg.norm(step)) > best


def test_covariance_is_that_of_what_the_target_leaves_free() -> None:
    promp = promp_of(4)
    target = tip_target(promp)
    found = condition_nonlinear(promp, target).promp
    slope = target.function(found.mean[None])[1][0]
    assert np.abs(slope @ found.factor.directions).max() < 1e-8
    assert found.factor.deviations.size == promp.factor.deviations.size - 2


def test_projected_samples_meet_the_target_and_earlier_via_points() -> None:
    start = ViaPoint(0.0, np.zeros(3), np.zeros(3), duration=5.0)
    promp = promp_of(6, scale=0.8).condition_on([start])
    target = tip_target(promp)
    found = condition_nonlinear(promp, target)
    raw = found.promp.sample(np.random.default_rng(0), 50)
    assert np.abs(target.function(raw)[0]).max() > 1e-2
    samples, met = found.project(raw)
    assert met.all()
    assert np.abs(target.function(samples)[0]).max() <= 1e-6
    assert np.abs(samples @ BASIS.value(0.0)).max() < 1e-9
    assert np.abs(samples @ BASIS.derivative(0.0)).max() < 1e-8
    alone, _ = found.project(raw[7:8])
    np.testing.assert_allclose(alone[0], samples[7], atol=1e-12)
    assert found.project(raw[:0])[0].shape == (0, 3, 10)
    # A target with an accuracy is left alone.
    noisy = condition_nonlinear(promp, tip_target(promp, accuracy=0.1))
    np.testing.assert_array_equal(noisy.project(raw)[0], raw)


def test_targets_out_of_reach_are_refused_with_the_residual() -> None:
    promp = promp_of(6)
    with pytest.raises(ConditioningError) as caught:
        condition_nonlinear(promp, NonlinearTarget(Tip(np.array([4.0, 0.0]))))
    assert np.abs(caught.value.residual).max() > 0.9
    fixed = promp.condition_on([ViaPoint(1.0, np.zeros(3))])
    with pytest.raises(ConditioningError, match="the residual is"):
        condition_nonlinear(fixed, tip_target(promp))


@pytest.mark.parametrize(
    ("target", "message"),
    [
        (NonlinearTarget(lambda w: (np.zeros(2), np.zeros((1, 2, 30)))), "function"),
        (NonlinearTarget(lambda w: (np.zeros((1, 2)), np.zeros((1, 2, 5)))), "function"),
        (NonlinearTarget(Tip(np.zeros(2)), np.ones(3)), "accuracy"),
        (NonlinearTarget(Tip(np.zeros(2)), -1.0), "accuracy"),
        ([], "at least one"),
    ],
)
def test_bad_targets_are_refused(target, message: str) -> None:
    with pytest.raises(PrompError, match=message):
        condition_nonlinear(promp_of(7), target)


# In task space


def arm_weights(seed: int, count: int = 1) -> Array:
    """Weights (count, 7, 10) of motions that begin at home at rest."""
    robot, rng = SingleArmTask().mechanics, np.random.default_rng(seed)
    space = WeightSpace(
        robot, BASIS, robot.home, np.zeros(7), 10.0, np.zeros(3), np.eye(3), 1.0, end_rate=np.zeros(7)
    )
    return space.weights(0.15 * rng.standard_normal((count, 7, space.free)))


def pose_target(phase: float, seed: int = 0) -> PoseTarget:
    rng = np.random.default_rng(seed)
    turns = to_matrix(exponential(0.4 * rng.normal(size=(2, 3))))
    return PoseTarget(
        SingleArmTask().mechanics, BASIS, 10.0, rng.normal(size=3), turns[0], turns[1], phase=phase
    )


@pytest.mark.parametrize("phase", [0.37, 1.0])
def test_pose_is_that_of_an_independent_roll_out(phase: float) -> None:
    robot = SingleArmTask().mechanics
    weights = arm_weights(1)[0]
    z = np.linspace(0.0, phase, 801)
    q, qdot = BASIS.value(z) @ weights.T, BASIS.derivative(z) @ weights.T / 10.0
    place, turn = roll_out_base(robot, q, qdot, 10.0 * phase / 800)
    local, rotation = robot.end_effector_pose(q[-1])
    base = to_matrix(turn[-1])
    target = PoseTarget(
        robot, BASIS, 10.0, place[-1] + rotate(turn[-1], local), base @ rotation, base, phase=phase
    )
    assert np.abs(target(weights[None])[0]).max() < 1e-4  # m and rad, of twelve intervals


@pytest.mark.parametrize("phase", [0.37, 1.0])
def test_slope_agrees_with_differences(phase: float) -> None:
    target, weights = pose_target(phase), arm_weights(2, 2)
    slope = target(weights)[1]
    rng = np.random.default_rng(3)
    for _ in range(6):
        step = rng.standard_normal((7, 10))
        ahead, behind = (target(weights + h * step)[0] for h in (1e-5, -1e-5))
        np.testing.assert_allclose(slope @ step.ravel(), (ahead - behind) / 2e-5, atol=1e-5, rtol=1e-5)


def test_via_pose_and_goal_pose_are_met_together() -> None:
    robot, demonstrations = SingleArmTask().mechanics, arm_weights(4, 40)
    promp = ProMP.fit_weights(demonstrations)

    def pose(phase: float, weights: Array) -> Array:
        return PoseTarget(robot, BASIS, 10.0, np.zeros(3), phase=phase)(weights)[0][0]

    other = 0.5 * (promp.mean + demonstrations[0])[None]
    targets = [
        NonlinearTarget(PoseTarget(robot, BASIS, 10.0, pose(phase, other), phase=phase))
        for phase in (0.5, 1.0)
    ]
    found = condition_nonlinear(promp, targets)
    for phase in (0.5, 1.0):
        mean = found.promp.mean[None]
        np.testing.assert_allclose(pose(phase, mean), pose(phase, other), atol=1e-8)
    samples, met = found.sample(np.random.default_rng(0), 20)
    assert met.mean() > 0.9
    start = robot.home
    np.testing.assert_allclose(samples @ BASIS.value(0.0), np.broadcast_to(start, (20, 7)), atol=1e-6)


@pytest.mark.parametrize(
    "changes", [{}, {"position": np.zeros(2)}, {"position": np.zeros(3), "phase": 0.0}, {"phase": 1.2}]
)
def test_bad_poses_are_refused(changes: dict) -> None:
    changes = {"position": np.zeros(3), **changes} if "phase" in changes else changes
    with pytest.raises(ConfigurationError):
        PoseTarget(SingleArmTask().mechanics, BASIS, 10.0, **changes)
