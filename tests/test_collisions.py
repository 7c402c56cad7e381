"""Links in the satellite, the target or the other arm: distances, ends of episodes, starts, goals."""

import copy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from distance_oracle import Oracle
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import space_envs  # noqa: F401  (registers the ids)
from space_envs.dynamics import minimum_jerk, roll_out_base
from space_envs.dynamics.capsules import box_distance
from space_envs.dynamics.rotations import Array, rotate
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, GoalError
from space_envs.registration import ENTRIES
from space_envs.robots.contact_checks import contacts_library
from space_envs.robots.zoo import find_robot
from space_envs.tasks.base import BLOCK
from space_envs.tasks.common import DIFFICULTIES, SPLITS
from space_envs.tasks.goals.poses import goal_configurations

IDS = sorted(ENTRIES)
SINGLE, CLUTTERED = "SpaceCapture/SingleArm-v0", "SpaceCapture/SingleArmCluttered-v0"
PLANAR, SPATIAL = "SpaceCapture/DualArmPlanar-v0", "SpaceCapture/DualArmSpatial-v0"
every_id = pytest.mark.parametrize("env_id", IDS)


def make(env_id: str, n: int, **keywords: Any) -> CaptureVectorEnv:
    """An environment whose ended rows stay as they are, and are ended by collisions and the horizon only."""
    free = {"attitude_limit": 179.9, "hold_time": 1e3}
    return CaptureVectorEnv(env_id, n, autoreset_mode="disabled", **free, **keywords)


# Distances --------------------------------------------------------------------------------------------

points = arrays(np.float64, 3, elements=st.floats(-2.0, 2.0, width=32))
sides = arrays(np.float64, 3, elements=st.floats(0.125, 1.0, width=32))


@given(points, points, sides)
@settings(max_examples=200)
def test_the_distance_of_a_segment_from_a_box_is_that_of_its_nearest_or_deepest_point(a, b, half):
    share = np.linspace(0.0, 1.0, 2001)[:, None]
    beyond = np.abs(a + share * (b - a)) - half
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    dense = (outside + np.minimum(beyond.max(axis=-1), 0.0)).min()
    exact = box_distance(a, b, half)
    assert exact <= dense + 1e-12
    assert dense - exact <= np.linalg.norm(b - a) / 4000 + 1e-12


# What MuJoCo says -------------------------------------------------------------------------------------


def strokes(env: CaptureVectorEnv, seed: int, hold: int = 25) -> Array:
    """Full strokes (T, N, m), each held for 2.5 s."""
    rng = np.random.default_rng(seed)
    drawn = rng.choice([-1.0, 1.0], (-(-env.task.horizon // hold), *env.action_space.shape))
    return np.repeat(drawn, hold, axis=0)[: env.task.horizon]


def close_starts(env: CaptureVectorEnv) -> Array:
    """Joint angles (N, n) for the first N test goals, every other one with the arms close together."""
    task, robot, n = env.task, env.task.mechanics, env.num_envs
    goals = task.goals("test", np.arange(n))
    starts = goals.joint_position.copy()
    if task.contacts.arms == 2:
        q = robot.home + np.random.default_rng(0).uniform(-0.8, 0.8, (6000, robot.n_joints))
        apart = task.contacts.arm_gaps(task.contacts.points(robot, q)).min(axis=(1, 2))
        q = q[(apart > 0.01) & (apart < 0.1)]
        for row in range(0, n, 2):
            same = goals.take(np.full(len(q), row))
            starts[row] = q[task.gaps(robot, q, same, same.quaternion).min(axis=1).argmax()]
    return starts


KINDS = {SINGLE: {"satellite"}, PLANAR: {"target", "arms"}, SPATIAL: {"satellite", "target", "arms"}}


@pytest.mark.parametrize("env_id", KINDS)
def test_episodes_end_where_mujoco_sees_a_link_in_a_body_and_nowhere_else(env_id):
    n = 32
    env = make(env_id, n, difficulty="hard")
    env.reset(options={"split": "test", "index": np.arange(n), "joint_position": close_starts(env)})
    oracle, met, info = Oracle(env_id), set(), {}
    goals = env.task.goals("test", np.arange(n))

    def gaps(row: int) -> dict[str, float]:
        return oracle.gaps(env.simulation.qpos[row], goals, row)

    ended = np.zeros(n, dtype=bool)
    for step, action in enumerate(strokes(env, 1)[:120]):
        *_, terminated, _, info = env.step(action)
        for row in np.flatnonzero(terminated & ~ended):
            assert info["outcome"][row] == "collision"
            told = info["collision"][row]
            kind = next((k for k in ("satellite", "target") if told.endswith(k)), "arms")
            # Seen at nine instants of a period of 0.1 s, in which a link may also come out again.
            assert gaps(int(row))[kind] < 0.03
            met.add(kind)
            assert told.startswith("link ") and (env_id == SINGLE or "of arm" in told)
        ended |= terminated
        if step % 4 == 0:
            for row in np.flatnonzero(~ended):
                assert min(gaps(int(row)).values()) > -1e-6
    assert met == KINDS[env_id]
    assert (info["collision"][~ended] == "").all() and (info["collision"][ended] != "").all()
    assert 0 < ended.sum() < n


# The upper arm a little above the deck, and the action that lowers it.
LOW = {"joint_position": find_robot("shyam2020").home - 0.65 * np.eye(7)[1]}
LOWER = -np.eye(7)[1]


@pytest.mark.parametrize("env_id", [SINGLE, CLUTTERED])
def test_a_lowered_upper_arm_is_told_and_paid_as_a_failure(env_id):
    env = gym.make(env_id)
    env.reset(seed=0, options=LOW)
    reward, info = 0.0, {}
    for _ in range(20):
        _, reward, terminated, _, info = env.step(LOWER)
        if terminated:
            break
        assert info["collision"] == ""
    assert info["outcome"] == "collision" and not info["is_success"]
    assert info["collision"] == "link 3 and the satellite"
    assert info["reward_terms"]["failure"] == -0.5


@pytest.mark.parametrize("mode", ["next_step", "same_step"])
def test_what_was_touched_is_told_once_and_not_of_the_next_episode(mode):
    env = CaptureVectorEnv(SINGLE, 2, autoreset_mode=mode)
    env.reset(seed=0, options=LOW)
    info: dict[str, Any] = {}
    for _ in range(20):
        _, _, terminated, _, info = env.step(np.stack([LOWER, -LOWER]))
        if terminated[0]:
            break
    said = info["final_info"] if mode == "same_step" else info
    assert said["collision"].tolist() == ["link 3 and the satellite", ""]
    for _ in range(2):
        *_, info = env.step(np.zeros((2, 7)))
        assert info["collision"].tolist() == ["", ""]


@pytest.mark.parametrize("env_id", KINDS)
def test_a_row_collides_alone_as_it_does_among_64(env_id):
    many = make(env_id, 64, difficulty="hard")
    many.reset(seed=0, options={"split": "test", "index": np.arange(64)})
    actions = strokes(many, 2)[:60]
    ones = {}
    for row in (0, 9, 30, 63):
        ones[row] = make(env_id, 1, difficulty="hard")
        ones[row].reset(seed=0, options={"split": "test", "index": row})
    for action in actions:
        together = many.step(action)
        for row, one in ones.items():
            alone = one.step(action[row : row + 1])
            for a, b in zip(alone[:4], together[:4], strict=True):
                np.testing.assert_array_equal(a[0], b[row])
            assert alone[4]["collision"][0] == together[4]["collision"][row]
    assert (together[4]["outcome"] == "collision").sum() > 5


def random_periods(env: CaptureVectorEnv, size: float) -> tuple[Array, Array]:
    """Sensors (N, s) before and after periods in which all points of the arms move at random."""
    rng = np.random.default_rng(0)
    middle = env.simulation.sensors.copy()
    way = np.zeros_like(middle)
    for frame, columns in env.task.contacts.columns.items():
        if frame != "half_width":
            shape = env.num_envs, columns.stop - columns.start
            middle[:, columns] = rng.uniform(-size, size, shape)
            way[:, columns] = rng.normal(0.0, 0.05, shape)
    return middle - way, middle + way


@pytest.mark.filterwarnings("ignore::space_envs.dynamics.NoCompiledCodeWarning")
@pytest.mark.parametrize("env_id", IDS)
def test_compiled_code_and_numpy_find_the_same_contacts(env_id, monkeypatch):
    env = make(env_id, 200)
    env.reset(seed=0)
    task, found = env.task, []
    for size in (1.0, 3.0):
        before, after = random_periods(env, size)
        found.append((before, after, task.collided(before, after)))
    contacts_library.cache_clear()
    monkeypatch.setenv("CC", "no-such-compiler")
    uncompiled = copy.deepcopy(task)
    assert contacts_library() is None
    monkeypatch.undo()
    contacts_library.cache_clear()
    for before, after, codes in found:
        assert len(set(codes.tolist())) >= 5
        np.testing.assert_array_equal(uncompiled.collided(before, after), codes)


@pytest.mark.parametrize("env_id", KINDS)
def test_nothing_is_jumped_over_between_control_steps(env_id):
    """Points of links that pass through a body within a period, found as on 81 points of the way."""
    n = 60
    env = make(env_id, n)
    env.reset(seed=0)
    contacts = env.task.contacts
    before, after = random_periods(env, 1.0)
    way = 0.5 * (after - before)
    found = contacts.touched(before, after) > 0
    least = np.full(n, np.inf)
    for share in np.linspace(0.0, 1.0, 81):
        now = (1.0 - share) * before + share * after
        for frame, columns in contacts.columns.items():
            if frame == "half_width":
                continue
            points = now[:, columns].reshape(n, -1, 3)
            if frame == "satellite":
                gaps = [contacts.satellite_gaps(points)]
            else:
                gaps = [contacts.target_gaps(points, contacts.target_half(now))]
                gaps += [contacts.arm_gaps(points)] if contacts.arms == 2 else []
            for gap in gaps:
                least = np.minimum(least, gap.reshape(n, -1).min(axis=1))
    moved = 2.0 * np.abs(way).max(axis=1) * 3.0**0.5
    assert not (found & (least > 1e-12)).any()
    assert not (~found & (least < -moved / 16.0)).any()
    assert found.any()


def test_points_measured_and_computed_are_the_same():
    for env_id in KINDS:
        env = make(env_id, 5, collisions=False)
        env.reset(seed=0)
        for action in strokes(env, 3)[:30]:
            env.step(action)
        contacts, simulation = env.task.contacts, env.simulation
        frame = "satellite" if "satellite" in contacts.columns else "target"
        measured = simulation.sensors[:, contacts.columns[frame]].reshape(5, -1, 3)
        computed = contacts.points(env.task.mechanics, simulation.joint_position)
        if frame == "target":  # the same figure, elsewhere
            measured, computed = (np.linalg.norm(p[:, 1:] - p[:, :1], axis=-1) for p in (measured, computed))
        np.testing.assert_allclose(measured, computed, atol=1e-12)


# Starts and keywords ----------------------------------------------------------------------------------


def lowered(env_id: str) -> Array:
    """Joint angles with a link in something."""
    if "Single" in env_id:
        return find_robot("shyam2020").home - np.eye(7)[1]
    if "Planar" in env_id:  # the hands meet
        return np.array([1.57, 0.0, 0.0, 0.5, 0.0, 0.0])
    return find_robot("spatial_dual_arm").home - 0.9 * np.eye(14)[1]


@every_id
def test_starts_that_touch_something_are_refused_before_anything_moves(env_id):
    env = CaptureVectorEnv(env_id, 2)
    env.reset(seed=0)
    before = env.simulation.state(0)
    with pytest.raises(GoalError, match="would begin with a collision: between link"):
        env.reset(options={"joint_position": lowered(env_id)})
    np.testing.assert_array_equal(env.simulation.state(0), before)
    env = CaptureVectorEnv(env_id, 2, collisions=False)
    env.reset(seed=0, options={"joint_position": lowered(env_id)})
    *_, info = env.step(np.zeros(env.action_space.shape))
    assert (info["outcome"] == "running").all()


def test_a_target_on_an_arm_is_refused():
    env = CaptureVectorEnv(SPATIAL, 1)
    tip = env.task.mechanics.end_effector_pose(env.task.mechanics.home, 0)[0]
    with pytest.raises(GoalError, match="link . of arm 1 and the target"):
        env.reset(options={"target_position": tip})


@pytest.mark.parametrize("value", ["no", 1, None, 0.5])
def test_collisions_is_true_or_false(value):
    with pytest.raises(ConfigurationError, match="collisions must be True or False"):
        gym.make(SINGLE, collisions=value)


# Goals ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_goals_of_the_single_arm_are_reached_clear_of_the_satellite(difficulty):
    env = CaptureVectorEnv(SINGLE, 1, difficulty=difficulty)
    task, robot = env.task, env.task.mechanics
    for split in SPLITS:
        chosen, scale = goal_configurations(task.robot, difficulty, split, 1)
        path, rate, dt = minimum_jerk(robot.home, chosen, 10.0, 101)
        gaps = task.contacts.satellite_gaps(task.contacts.points(robot, path))
        assert gaps.min() > 0.0
        goals = task.goals(split, np.arange(BLOCK, 2 * BLOCK))
        position, quaternion = roll_out_base(robot, path, rate, dt)
        tip = position[:, -1] + rotate(quaternion[:, -1], robot.end_effector_pose(chosen)[0])
        np.testing.assert_allclose(tip, goals.position, atol=1e-3)
        np.testing.assert_array_equal(scale, goals.mass_scale)
