"""Whatever is given to an environment is taken, or refused by name, soon, and before anything moves."""

import os
import re
import time
from fractions import Fraction

import numpy as np
import pytest
from boundary import (
    CLUTTERED,
    GOALS,
    LONGEST,
    PLANAR,
    SINGLE,
    SOON,
    SPATIAL,
    Strange,
    check,
    gym_make,
    gym_make_vec,
    pair,
    soon,
)
from offenders import accepted, assert_none

from space_envs.control import CONTROL_MODES
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, GoalError, SpaceEnvsError
from space_envs.registration import ENTRIES

IDS = sorted(ENTRIES)
every_id = pytest.mark.parametrize("env_id", IDS)


# Keywords ----------------------------------------------------------------------------------------------


KEYWORDS = [
    ({"c": 1e160}, "c must be a finite positive number of at most 1e"),
    ({"c": 10**400}, "c must be"),
    ({"c": np.ones(2)}, "c must be"),
    ({"c": np.bool_(True)}, "c must be"),
    ({"attitude_limit": 1e9}, "attitude_limit must be"),
    ({"horizon": np.array([3])}, "horizon must be"),
    ({"horizon": np.array([3, 4])}, "horizon must be"),
    ({"horizon": 10**400}, "horizon must be"),
    ({"horizon": 10**5 + 1}, "an episode lasts 10000 s at most, got horizon 100001"),
    ({"num_envs": np.array([3, 4])}, "num_envs must be"),
    ({"num_envs": 10**9}, "num_envs must be"),
    ({"num_envs": 10**7}, "num_envs must be"),
    ({"num_envs": 10**400}, "num_envs must be"),
    ({"threads": 10**6}, "threads must be a positive integer of at most"),
    ({"timestep": 1e-9}, "timestep"),
    ({"timestep": 1e-300}, "timestep"),
    ({"timestep": 5.0, "control_period": 5.0}, "timestep|control_period"),
    ({"control_period": 1e6}, "control_period"),
    ({"control_period": 1.0}, "control_period"),
    ({"control_period": 1e308}, "control_period"),
    ({"control_period": 10**400}, "control_period"),
    ({"camera": "overveiw"}, "unknown camera 'overveiw'.*Did you mean 'overview'"),
    ({"camera": None}, "unknown camera"),
    ({"camera": 3}, "unknown camera"),
    ({"width": np.array([3])}, "width must be"),
    ({"height": 10**400}, "height must be"),
    ({"hold_time": 1e300}, "^hold_time must be"),
    ({"position_tolerance": np.array([0.1])}, "^position_tolerance must be"),
    ({"split": np.array(["test", "test"])}, "unknown split"),
    ({"difficulty": Strange()}, "unknown difficulty"),
    ({"difficulty": "e" * 10**6}, "unknown difficulty"),
    ({"control_mode": np.zeros(3)}, "unknown control mode"),
    ({"render_mode": np.zeros(3)}, "unknown render mode"),
    ({"render_mode": 5}, "unknown render mode"),
    ({"autoreset_mode": np.zeros(3)}, "unknown autoreset mode"),
    ({"env_id": ["a"]}, "unknown environment id"),
]


def test_bad_keywords_are_refused_soon():
    def refused(env_id, keywords, message):
        with soon():
            return accepted(
                lambda: CaptureVectorEnv(**{"env_id": env_id, **keywords}),
                ConfigurationError,
                f"(?s)(?=.*({message}))^.{{1,{LONGEST}}}$",
            )

    found = [(i, k, refused(i, k, message)) for i in IDS for k, message in KEYWORDS]
    assert_none(f"{env_id}, {list(keywords)}: {said}" for env_id, keywords, said in found if said)


def test_numbers_of_every_type_are_taken_as_plain_ones():
    env = gym_make_vec(
        SINGLE,
        num_envs=np.int64(2),
        horizon=np.array(5),
        c=Fraction(1, 2),
        attitude_limit=np.float32(30),
        threads=np.int8(1),
        position_tolerance=np.array(0.1),
    )
    task = env.task
    assert (env.num_envs, task.horizon, task.c, task.attitude_limit) == (2, 5, 0.5, 30.0)
    assert [type(x) for x in (env.num_envs, task.horizon, task.c)] == [int, int, float]
    assert type(task.envelope.position) is float


def test_what_does_not_fit_into_memory_is_refused_before_it_is_made(monkeypatch):
    page = os.sysconf("SC_PAGE_SIZE")
    monkeypatch.setattr(os, "sysconf", lambda name: page if name == "SC_PAGE_SIZE" else 10**8 // page)
    gym_make_vec(SINGLE, num_envs=100)
    with pytest.raises(ConfigurationError, match=r"num_envs=100000 would take about \d+ GB.*at most \d+ fit"):
        gym_make_vec(SINGLE, num_envs=100_000)


def test_cameras_of_every_id_are_known_before_the_first_picture():
    for env_id in IDS:
        for index in range(ENTRIES[env_id].task().render_model.ncam):
            name = ENTRIES[env_id].task().render_model.cam(index).name
            assert CaptureVectorEnv(env_id, camera=name).render_mode is None


# Resets ------------------------------------------------------------------------------------------------


RESETS = [
    ({"seed": [1]}, "seed must be"),
    ({"seed": np.array(1)}, "seed must be"),
    ({"seed": np.array([1.0, 2.0])}, "seed must be"),
    ({"seed": {}}, "seed must be"),
    ({"seed": -(10**400)}, "seed must be"),
    ({"seed": Strange()}, "seed must be"),
    ({"options": 3}, "options must be"),
    ({"options": {3: 4}}, "unknown reset option 3"),
    ({"options": {"index": [[1], [2, 3]]}}, "index must be"),
    ({"options": {"index": 10**400}}, "index"),
    ({"options": {"index": [0, 10**6]}}, r"0..\d+, got 1000000"),
    ({"options": {"index": [True, False]}}, "index"),
    ({"options": {"index": "3"}}, "index"),
    ({"options": {"index": None}}, "index"),
    ({"options": {"index": Strange()}}, "index"),
    ({"options": {"split": Strange()}}, "unknown split"),
    ({"options": {"split": np.array(["test", "test"])}}, "unknown split"),
    ({"options": {"reset_mask": [[True], [True, False]]}}, "reset_mask must be"),
    ({"options": {"reset_mask": Strange()}}, "reset_mask must be"),
    ({"options": {"reset_mask": [1, 0]}}, "reset_mask must be"),
    ({"options": {"joint_position": [[1.0], [2.0, 3.0]]}}, "joint_position must be numbers"),
    ({"options": {"joint_position": Strange()}}, "joint_position must be numbers"),
    ({"options": {"joint_velocity": 10**400}}, "joint_velocity must be numbers"),
    ({"options": {"joint_velocity": 1e300}}, "joint_velocity must have shape"),
]


def test_bad_resets_are_refused_before_anything_moves():
    def said(env_id, arguments):
        return check(env_id, lambda env: env.reset(**arguments), ConfigurationError) or "nothing"

    found = [(i, a, message, said(i, a)) for i in IDS for a, message in RESETS]
    assert_none(
        f"{env_id}: {told}, not {message}"
        for env_id, _, message, told in found
        if not re.search(message, told)
    )


@every_id
def test_a_long_list_of_indices_is_not_repeated(env_id):
    env = gym_make_vec(env_id, num_envs=2000, threads=1)
    with soon(), pytest.raises(ConfigurationError, match="got 9999$") as caught:
        env.reset(options={"index": np.full(2000, 9999)})
    assert len(str(caught.value)) < LONGEST


@every_id
def test_a_seed_of_the_single_environment_is_one_number(env_id):
    env = gym_make(env_id)
    for seed in ([1], (1,), np.array([1]), np.array(1)):
        with pytest.raises(ConfigurationError, match="seed must be"):
            env.reset(seed=seed)
    env.reset(seed=3)
    state = env.unwrapped.vector.simulation.state(0)
    with pytest.raises(ConfigurationError, match="seed must be"):
        env.reset(seed=[1])
    np.testing.assert_array_equal(env.unwrapped.vector.simulation.state(0), state)
    assert env.np_random_seed == 3


@every_id
def test_goals_are_numbers(env_id):
    for name, numbers in GOALS[env_id].items():
        as_text = [str(number) for number in numbers]
        for bad in (as_text, [True, *numbers[1:]], np.ones(len(numbers), dtype=bool), None, [10**400] * 3):
            said = check(
                env_id,
                lambda env, b=bad, n=name: env.reset(options={**GOALS[env_id], n: b}),
                ConfigurationError,
            )
            assert said is not None and f"{name} must be numbers" in said
    assert check(env_id, lambda env: env.reset(options=GOALS[env_id])) is None


@pytest.mark.parametrize(
    ("env_id", "options"),
    [
        (PLANAR, {"target_angular_velocity": [1e6]}),
        (PLANAR, {"target_angle": [1e300]}),
        (SPATIAL, {"target_angular_velocity": [0.0, 9.0, 0.0]}),
        (CLUTTERED, {"obstacle_position": [1e6] * 9}),
        (CLUTTERED, {"obstacle_radius": [1e6] * 3}),
        (SINGLE, {"goal_position": [0.0, 1e200, 0.0]}),
        (SPATIAL, {"target_quaternion": [1e200, 0.0, 0.0, 0.0]}),
    ],
)
def test_goals_beyond_their_bounds_are_refused_by_name(env_id, options):
    said = check(env_id, lambda env: env.reset(options={**GOALS[env_id], **options}), GoalError)
    assert said is not None and f"{next(iter(options))} must lie in -" in said


def test_mounts_without_reachable_goals_are_refused():
    for mounts in ([[-5.0, -5.0], [-5.0, -5.0]], [[0.5, 0.0], [0.5, 0.0]], [[5.0, 5.0], [-5.0, -5.0]]):
        env = gym_make(PLANAR, mounts=mounts)
        begin = time.process_time()
        with pytest.raises(GoalError, match="Give a goal to reset, or choose mounts"):
            env.reset(seed=0)
        assert time.process_time() - begin < 3 * SOON
    for bad in (
        3,
        None,
        [[0.5, 0.2]],
        [["0.5", "0.2"], [0.5, 0.2]],
        [[True, 0.2], [0.5, 0.2]],
        Strange(),
        [[10**400, 0]] * 2,
    ):
        if bad is not None:
            with pytest.raises(ConfigurationError, match="mounts must be two points"):
                gym_make(PLANAR, mounts=bad)


# Observations stay in their space ----------------------------------------------------------------------


@every_id
@pytest.mark.parametrize("mode", CONTROL_MODES)
def test_observations_stay_in_their_space(env_id, mode):
    env = gym_make_vec(
        env_id, num_envs=32, control_mode=mode, difficulty="hard", attitude_limit=3600, threads=1
    )
    space, rng = env.single_observation_space, np.random.default_rng(0)
    observation = env.reset(seed=0, options={"split": "ood"})[0]
    for _ in range(40):
        assert (np.abs(observation) <= space.high).all()
        observation = env.step(rng.choice([-1.0, 0.0, 1.0], env.action_space.shape))[0]


@every_id
def test_the_fastest_target_stays_in_the_space(env_id):
    env = gym_make(env_id, horizon=10**5 if "Planar" in env_id else 300)
    options = {
        name: np.full(option.width, option.largest)
        for name, option in env.unwrapped.task.goal_options.items()
        if name in ("target_angle", "target_angular_velocity")
    }
    observation = env.reset(options={**GOALS[env_id], **options})[0]
    layout = env.unwrapped.task.layout
    if "Planar" in env_id:
        angle = layout.read(observation, "target_angle")[0]
        rate = layout.read(observation, "target_angular_velocity")[0]
        field = next(field for field in layout.fields if field.name == "target_angle")
        assert abs(angle) + abs(rate) * 10**4 <= field.bound
    for _ in range(40):
        assert env.observation_space.contains(observation)
        observation = env.step(np.zeros(env.action_space.shape))[0]


@every_id
def test_what_is_refused_after_a_goal_was_drawn_leaves_the_generators_alone(env_id):
    """Starts that cannot brake, or that touch something, are found out only once the goal is known."""
    env, twin = pair(env_id)
    robot = env.task.robot
    fast = {
        "joint_position": robot.joint_range[:, 1] - 0.11,
        "joint_velocity": robot.rate_limit,
    }
    for options in (fast, {"joint_position": robot.joint_range[:, 1]}):
        with pytest.raises(SpaceEnvsError):
            env.reset(options=options)
        np.testing.assert_array_equal(env.reset()[0], twin.reset()[0])
    env, twin = (gym_make(PLANAR, mounts=[[0.5, 0.0], [0.5, 0.0]]) for _ in range(2))
    for each in (env, twin):
        with pytest.raises(GoalError):
            each.reset(seed=1)
    state = env.np_random.bit_generator.state
    with pytest.raises(GoalError):
        env.reset()
    assert env.np_random.bit_generator.state == state
