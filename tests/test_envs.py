"""Every registered id in every control mode: Gymnasium's contract, and what the suite promises beyond it."""

import copy
import pickle
import warnings

import gymnasium as gym
import numpy as np
import pytest
from boundary import gym_make, gym_make_vec
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode
from hypothesis import given, settings
from hypothesis import strategies as st
from offenders import accepted, assert_none
from stable_baselines3.common.env_checker import check_env as check_env_sb3

import space_envs  # noqa: F401  (registers the ids)
from space_envs.control import CONTROL_MODES
from space_envs.dynamics.rotations import base_rotation
from space_envs.errors import ActionError, ConfigurationError, GoalError
from space_envs.registration import ENTRIES
from space_envs.wrappers import GoalConditioned

IDS = sorted(ENTRIES)
EVERY = [(env_id, mode) for env_id in IDS for mode in CONTROL_MODES]
SINGLE = "SpaceCapture/SingleArm-v0"
every_id = pytest.mark.parametrize("env_id", IDS)


def filled(env, value):
    """An action, or one for each row, all of whose entries are the same."""
    return np.full(env.action_space.shape, value)


def play(env, steps, seed, factor=1.0):
    """Observations, rewards, ends of row 0 under random actions drawn for one row and given to all."""
    rng = np.random.default_rng(seed)
    observation, _ = env.reset(seed=seed)
    seen, rewards, ends = [observation[0]], [], []
    for _ in range(steps):
        action = np.tile(rng.uniform(-1.1, 1.1, env.single_action_space.shape), (env.num_envs, 1))
        action[1:] *= factor
        observation, reward, terminated, truncated, _ = env.step(action)
        seen.append(observation[0])
        rewards.append(reward[0])
        ends.append((terminated[0], truncated[0]))
    return np.array(seen), np.array(rewards), np.array(ends)


@pytest.mark.parametrize(("env_id", "mode"), EVERY)
def test_gymnasium_and_sb3_checkers_without_a_warning(env_id, mode):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(env_id, control_mode=mode).unwrapped, skip_render_check=True)
        check_env_sb3(gym.make(env_id, control_mode=mode), warn=True)
        check_env_sb3(GoalConditioned(gym.make(env_id, control_mode=mode)), warn=True)


@pytest.mark.parametrize(("env_id", "mode"), EVERY)
def test_single_env_is_row_i_of_any_vector_env_bit_for_bit(env_id, mode):
    options = {"control_mode": mode, "horizon": 40, "autoreset_mode": "next_step"}
    one = play(gym.make_vec(env_id, num_envs=1, **options), 60, 3)
    for n in (3, 64):
        many = play(gym.make_vec(env_id, num_envs=n, **options), 60, 3, factor=0.7)
        for a, b in zip(one, many, strict=True):
            np.testing.assert_array_equal(a, b)


@every_id
def test_gym_make_gives_row_i_for_seed_plus_i(env_id):
    vector = gym.make_vec(env_id, num_envs=4)
    start, _ = vector.reset(seed=11)
    action = np.linspace(-1, 1, vector.action_space.shape[0] * vector.action_space.shape[1])
    action = action.reshape(vector.action_space.shape)
    after, reward, *_ = vector.step(action)
    for row in range(4):
        env = gym.make(env_id)
        observation, _ = env.reset(seed=11 + row)
        np.testing.assert_array_equal(observation, start[row])
        observation, single_reward, *_ = env.step(action[row])
        np.testing.assert_array_equal(observation, after[row])
        assert single_reward == reward[row]


@pytest.mark.parametrize(("env_id", "mode"), EVERY)
def test_copies_go_on_as_the_original(env_id, mode):
    env = gym.make(env_id, control_mode=mode, split="ood")
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    actions = rng.uniform(-1, 1, (30, *env.action_space.shape))
    for action in actions[:15]:
        env.step(action)
    copies = [pickle.loads(pickle.dumps(env)), copy.deepcopy(env)]
    for action in actions[15:]:
        expected = env.step(action)
        for other in copies:
            got = other.step(action)
            np.testing.assert_array_equal(got[0], expected[0])
            assert got[1:] == expected[1:]
    afterwards = env.reset()[0]
    for other in copies:
        np.testing.assert_array_equal(other.reset()[0], afterwards)


@every_id
def test_observations_are_finite_in_bounds_and_vary(env_id):
    env = gym.make_vec(env_id, num_envs=16, difficulty="hard")
    rng = np.random.default_rng(1)
    seen = [env.reset(seed=5)[0]]
    seen += [env.step(rng.uniform(-1, 1, env.action_space.shape))[0] for _ in range(40)]
    stack = np.concatenate(seen)
    assert stack.dtype == env.single_observation_space.dtype
    assert np.isfinite(stack).all()
    assert all(env.single_observation_space.contains(row) for row in stack)
    assert (np.ptp(stack, axis=0) > 0).all()


@every_id
@pytest.mark.parametrize("reward", ["dense", "sparse"])
def test_reward_is_the_sum_of_its_terms_and_attitude_is_eq_20(reward, env_id):
    env = gym.make(env_id, reward=reward, c=2.0)
    observation, _ = env.reset(seed=0)
    layout = env.unwrapped.task.layout
    rng, cost, paid = np.random.default_rng(0), 0.0, 0.0
    for _ in range(50):
        observation, got, *_, info = env.step(rng.uniform(-1, 1, env.action_space.shape))
        assert got == pytest.approx(sum(info["reward_terms"].values()), abs=1e-12)
        v, w = (layout.read(observation, f"base_{kind}_velocity") for kind in ("linear", "angular"))
        cost += 0.1 * (4.0 * w @ w + v @ v)
        paid += info["reward_terms"]["attitude"]
    assert cost > 1e-4
    assert -paid == pytest.approx(cost, rel=1e-9)


def test_derived_parts_of_the_observation_of_the_single_arm():
    env = gym.make(SINGLE)
    observation, _ = env.reset(seed=4)
    for _ in range(10):
        observation, *_ = env.step(np.full(7, 0.4))
    field = lambda name: env.unwrapped.task.layout.read(observation, name)  # noqa: E731
    np.testing.assert_allclose(
        field("position_error"), field("goal_position") - field("end_effector_position")
    )
    from scipy.spatial.transform import Rotation

    goal, tip = (
        Rotation.from_quat(field(f"{k}_quaternion"), scalar_first=True) for k in ("goal", "end_effector")
    )
    np.testing.assert_allclose(field("rotation_error"), (goal * tip.inv()).as_rotvec(), atol=1e-12)
    assert field("time")[0] == pytest.approx(1.0)


@every_id
def test_goal_conditioned_rewards_every_end_effector_at_its_goal(env_id):
    env = GoalConditioned(gym.make(env_id, position_tolerance=0.04))
    observation, _ = env.reset(seed=0)
    base, layout = env.unwrapped, env.unwrapped.task.layout
    achieved, desired = observation["achieved_goal"], observation["desired_goal"]
    tips = len(base.task.mechanics.end_effector_link)
    size = layout.read(observation["observation"], "goal_position").size
    width = size // tips
    np.testing.assert_array_equal(desired[:size], layout.read(observation["observation"], "goal_position"))
    np.testing.assert_array_equal(
        achieved[:size], layout.read(observation["observation"], "end_effector_position")
    )
    # Relabelled as hindsight does it: what was achieved was meant; then one position is too far off.
    assert env.compute_reward(achieved, achieved, {}) == 0.0
    for tip in range(tips):
        for off, reward in ((0.039, 0.0), (0.041, -1.0)):
            goal = achieved.copy()
            goal[width * tip] += off
            assert env.compute_reward(achieved, goal, {}) == reward
    # The last of the attitudes turned by more or less than the tolerance of 5 deg.
    last = achieved[size:]
    if last.size:
        width = last.size // tips
        for degrees, reward in ((4.9, 0.0), (5.1, -1.0)):
            angle = np.deg2rad(degrees)
            goal = achieved.copy()
            part = goal[-width:]
            other = np.linalg.svd(part[None])[2][1]  # a unit vector across it
            half = 0.5 * angle if width == 4 else angle
            goal[-width:] = np.cos(half) * part + np.sin(half) * other
            assert env.compute_reward(achieved, goal, {}) == reward
    together = env.compute_reward(np.stack([achieved] * 2), np.stack([achieved, desired]), {})
    np.testing.assert_array_equal(together, [0.0, -1.0])
    *_, reward, _, _, _ = env.step(filled(env, 0.0))
    assert reward == -1.0


# Resetting ------------------------------------------------------------


def test_splits_of_the_single_arm_are_disjoint_frozen_and_reachable():
    task = gym.make(SINGLE).unwrapped.task
    goals = {split: task.goals(split, np.arange(64)) for split in ("train", "validation", "test", "ood")}
    flat = np.concatenate([g.position for g in goals.values()])
    assert len(np.unique(flat.round(9), axis=0)) == len(flat)
    # Frozen: these figures must never change.
    np.testing.assert_allclose(goals["test"].position[7], FROZEN_TEST_GOAL_7, atol=1e-9)
    np.testing.assert_allclose(goals["ood"].position[0], FROZEN_OOD_GOAL_0, atol=1e-9)
    assert (goals["test"].mass_scale == 1).all()
    assert (goals["ood"].mass_scale != 1).all()
    for g in goals.values():
        task.check_goals(g.position, g.quaternion)


FROZEN_TEST_GOAL_7 = [-1.179695271733, 0.946689795115, 2.145653298168]
FROZEN_OOD_GOAL_0 = [0.402985308351, 1.279262964778, 1.302398148172]


@every_id
def test_a_goal_does_not_depend_on_who_else_asks(env_id):
    task = gym.make(env_id).unwrapped.task
    together = task.goals("test", np.arange(100, 140))
    alone = task.goals("test", np.array([123]))
    for name, value in vars(alone).items():
        np.testing.assert_array_equal(value[0], getattr(together, name)[23])


def test_reset_options_of_the_single_arm_set_goal_state_split_and_index():
    env = gym.make_vec(SINGLE, num_envs=3)
    layout = env.task.layout
    observation, info = env.reset(seed=0, options={"split": "test", "index": [5, 6, 5]})
    assert info["index"].tolist() == [5, 6, 5]
    assert info["split"].tolist() == ["test"] * 3
    goals = env.task.goals("test", np.array([5, 6, 5]))
    np.testing.assert_array_equal(layout.read(observation, "goal_position"), goals.position)
    joints = env.task.mechanics.home + 0.2
    rates = np.linspace(-0.1, 0.1, 7)
    observation, info = env.reset(
        options={
            "goal_position": goals.position[0],
            "goal_quaternion": -goals.quaternion[0],
            "joint_position": joints,
            "joint_velocity": rates,
        }
    )
    np.testing.assert_allclose(layout.read(observation, "goal_quaternion")[0], goals.quaternion[0])
    np.testing.assert_allclose(layout.read(observation, "joint_position"), np.tile(joints, (3, 1)))
    # Total momentum is zero: the base moves as the momentum-level mathematics says.
    twist = env.task.mechanics.base_twist(joints, rates)
    np.testing.assert_allclose(layout.read(observation, "base_linear_velocity")[1], twist[:3], atol=1e-12)
    np.testing.assert_allclose(layout.read(observation, "base_angular_velocity")[1], twist[3:], atol=1e-12)
    assert info["split"].tolist() == ["given"] * 3


GOAL = {"goal_position": [0, 1, 2], "goal_quaternion": [1, 0, 0, 0]}


def refused(env_id, options, error, message):
    """A reset with these options is an error and leaves everything as it was."""
    env, twin = (gym.make_vec(env_id, num_envs=1) for _ in range(2))
    env.reset(seed=0)
    twin.reset(seed=0)
    before = env.simulation.state(0)
    with pytest.raises(error, match=message):
        env.reset(seed=5, options=options)
    np.testing.assert_array_equal(env.simulation.state(0), before)
    # Nor did the generators move on to the refused seed.
    np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])


OPTIONS = [
    ({"indx": 3}, "Did you mean 'index'"),
    ([("index", 3)], "must be a dictionary"),
    ({"split": "tset"}, "Did you mean 'test'"),
    ({"split": "test", "index": 512}, "0..511"),
    ({"index": -1}, r"must be an integer in 0..\d+"),
    ({"index": 1.5}, "must be an integer"),
    ({"joint_position": 50.0}, "outside its limits"),
    ({"joint_position": "a"}, "must be numbers"),
    ({"joint_velocity": 5.0}, "outside its limits"),
    ({"joint_velocity": np.nan}, "finite"),
    ({"reset_mask": [1]}, "reset_mask must be bool"),
]


@every_id
def test_bad_reset_options_are_refused_before_anything_moves(env_id):
    n = gym.make(env_id).unwrapped.task.mechanics.n_joints
    for options, message in OPTIONS:
        if isinstance(options, dict):
            options = {k: [value] * n if k.startswith("joint") else value for k, value in options.items()}
        refused(env_id, options, ConfigurationError, message)


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"goal_position": [0, 1, 2]}, ConfigurationError, "^goal_position needs goal_quaternion too$"),
        (GOAL | {"goal_position": [0, 1]}, ConfigurationError, r"shape \(3,\)"),
        (GOAL | {"goal_position": [0, 9, 0]}, GoalError, "out of reach"),
        (GOAL | {"goal_position": [0, 0.1, 0]}, GoalError, "inside the satellite"),
        (GOAL | {"goal_quaternion": [2, 0, 0, 0]}, GoalError, "unit quaternion"),
        (GOAL | {"goal_position": [0, 1, np.nan]}, ConfigurationError, "finite"),
        (GOAL | {"index": 3}, ConfigurationError, "either a goal or a split"),
        ({"target_position": [0, 1, 2]}, ConfigurationError, "unknown reset option"),
    ],
)
def test_bad_goals_of_the_single_arm_are_refused_before_anything_moves(options, error, message):
    refused(SINGLE, options, error, message)


@every_id
def test_bad_seeds_are_refused(env_id):
    env = gym_make_vec(env_id, num_envs=1)
    for seed in (-1, 1.5, "ab", [1, 2], np.array([1.5])):
        with pytest.raises(ConfigurationError, match="seed must be"):
            env.reset(seed=seed)


@every_id
def test_a_seed_leaves_rows_outside_the_mask_alone(env_id):
    env, twin = (gym.make_vec(env_id, num_envs=2, autoreset_mode="disabled") for _ in range(2))
    env.reset(seed=0)
    twin.reset(seed=0)
    env.reset(seed=9, options={"reset_mask": np.array([True, False])})
    again, _ = env.reset()
    expected, _ = twin.reset()
    np.testing.assert_array_equal(again[1], expected[1])
    assert not np.array_equal(again[0], expected[0])
    untouched, info = env.reset(options={"reset_mask": np.array([False, False])})
    np.testing.assert_array_equal(untouched, again)
    assert not info["_index"].any()


KEYWORDS = [
    ({"difficulty": "mdium"}, "Did you mean 'medium'"),
    ({"dificulty": "easy"}, "Did you mean 'difficulty'"),
    ({"control_mode": "joint_velocty"}, "Did you mean 'joint_velocity'"),
    ({"split": "validate"}, "unknown split"),
    ({"reward": "spares"}, "Did you mean 'sparse'"),
    ({"render_mode": "rgb"}, "unknown render mode"),
    ({"timestep": 0.009}, "multiple of timestep"),
    ({"timestep": float("nan")}, "timestep must be a finite positive number"),
    ({"timestep": 0}, "timestep must be"),
    ({"c": "1"}, "c must be"),
    ({"c": float("inf")}, "c must be"),
    ({"hold_time": float("inf")}, "finite positive"),
    ({"horizon": True}, "horizon must be"),
    ({"threads": -3}, "threads must be"),
    ({"threads": 1.5}, "threads must be"),
    ({"control_mode": ["joint_velocity"]}, "unknown control mode"),
    ({"width": -1}, "width must be"),
    ({"horizon": 0}, "horizon must be"),
    ({"position_tolerance": -1.0}, "finite positive"),
    ({"hold_time": float("nan")}, "finite positive"),
    ({"attitude_limit": 0}, "attitude_limit must be"),
    ({"num_envs": 3}, "gym.make_vec"),
    ({"mount": [[0.5, 0.5], [-0.5, 0.5]]}, "unexpected keyword argument 'mount'"),
]


@pytest.mark.filterwarnings("ignore:.*render_mode='rgb'")
def test_bad_keywords_name_the_nearest_valid_one():
    found = [
        (
            env_id,
            keywords,
            accepted(lambda i=env_id, k=keywords: gym.make(i, **k), ConfigurationError, message),
        )
        for env_id in IDS
        for keywords, message in KEYWORDS
    ]
    assert_none(f"{env_id}, {keywords}: {said}" for env_id, keywords, said in found if said)


@every_id
def test_keywords_of_one_id_are_refused_by_the_others(env_id):
    for keyword, value, bad, owner in (
        ("orientation_tolerance", 3.0, -1.0, "SingleArm"),
        ("angular_velocity_tolerance", 3.0, "a", "SingleArm"),
        ("mounts", [[0.5, 0.2], [-0.5, 0.2]], [[0.5, 0.2]], "DualArmPlanar"),
        ("approach_tolerance", 3.0, 0.0, "DualArmSpatial"),
    ):
        if owner in env_id:
            gym_make(env_id, **{keyword: value})
            with pytest.raises(ConfigurationError):
                gym_make(env_id, **{keyword: bad})
        else:
            with pytest.raises(ConfigurationError, match=f"unexpected keyword argument '{keyword}'"):
                gym_make(env_id, **{keyword: value})


# Stepping ------------------------------------------------------------


ACTIONS = [
    (lambda m: np.zeros(m - 1), "shape"),
    (lambda m: np.zeros((1, m)), "shape"),
    (lambda m: np.full(m, np.nan), "NaN"),
    (lambda m: np.array([0] * (m - 1) + [np.inf]), "infinity"),
    (lambda m: np.zeros(m, dtype=complex), "dtype"),
    (lambda m: np.zeros(m, dtype=bool), "dtype"),
    (lambda m: np.array(["0"] * m), "dtype"),
    (lambda m: [[0.0], [0.0, 1.0]], "array of numbers"),
]


@every_id
def test_bad_actions_are_refused_before_anything_moves(env_id):
    env = gym.make(env_id)
    env.reset(seed=0)
    m = env.action_space.shape[0]
    env.step(np.full(m, 0.3))
    before = env.unwrapped.vector.simulation.state(0)
    for action, message in ACTIONS:
        with pytest.raises(ActionError, match=message):
            env.step(action(m))
        np.testing.assert_array_equal(env.unwrapped.vector.simulation.state(0), before)


@every_id
@given(st.floats(1.0000001, 1e300))
@settings(max_examples=5, deadline=None)
def test_actions_out_of_bounds_are_clipped_and_counted(env_id, size):
    a, b = gym.make(env_id), gym.make(env_id)
    for env in (a, b):
        env.reset(seed=0)
    stroke = filled(a, 0.0)
    stroke[[0, -1]] = 1.0, -1.0
    for _ in range(3):
        clipped = a.step(size * stroke)
        exact = b.step(stroke)
    np.testing.assert_array_equal(clipped[0], exact[0])
    assert clipped[4]["clipped_actions"] == 3
    assert exact[4]["clipped_actions"] == 0


@every_id
def test_stepping_before_reset_is_an_error(env_id):
    env = gym.make_vec(env_id, num_envs=2)
    with pytest.raises(ConfigurationError, match="reset before step"):
        env.step(filled(env, 0.0))


def test_capture_by_the_single_arm_needs_the_whole_envelope_held_for_its_time():
    env = gym.make(SINGLE)
    task = env.unwrapped.task
    home = task.mechanics.end_effector_pose(task.mechanics.home)
    from space_envs.dynamics.rotations import from_matrix

    goal = {"goal_position": home[0] + [0.0, 0.049, 0.0], "goal_quaternion": from_matrix(home[1])}
    env.reset(options=goal)
    ends = [env.step(np.zeros(7)) for _ in range(10)]
    assert [e[2] for e in ends] == [False] * 9 + [True]
    assert ends[-1][4]["outcome"] == "captured"
    assert ends[-1][4]["is_success"]
    assert ends[-1][4]["reward_terms"]["capture"] > 0
    # Held for its whole time: on the way in, the sample that finds the envelope begins the first period.
    aside = task.mechanics.home + [0.0, 0.06, 0, 0, 0, 0, 0]
    env.reset(options={**goal, "goal_position": home[0], "joint_position": aside})
    inside = []
    for _ in range(60):
        observation, _, done, *_ = env.step(
            np.array([0, -0.05, 0, 0, 0, 0, 0.0]) if not any(inside) else np.zeros(7)
        )
        inside.append(bool(task.errors(observation[None]).within(task.limits)[0]))
        if done:
            break
    assert done
    assert not inside[0]
    assert sum(inside) == 11
    # A hair outside the position tolerance, and nothing ever happens.
    goal["goal_position"] = home[0] + [0.0, 0.051, 0.0]
    env.reset(options=goal)
    assert not any(env.step(np.zeros(7))[2] for _ in range(30))
    # A tighter envelope by keyword.
    strict = gym.make(SINGLE, position_tolerance=0.01)
    strict.reset(options={**goal, "goal_position": home[0] + [0.0, 0.049, 0.0]})
    assert not any(strict.step(np.zeros(7))[2] for _ in range(30))


@every_id
def test_horizon_truncates_and_attitude_loss_terminates(env_id):
    env = gym.make(env_id, horizon=5)
    env.reset(seed=0)
    still, full = filled(env, 0.0), filled(env, 1.0)
    steps = [env.step(still) for _ in range(5)]
    assert [s[3] for s in steps] == [False] * 4 + [True]
    assert steps[-1][4]["outcome"] == "timeout"
    env = gym.make(env_id, attitude_limit=0.5)
    env.reset(seed=0)
    for _ in range(100):
        *_, terminated, _, info = env.step(full)
        if terminated:
            break
    assert info["outcome"] == "attitude_lost"
    assert info["attitude"] > 0.5
    assert info["reward_terms"]["failure"] < 0


@every_id
@pytest.mark.parametrize("mode", ["disabled", "next_step", "same_step"])
def test_diverged_simulation_ends_the_episode_and_never_returns_nan(mode, env_id):
    env = gym.make_vec(env_id, num_envs=3, autoreset_mode=mode)
    env.reset(seed=0)
    env.step(filled(env, 0.0))
    env.simulation.joint_velocity[1, 2] = 1e15
    observation, reward, terminated, truncated, info = env.step(filled(env, 0.0))
    assert terminated.tolist() == [False, True, False]
    last = info["final_info"] if mode == "same_step" else info
    assert last["outcome"].tolist() == ["running", "diverged", "running"]
    assert np.isfinite(observation).all()
    assert np.isfinite(reward).all()
    # The other rows did not notice, and the row works again after its reset.
    if mode == "disabled":
        env.reset(options={"reset_mask": np.array([False, True, False])})
    for _ in range(3):
        observation, _, terminated, *_ = env.step(filled(env, 0.1))
    assert not terminated.any()
    assert np.isfinite(observation).all()


# Peak attitude --------------------------------------------------------


@every_id
def test_the_observed_peak_attitude_counts_every_step_of_the_simulation(env_id):
    watched, env = (gym.make_vec(env_id, num_envs=8, autoreset_mode="disabled") for _ in range(2))
    watched.reset(seed=0)
    first, _ = env.reset(seed=0)
    peak = env.task.layout.slices["peak_attitude"].start
    seen: list[np.ndarray] = [np.zeros(8)]
    watched.simulation.watch = lambda: seen.append(base_rotation(watched.simulation.base_attitude))
    ends = [first[:, peak]]
    for action in np.random.default_rng(3).uniform(-1.0, 1.0, (30, *env.action_space.shape)):
        observation, *_ = env.step(action)
        np.testing.assert_array_equal(watched.step(action)[0], observation)
        np.testing.assert_array_equal(observation[:, peak], np.max(seen, axis=0))
        ends.append(env.task.attitude(observation))
    assert len(seen) == 1 + 30 * env.task.substeps
    assert (np.max(ends, axis=0) < observation[:, peak]).any()  # the satellite turned back in between
    partly, _ = env.reset(options={"reset_mask": np.arange(8) == 0})
    assert partly[:2, peak].tolist() == [0.0, observation[1, peak]]


# Autoreset ------------------------------------------------------------


@every_id
def test_next_step_autoreset(env_id):
    env = gym.make_vec(env_id, num_envs=2, horizon=3, autoreset_mode="next_step")
    assert env.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    env.reset(seed=0)
    for _ in range(3):
        last, _, _, truncated, info = env.step(filled(env, 1.0))
    assert truncated.all()
    assert (env.task.layout.read(last, "time") > 0).all()
    first, reward, terminated, truncated, info = env.step(filled(env, 1.0))
    assert (env.task.layout.read(first, "time") == 0).all()
    assert (env.task.layout.read(first, "joint_velocity") == 0).all()
    assert (reward == 0).all()
    assert not (terminated | truncated).any()
    assert all((term == 0).all() for name, term in info["reward_terms"].items() if name[0] != "_")
    # The information is that of the new episodes.
    assert info["outcome"].tolist() == ["running"] * 2
    assert (info["attitude"] == 0).all()
    assert info["_index"].all()
    goals = env.task.goals("train", info["index"])
    place = env.task.layout.read(first, "target_position" if "Dual" in env_id else "goal_position")
    np.testing.assert_allclose(place, goals.position[:, : place.shape[1]], atol=1e-12)


@every_id
def test_same_step_autoreset_keeps_the_final_observation(env_id):
    kept = gym.make_vec(env_id, num_envs=2, horizon=3, autoreset_mode="disabled")
    env = gym.make_vec(env_id, num_envs=2, horizon=3, autoreset_mode="same_step")
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    kept.reset(seed=0)
    env.reset(seed=0)
    for _ in range(3):
        last, *_ = kept.step(filled(env, 1.0))
        first, reward, _, truncated, info = env.step(filled(env, 1.0))
    assert truncated.all()
    np.testing.assert_array_equal(np.stack(info["final_obs"]), last)
    assert info["final_info"]["outcome"].tolist() == ["timeout"] * 2
    assert not info["_outcome"].any()
    assert info["_index"].all()
    assert (env.task.layout.read(first, "time") == 0).all()
    goals = env.task.layout.read(first, "goal_position")
    assert not np.array_equal(goals, env.task.layout.read(last, "goal_position"))


@every_id
def test_disabled_autoreset_freezes_ended_rows_and_resets_by_mask(env_id):
    env = gym.make_vec(env_id, num_envs=2, horizon=3, autoreset_mode="disabled")
    env.reset(seed=0)
    for _ in range(3):
        last, *_ = env.step(filled(env, 1.0))
    again, reward, _, truncated, _ = env.step(filled(env, 1.0))
    np.testing.assert_array_equal(again, last)
    assert (reward == 0).all()
    assert truncated.all()
    state = env.simulation.state(0)
    for _ in range(5):
        *_, info = env.step(filled(env, 2.0))
    np.testing.assert_array_equal(env.simulation.qpos[0], state[1 : 1 + env.simulation.qpos.shape[1]])
    assert (info["clipped_actions"] == 0).all()
    attitude = np.rad2deg(env.task.attitude(last))
    np.testing.assert_array_equal(info["attitude"], attitude)
    partly, _ = env.reset(options={"reset_mask": np.array([True, False])})
    np.testing.assert_array_equal(partly[1], last[1])
    assert env.task.layout.read(partly[0], "time") == 0
