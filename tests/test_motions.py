"""Motions as actions: limits, episodes in the simulation and at momentum level, Gymnasium's interface."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import agents.motions
from agents.motions.actions import SCALE, MotionActions
from agents.motions.making import make_motions
from agents.motions.single import MotionAction
from agents.motions.vector import MotionVectorEnv
from agents.planners.single_arm.weights.weight_space import WeightSpace
from promp import GaussianBasis
from space_envs.dynamics.rotations import to_matrix
from space_envs.errors import ConfigurationError

ENV_ID = "SpaceCapture/SingleArm-v0"
N = 24
GOALS = {"split": "train", "index": np.arange(N)}


def made(dynamics: str, motions: int = 1, n: int = N, **keywords) -> MotionVectorEnv:
    keywords = {"autoreset_mode": "disabled", **keywords}
    return make_motions(ENV_ID, n, motions=motions, dynamics=dynamics, **keywords)


@pytest.fixture(scope="module")
def pair() -> tuple[MotionVectorEnv, MotionVectorEnv]:
    return made("momentum"), made("simulation")


def reaching(env: MotionVectorEnv, observation: np.ndarray) -> np.ndarray:
    """Actions (N, n m) that lead to the goal poses, by Newton's method with least changes."""
    read = env.task.layout.read
    actions = []
    for row in observation:
        start, rotation = read(row, "joint_position"), to_matrix(read(row, "goal_quaternion"))
        motion = GaussianBasis(), start, np.zeros_like(start), env.actions.duration
        space = WeightSpace(env.task.mechanics, *motion, read(row, "goal_position"), rotation, 1.0)
        y = np.zeros((1, len(start), space.free))
        for _ in range(6):
            at = space.disturbance(y)
            slope, error = at.goal_slope[0, :6], at.goal_error[0, :6]
            y = y - (slope.T @ np.linalg.solve(slope @ slope.T, error)).reshape(y.shape)
        actions.append(y.ravel() / SCALE)
    return np.array(actions)


def played(env: MotionVectorEnv, actions: np.ndarray) -> dict:
    """Infos of episodes of one motion, with `reward` and `observation`."""
    env.reset(options=GOALS)
    observation, reward, terminated, truncated, info = env.step(actions)
    assert (terminated | truncated).all()
    return {**info, "reward": reward, "observation": observation}


def test_momentum_level_agrees_with_the_simulation_episode_by_episode(pair):
    momentum, simulation = pair
    observation, _ = momentum.reset(options=GOALS)
    rng, goal = np.random.default_rng(0), reaching(momentum, observation)
    wild = 0.3 * rng.standard_normal(goal.shape)
    for name, actions in {"reaching": goal, "near": goal + 0.01 * wild, "wild": wild}.items():
        fast, slow = played(momentum, actions), played(simulation, actions)
        assert (fast["outcome"] == slow["outcome"]).mean() >= (0.9 if name == "near" else 1.0), name
        same = (fast["outcome"] == slow["outcome"]) & (slow["outcome"] != "collision")
        error = np.abs(fast["attitude"] - slow["attitude"])[same]
        assert (error <= 0.1 + 0.05 * slow["attitude"][same]).all(), (name, error.max())
        peak = momentum.task.layout.read
        first, second = (peak(each["observation"][same], "peak_attitude") for each in (fast, slow))
        assert np.abs(first - second).max() < 0.05 * np.abs(second).max(), name
        assert np.corrcoef(fast["reward"], slow["reward"])[0, 1] > 0.99, name
        spread = np.abs(fast["reward"] - slow["reward"])[same]
        assert np.median(spread) < 0.02 * np.abs(slow["reward"]).mean(), (name, np.median(spread))
    assert (played(simulation, goal)["outcome"] == "captured").mean() > 0.9


def test_two_motions_agree_with_the_simulation():
    envs = made("momentum", 2), made("simulation", 2)
    actions = [0.1 * np.random.default_rng(part).standard_normal((N, 49)) for part in range(2)]
    ends = []
    for env in envs:
        env.reset(options=GOALS)
        total = np.zeros(N)
        for action in actions:
            observation, reward, terminated, truncated, info = env.step(action)
            total += reward
        ends.append((observation, info["outcome"], total))
    (first, outcome, total), (second, other, expected) = ends
    same = outcome == other
    assert same.mean() > 0.9 and (same & (other == "timeout")).any()
    over = same & (other == "timeout")
    read = envs[0].task.layout.read
    errors = {"joint_position": 0.02, "base_position": 0.01, "end_effector_position": 0.02}
    for field, error in errors.items():
        assert np.abs(read(first, field) - read(second, field))[over].max() < error, field
    assert np.allclose(total[over], expected[over], rtol=0.1, atol=0.5)


def test_motions_keep_the_limits_of_the_drives(pair):
    actions: MotionActions = pair[0].actions
    rng = np.random.default_rng(1)
    start = rng.uniform(actions.position[:, 0], actions.position[:, 1], (50, 7))
    motions = actions.plan(0, start, np.zeros((50, 7)), rng.uniform(-1.0, 1.0, (50, 49)))
    times = np.linspace(0.0, actions.duration, 400)
    angle, rate = motions.sample(times)
    slack = 1.02  # limits are imposed at 33 instants
    assert (np.abs(rate) <= slack * actions.rate).all()
    assert (np.abs(np.gradient(rate, times, axis=1)) <= 1.05 * actions.acceleration).all()
    assert (angle >= actions.position[:, 0] - 0.02).all() and (angle <= actions.position[:, 1] + 0.02).all()
    assert np.allclose(angle[:, 0], start) and np.allclose(rate[:, [0, -1]], 0.0, atol=1e-9)
    assert (np.ptp(angle, axis=1).max(axis=1) > 0.1).mean() > 0.5  # shortened, not stopped


@pytest.mark.parametrize("dynamics", ["momentum", "simulation"])
def test_rows_that_end_are_reset_as_gymnasium_says(dynamics):
    same, again = made(dynamics, n=3, autoreset_mode="same_step"), made(dynamics, n=3)
    first, _ = same.reset(seed=3)
    expected, _ = again.reset(seed=3)
    action = np.full((3, 49), 0.05, dtype=np.float32)
    observation, reward, terminated, truncated, info = same.step(action)
    other, *_ = again.step(action)
    assert np.array_equal(first, expected) and (terminated | truncated).all()
    assert np.array_equal(np.stack(info["final_obs"]), other)
    read = same.task.layout.read
    assert (read(observation, "time") == 0.0).all() and (read(other, "time") > 0.0).all()
    following = made(dynamics, n=3, autoreset_mode="next_step")
    following.reset(seed=3)
    following.step(action)
    restarted, reward, terminated, truncated, _ = following.step(action)
    assert (read(restarted, "time") == 0.0).all() and not (terminated | truncated).any() and not reward.any()


@pytest.mark.parametrize("dynamics", ["momentum", "simulation"])
def test_a_snapshot_continues_with_the_same_bits(dynamics):
    env, copy = (made(dynamics, 2, n=3, autoreset_mode="same_step") for _ in range(2))
    env.reset(seed=1)
    action = np.full((3, 49), -0.1)
    env.step(action)
    copy.reset(seed=2)
    copy.restore(env.snapshot())
    for _ in range(3):
        (observation, reward, *_), (other, again, *_) = env.step(action), copy.step(action)
        assert np.array_equal(observation, other) and np.array_equal(reward, again)


def test_ids_and_wrapper_are_environments():
    name = f"agents.motions:{agents.motions.NAMESPACE}/SingleArm-v0"
    env = gym.make(name, horizon=40, motions=2, disable_env_checker=True)
    with pytest.warns(UserWarning, match="different from the unwrapped version"):  # MotionAction is a wrapper
        check_env(env, skip_render_check=True)
    envs = gym.make_vec(name, num_envs=2, vectorization_mode="vector_entry_point", dynamics="momentum")
    observation, _ = envs.reset(seed=0)
    assert envs.action_space.shape == (2, 49) and observation.shape[0] == 2
    wrapped = MotionAction(gym.make(ENV_ID, horizon=40), motions=2)
    wrapped.reset(seed=0)
    _, _, terminated, truncated, _ = wrapped.step(wrapped.action_space.sample() * 0.0)
    assert not (terminated or truncated)
    assert wrapped.step(wrapped.action_space.sample() * 0.0)[3]


def test_bad_choices_are_refused():
    for words, keywords in {
        "those of DualArmSpatialTask move": {"env_id": "SpaceCapture/DualArmSpatial-v0"},
        "obstacles": {"env_id": "SpaceCapture/SingleArmCluttered-v0", "dynamics": "momentum"},
        "simulation": {"env_id": ENV_ID, "dynamics": "simulations"},
        "last of 4": {"env_id": ENV_ID, "motions": 4, "duration": 10.0},
        "too short": {"env_id": ENV_ID, "motions": 2, "duration": 11.0, "dynamics": "momentum"},
        "at most 20 s, the episode": {"env_id": ENV_ID, "duration": 30.0},
        "joint_velocity": {"env_id": ENV_ID, "control_mode": "reactionless"},
    }.items():
        with pytest.raises(ConfigurationError, match=words):
            make_motions(**keywords)
