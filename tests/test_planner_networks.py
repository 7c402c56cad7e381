"""Networks that plan: batched motions and paths, their steps, training, policies."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch as th
from training_runs import ENV_ID, begin, history, interrupt, run, same

from agents.learning.planners.self_labelled import Fitting, Labels, SelfLabelled
from agents.planners.common.plans import Cause, Limits
from agents.planners.single_arm.amortised.motions import MotionBatch, Problems
from agents.planners.single_arm.amortised.path_steps import PathLoss
from agents.planners.single_arm.amortised.paths import PathBatch
from agents.planners.single_arm.amortised.planner import BASIS, NetworkPlanner
from agents.planners.single_arm.amortised.steps import MotionLoss, Penalties
from agents.planners.single_arm.reactionless.goals import PoseRows
from agents.planners.single_arm.reactionless.paths import PathSpace
from agents.planners.single_arm.weights.weight_space import WeightSpace
from agents.policies.learned.planner_network import PlannerNetwork, PlanningNetwork, remainder
from agents.policies.learned.policy_file import load_policy_file
from agents.policies.learned.reactionless_network import ReactionlessNetwork
from agents.policies.learned.trained import load_trained
from space_envs.dynamics import roll_out_base
from space_envs.dynamics.rotations import angle_between, from_matrix, multiply, rotate, to_matrix
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, PolicyError
from space_envs.evaluation.play.steps import steps
from space_envs.policy import PolicyContext
from space_envs.registration import make_task

TASK: Any = make_task(ENV_ID, {})
ROBOT = TASK.mechanics
LIMITS = Limits(position=TASK.robot.joint_range, rate=0.12, acceleration=0.05)
TIGHT = Penalties(limits=3.0, shares=(0.5, 0.9, 0.9))


def problems(count: int, moving: bool = True) -> Problems:
    """Problems of the first train goals, from home, with their own durations, and rates if moving."""
    goals, rng = TASK.goals("train", np.arange(count)), np.random.default_rng(0)
    rate = 0.02 * rng.standard_normal((count, 7)) * moving
    duration = rng.uniform(15.0, 19.0, count)
    return Problems.of(np.tile(ROBOT.home, (count, 1)), rate, duration, goals.position, goals.quaternion)


def coordinates(count: int, scale: float = 0.1) -> np.ndarray:
    return scale * np.random.default_rng(1).standard_normal((count, 7, 7))


def along(function: Any, x: np.ndarray, direction: np.ndarray, step: float = 1e-6) -> np.ndarray:
    """Central difference of a function of arrays along a direction."""
    return (function(x + step * direction) - function(x - step * direction)) / (2.0 * step)


def test_motions_of_many_problems_are_those_of_one_and_of_the_roll_out() -> None:
    given, y = problems(9), coordinates(9)
    batch = MotionBatch(ROBOT, BASIS, given, c=1.3)
    at = batch.linearised(y)
    cost, error = batch.effect(y)
    np.testing.assert_allclose((at.residual**2).sum(axis=1), cost, rtol=1e-12)
    np.testing.assert_allclose(at.error, error, atol=1e-14)
    row = 4
    goal = TASK.goals("train", np.arange(9))
    one = WeightSpace(
        ROBOT,
        BASIS,
        given.start[row],
        given.rate[row],
        given.duration[row],
        goal.position[row],
        to_matrix(goal.quaternion[row]),
        c=1.3,
    )
    wanted = one.disturbance(y[row : row + 1])
    np.testing.assert_allclose(cost[row], wanted.cost[0], rtol=5e-3)
    np.testing.assert_allclose(error[row], wanted.goal_error[0], atol=5e-4)
    # Independent of both: a fine roll-out of the base in numpy.
    times = np.linspace(0.0, 1.0, 2001)
    weights = batch.weights(y)[row]
    q = BASIS.value(times) @ weights.T
    qdot = BASIS.derivative(times) @ weights.T / given.duration[row]
    np.testing.assert_allclose(qdot[0], given.rate[row], atol=1e-12)
    np.testing.assert_allclose(qdot[-1], 0.0, atol=1e-12)
    position, quaternion = roll_out_base(ROBOT, q, qdot, given.duration[row] * times[1])
    local, axes = ROBOT.end_effector_pose(q[-1])
    reached = position[-1] + rotate(quaternion[-1], local)
    np.testing.assert_allclose(reached - goal.position[row], error[row, :3], atol=5e-4)
    rotation = angle_between(multiply(quaternion[-1], from_matrix(axes)), goal.quaternion[row])
    assert rotation == pytest.approx(np.linalg.norm(error[row, 3:6]), abs=5e-4)
    attitude = angle_between(quaternion[-1], np.array([1.0, 0.0, 0.0, 0.0]))
    assert attitude == pytest.approx(np.linalg.norm(error[row, 6:]), abs=5e-4)


def test_derivatives_and_steps_of_motions_against_differences() -> None:
    y, direction = coordinates(6), np.random.default_rng(2).standard_normal((6, 7, 7))
    batch = MotionBatch(ROBOT, BASIS, problems(6), c=1.0)
    at = batch.linearised(y)
    flat = direction.reshape(6, -1, 1)
    np.testing.assert_allclose(
        (at.error_by @ flat)[..., 0], along(lambda x: batch.effect(x)[1], y, direction), atol=1e-7
    )
    objective = MotionLoss(LIMITS, 7, TIGHT)
    assert (objective.violation(batch, y) > 1.0).any()
    # With a large damping a step is half the negative gradient divided by the damping.
    step = objective.step(batch, y, at, 1e9)
    slope = along(lambda x: objective.value(batch, x), y, direction)
    np.testing.assert_allclose(-2e9 * (step * direction).sum(axis=(1, 2)), slope, rtol=1e-5, atol=1e-6)
    assert (np.abs(slope) > 1e-2).all()


def test_corrections_reach_goals_within_limits() -> None:
    batch = MotionBatch(ROBOT, BASIS, problems(16, moving=False), c=1.0)
    objective = MotionLoss(Limits(rate=0.3, acceleration=0.25), 7, TIGHT)
    y = coordinates(16, 0.03)
    for _ in range(25):
        step = objective.step(batch, y, batch.linearised(y), 3e-3)
        length = np.sqrt((step**2).sum(axis=(1, 2), keepdims=True))
        y = y + step * np.minimum(1.0, 1.0 / length)
    before = np.abs(batch.effect(y)[1]).max(axis=1)
    near = before < 0.02
    assert near.mean() > 0.7
    for _ in range(3):
        y = y + objective.correction(batch, y, batch.linearised(y), 1e-2)
    assert np.abs(batch.effect(y)[1]).max(axis=1)[near].max() < 2e-4
    assert (objective.violation(batch, y)[near] < 1.1).all()


def test_paths_of_many_problems_are_those_of_one() -> None:
    given, rng = problems(5, moving=False), np.random.default_rng(3)
    weights = (rng.standard_normal((5, 10, 7)) / np.arange(1, 11)[:, None]).reshape(5, -1)
    batch, row = PathBatch(ROBOT, given), 2
    at = batch.linearised(weights)
    goal = TASK.goals("train", np.arange(5))
    rows = PoseRows(ROBOT, goal.position[row], to_matrix(goal.quaternion[row]))
    space = PathSpace(ROBOT, ROBOT.home, rows)
    path = space.rollout(weights[row].reshape(10, 7).T).path
    t = given.duration[row]
    for kind, values in enumerate((path.angle, path.slope / t, path.curve / t**2)):
        np.testing.assert_allclose(at.motion[kind, row], values, atol=1e-12)
    np.testing.assert_allclose(at.error[row], path.miss, atol=1e-12)
    direction = rng.standard_normal(weights.shape)
    for name in ("motion", "residual", "error"):
        by = getattr(at, {"residual": "by"}.get(name, f"{name}_by"))
        change = (by @ direction.reshape(5, *[1] * (name == "motion"), -1, 1))[..., 0]
        wanted = along(lambda x, name=name: getattr(batch.linearised(x), name), weights, direction)
        np.testing.assert_allclose(change, wanted, atol=1e-7)
    loss = PathLoss(LIMITS, 7, TIGHT)
    step = loss.step(at, weights, 1e9)
    slope = along(lambda x: loss.value(batch.linearised(x), x), weights, direction)
    np.testing.assert_allclose(-2e9 * (step * direction).sum(axis=1), slope, rtol=1e-4, atol=1e-5)


def test_remainder_of_a_motion_is_the_same_motion() -> None:
    weights = np.random.default_rng(4).standard_normal((3, 7, BASIS.size))
    phase, times = np.array([0.0, 0.3, 0.9]), np.linspace(0.0, 1.0, 11)
    later = remainder(weights, phase)
    for row in range(3):
        wanted = BASIS.value(phase[row] + (1.0 - phase[row]) * times) @ weights[row].T
        np.testing.assert_allclose(BASIS.value(times) @ later[row].T, wanted, atol=1e-11)


# Training ---------------------------------------------------------------------------------------------


class Toy:
    """Labels a step of half the way to a smooth function of the features."""

    longest_step = 10.0

    def __init__(self) -> None:
        self.features = np.random.default_rng(5).uniform(-1.0, 1.0, (256, 3)).astype(np.float32)
        self.wanted = np.stack([np.sin(2.0 * self.features[:, 0]), self.features[:, 1:].prod(axis=1)], axis=1)

    def __call__(self, rows: np.ndarray, output: np.ndarray) -> Labels:
        """As in `Labeller`."""
        return Labels(0.5 * (output + self.wanted[rows]), np.tile(3.0 * np.eye(2), (len(rows), 1, 1)))


def toy(rounds: int = 300) -> SelfLabelled:
    th.manual_seed(0)
    network = th.nn.Sequential(th.nn.Linear(3, 24), th.nn.SiLU(), th.nn.Linear(24, 2))
    return SelfLabelled(network, Toy(), Fitting(64, rounds, 64, 4, 256, 1e-2, 0.95), seed=1)


def test_a_network_learns_from_its_own_improved_outputs_and_resumes_to_the_bit() -> None:
    whole, first = toy(), toy()
    for _ in range(300):
        whole.round()
    labels = Toy()
    with th.no_grad():
        error = whole.average(th.from_numpy(labels.features)).numpy() - labels.wanted
    assert np.sqrt((error**2).mean()) < 0.03
    for _ in range(100):
        first.round()
    resumed = toy()
    resumed.restore(first.state())
    for _ in range(200):
        resumed.round()
    for a, b in zip(whole.average.parameters(), resumed.average.parameters(), strict=True):
        assert th.equal(a, b)


def test_interrupted_training_of_a_planner_ends_with_the_same_bits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole, stopped = (begin(tmp_path / name, "planner") for name in ("whole", "stopped"))
    summary = run(whole)
    assert interrupt(stopped, monkeypatch)["steps"] == 2 * 64
    run(stopped)
    assert history(stopped) == history(whole)
    a, b = (load_policy_file(folder.policy) for folder in (whole, stopped))
    assert same(a.network.weights, b.network.weights) and same(a.network.biases, b.network.biases)
    assert summary["validation"]["episodes"] == 4
    _check_policies(whole.policy)


def _check_policies(path: Path) -> None:
    """A network that has hardly learned: typed failures, an arm at rest, and refused options."""
    file = load_policy_file(path)
    assert file.plans == ("kept", 18.5) and file.knowledge == "learned with model"
    env = CaptureVectorEnv(ENV_ID, 3)
    context = PolicyContext.from_env(env)
    observation, _ = env.reset(seed=0, options={"split": "test", "index": np.arange(3)})
    policy = load_trained(path, context)
    assert isinstance(policy, PlanningNetwork)
    action, state = PlanningNetwork(context, 0, file, corrections=0).predict(observation)
    assert all(failure.cause in (Cause.INACCURATE, Cause.INFEASIBLE) for failure in state.failures)
    np.testing.assert_array_equal(action, 0.0)
    with pytest.raises(ConfigurationError):
        PlanningNetwork(context, 0, file, corrections=-1)
    with pytest.raises(ConfigurationError):
        PlanningNetwork(context, 0, file, replan=(0.0,))
    with pytest.raises(PolicyError, match="no paths in the reaction null space"):
        ReactionlessNetwork(context, 0, file)


def test_a_planner_is_for_static_poses_of_one_arm(tmp_path: Path) -> None:
    from agents.learning.runs.settings import settle

    for given in ({"env": "SpaceCapture/DualArmPlanar-v0"}, {"env_kwargs": {"goal": "axis"}}):
        with pytest.raises(ConfigurationError, match="planner does not fit"):
            settle({"algo": "planner", **given})
    with pytest.raises(ConfigurationError, match="unknown kind of plans 'kep'"):
        settle({"algo": "planner", "kind": "kep"})
    assert settle({"algo": "planner", "kind": "reactionless"}).parameters.num_envs == 256


def test_planner_solves_what_a_network_would() -> None:
    planner = NetworkPlanner(ROBOT, Limits(rate=0.3, acceleration=0.25), 1.0, corrections=0)
    given = problems(4, moving=False)
    found = planner.plan(planner.batch(given), np.zeros((4, 7, 7)))
    assert all(failure.cause is Cause.INACCURATE for failure in found.failures)
    found = planner.plan(planner.batch(given), coordinates(4, 3.0))
    assert all(failure.residual > 0.0 for failure in found.failures)


def test_shipped_network_keeps_the_attitude_also_where_its_plans_are_corrected_on_the_way() -> None:
    n = 12
    for replan, scale in (((6.0, 12.0), 1.0), ((), 1.1)):
        env = CaptureVectorEnv(ENV_ID, n, split="test", autoreset_mode="disabled")
        observation, _ = env.reset(seed=0, options={"index": np.arange(n)})
        rows = np.arange(n)
        env.simulation.scale_base(rows, np.full(n, scale))
        env.simulation.refresh(rows)
        env.drive.reset(rows)
        policy = PlannerNetwork(PolicyContext.from_env(env), 0, replan=replan)
        found = list(steps(policy, env, observation))
        assert (found[-1].info["outcome"] == "captured").all()
        assert (found[-1].state.start > 0.0).all() == bool(replan)
        final = np.zeros(n)
        for step in found:
            final = np.where(step.running, np.rad2deg(env.task.attitude(step.observation)), final)
        assert (final < 0.1).mean() > 0.9
