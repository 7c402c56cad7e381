"""Goals of the dual-arm tasks: frozen, reachable, graded, disjoint; and reset options in their place."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest
from dual_arm_goals import IDS, at_meeting, reached, task_of

import space_envs  # noqa: F401  (registers the ids)
from space_envs.dynamics.reactionless import end_effectors
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, GoalError
from space_envs.tasks.base import BLOCK
from space_envs.tasks.common import DIFFICULTIES, SPLITS
from space_envs.tasks.goals.tumbling import OOD_FACTOR, OOD_MASS, REACHED, find_attempts, frozen_attempts

every_id = pytest.mark.parametrize("env_id", IDS)


# Splits -----------------------------------------------------------------------------------------------


@every_id
def test_splits_are_disjoint_and_no_goal_comes_twice(env_id):
    task = task_of(env_id)
    flat = []
    for split in SPLITS:
        goals = task.goals(split, np.arange(task.split_size(split)))
        flat.append(
            np.hstack([goals.position, goals.quaternion, goals.angular_velocity, goals.joint_position])
        )
    assert [len(part) for part in flat] == [1024, 256, 512, 512]
    together = np.concatenate(flat).round(9)
    assert len(np.unique(together, axis=0)) == len(together)


@pytest.mark.parametrize(
    ("env_id", "difficulty"),
    [
        (IDS[0], "easy"),
        (IDS[1], "easy"),
        *(pytest.param(i, d, marks=pytest.mark.slow) for i in IDS for d in ("medium", "hard")),
    ],
)
def test_frozen_draws_are_those_that_the_search_finds(env_id, difficulty):
    task = task_of(env_id, difficulty=difficulty)
    found = find_attempts(task, "test", 0)
    frozen = frozen_attempts(f"{task.kind}_{difficulty}_test")
    np.testing.assert_array_equal(found, frozen[:BLOCK])
    assert found.max() > 0  # some draws really are refused
    assert len(frozen) == 512


@every_id
@pytest.mark.parametrize("difficulty", DIFFICULTIES)
def test_every_goal_is_reached_by_a_reactionless_motion(env_id, difficulty):
    task = task_of(env_id, difficulty=difficulty)
    for split in ("test", "ood"):
        goals = task.goals(split, np.arange(3, 512, 64))
        found = reached(task, goals)
        # Drawn at the rendezvous and integrated back to the start: forwards again it is the same to 1e-9.
        assert found.distance.max() < REACHED[0] * 1.001
        assert found.angle.max() < REACHED[1] * 1.001
        assert (found.q > task.mechanics.range[:, 0]).all() and (found.q < task.mechanics.range[:, 1]).all()


@every_id
def test_starts_differ_from_each_other_and_are_not_symmetric(env_id):
    task = task_of(env_id)
    starts = task.goals("test", np.arange(128)).joint_position
    assert len(np.unique(starts, axis=0)) == 128
    assert np.ptp(starts, axis=0).min() > 0.1
    assert (np.abs(starts - task.mechanics.home).max(axis=1) <= task.draws.start[1]).all()
    position = end_effectors(task.mechanics, starts).position
    mirrored = position[:, 1] * [-1.0, 1.0, 1.0]  # the mounts are mirror images of each other in x
    assert np.linalg.norm(position[:, 0] - mirrored, axis=-1).min() > 0.02


@every_id
def test_difficulty_grades_spin_and_distance_and_ood_lies_beyond(env_id):
    largest = []
    for level, difficulty in enumerate(DIFFICULTIES):
        task = task_of(env_id, difficulty=difficulty)
        draws = task.draws
        for split in ("validation", "ood"):
            goals = task.goals(split, np.arange(256))
            _, spin, _, _ = at_meeting(task, goals)
            ratio = np.linalg.norm(spin, axis=-1) / draws.spin[level]
            moved = (
                np.abs(goals.position - np.array(task.target.position)).max(axis=-1)
                / draws.displacement[level]
            )
            width = goals.half_width
            assert draws.half_width[0] <= width.min() < width.max() <= draws.half_width[1]
            if split == "ood":
                assert ratio.min() >= 1.0 - 1e-9 and ratio.max() <= OOD_FACTOR[1] + 1e-9
                assert moved.min() >= 1.0 - 1e-9 and moved.max() <= OOD_FACTOR[1] + 1e-9
                assert goals.mass_scale.min() >= OOD_MASS[0] and goals.mass_scale.max() <= OOD_MASS[1]
                assert (goals.mass_scale != 1.0).all() and np.ptp(goals.mass_scale) > 0.3
            else:
                assert 0.9 < ratio.max() <= 1.0 + 1e-9 and 0.8 < moved.max() <= 1.0 + 1e-9
                assert (goals.mass_scale == 1.0).all()
                largest.append(
                    (np.linalg.norm(spin, axis=-1).max(), np.median(moved) * draws.displacement[level])
                )
            if task.kind == "planar":
                assert not goals.position[:, 2].any() and not goals.angular_velocity[:, :2].any()
                # Both ways round.
                assert {-1.0, 1.0} == set(np.sign(goals.angular_velocity[:, 2]))
    spins, distances = zip(*largest, strict=True)
    assert list(spins) == sorted(spins) and list(distances) == sorted(distances)


@every_id
def test_episodes_begin_with_what_the_goal_says(env_id):
    env = CaptureVectorEnv(env_id, 8)
    observation, info = env.reset(seed=0, options={"split": "ood", "index": np.arange(8) * 9})
    goals, read = env.task.goals("ood", np.arange(8) * 9), env.task.layout.read
    np.testing.assert_array_equal(read(observation, "joint_position"), goals.joint_position)
    assert (read(observation, "joint_velocity") == 0).all()
    width = read(observation, "target_position").shape[1]
    np.testing.assert_array_equal(read(observation, "target_position"), goals.position[:, :width])
    spin = read(observation, "target_angular_velocity")
    np.testing.assert_allclose(spin, goals.angular_velocity[:, -spin.shape[1] :], atol=1e-12)
    points = read(observation, "goal_position").reshape(8, 2, width)
    apart = 0.5 * np.linalg.norm(points[:, 0] - points[:, 1], axis=-1)
    np.testing.assert_allclose(apart, goals.half_width, atol=1e-12)
    expanded = env.simulation.batch.expanded("body_mass")
    base = env.task.model.body("satellite").id
    np.testing.assert_allclose(expanded[:, base], 500.0 * goals.mass_scale)
    assert info["index"].tolist() == [9 * i for i in range(8)]


# Mounts -----------------------------------------------------------------------------------------------

MOUNTS = ((0.5, 0.2), (-0.5, 0.2))


def test_other_mounts_are_another_robot_with_goals_of_its_own():
    env_id = IDS[0]
    task, usual = task_of(env_id, mounts=MOUNTS), task_of(env_id)
    for arm, mount in enumerate(MOUNTS, start=1):
        np.testing.assert_allclose(task.model.body(f"arm{arm}_link1").pos[:2], mount)
        np.testing.assert_allclose(task.render_model.body(f"arm{arm}_link1").pos[:2], mount)
    shift = (
        end_effectors(task.mechanics, task.mechanics.home).position
        - end_effectors(usual.mechanics, usual.mechanics.home).position
    )
    np.testing.assert_allclose(shift, [[0.0, 0.2, 0.0]] * 2, atol=1e-12)
    env = CaptureVectorEnv(env_id, 2, mounts=[list(mount) for mount in MOUNTS], split="validation")
    observation, _ = env.reset(seed=0, options={"index": [0, 40]})
    goals = env.task.goals("validation", np.array([0, 40]))
    assert reached(task, goals).distance.max() < REACHED[0] * 1.001
    np.testing.assert_allclose(
        env.task.layout.read(observation, "end_effector_position")[0],
        end_effectors(task.mechanics, goals.joint_position[0]).position[:, :2].ravel(),
        atol=1e-12,
    )


def test_mounts_as_they_are_by_default_are_the_same_task():
    assert task_of(IDS[0], mounts=[[0.5, 0.0], [-0.5, 0.0]]) == task_of(IDS[0])
    assert task_of(IDS[0], mounts=MOUNTS) != task_of(IDS[0])


@pytest.mark.parametrize("mounts", [[[0.5, 0]], "ab", [[0.5, np.nan], [0, 0]], [[9.0, 0.0], [0.0, 0.0]], 3])
def test_bad_mounts_are_refused(mounts):
    with pytest.raises(ConfigurationError, match="mounts must be two points"):
        gym.make(IDS[0], mounts=mounts)


# Reset options ----------------------------------------------------------------------------------------


@every_id
def test_options_set_the_target_and_the_joints(env_id):
    env = CaptureVectorEnv(env_id, 3)
    task, read = env.task, env.task.layout.read
    planar, n = task.kind == "planar", task.mechanics.n_joints
    joints = task.mechanics.home + 0.1
    rates = np.linspace(-0.1, 0.1, n)
    centre = np.array([[2.4, 1.3], [2.5, 1.2], [2.4, 1.1]]) if planar else np.array([0.0, 1.6, 0.1])
    attitude = {"target_angle": [0.3]} if planar else {"target_quaternion": [-0.8, 0.0, 0.6, 0.0]}
    spin = [-0.04] if planar else [0.02, 0.03, -0.01]
    options = {
        "target_position": centre,
        "target_angular_velocity": spin,
        "target_half_width": [0.25],
        "joint_position": joints,
        "joint_velocity": rates,
        **attitude,
    }
    observation, info = env.reset(seed=0, options=options)
    assert info["split"].tolist() == ["given"] * 3 and info["index"].tolist() == [-1] * 3
    each = np.broadcast_to(centre, (3, centre.shape[-1]))
    np.testing.assert_array_equal(read(observation, "target_position"), each)
    np.testing.assert_allclose(
        read(observation, "target_angular_velocity"), np.tile(spin, (3, 1)), atol=1e-12
    )
    if planar:
        np.testing.assert_allclose(read(observation, "target_angle"), 0.3, atol=1e-12)
        # Grapple point 1 lies at -y of the turned target.
        point = each + 0.25 * np.array([np.sin(0.3), -np.cos(0.3)])
    else:
        # Either sign is the same attitude.
        quaternion = np.tile([0.8, 0.0, -0.6, 0.0], (3, 1))
        np.testing.assert_allclose(read(observation, "target_quaternion"), quaternion, atol=1e-12)
        angle = -2.0 * np.arctan2(0.6, 0.8)
        point = each + 0.25 * np.array([np.cos(angle), 0.0, -np.sin(angle)])
    first = read(observation, "goal_position")[:, : each.shape[1]]
    np.testing.assert_allclose(first, point, atol=1e-12)
    np.testing.assert_array_equal(read(observation, "joint_position"), np.tile(joints, (3, 1)))
    # Total momentum is zero: the base moves as the momentum-level mathematics says.
    twist = task.mechanics.base_twist(joints, rates)
    linear, angular = ([0, 1], [5]) if planar else ([0, 1, 2], [3, 4, 5])
    for name, part in (("base_linear_velocity", linear), ("base_angular_velocity", angular)):
        np.testing.assert_allclose(read(observation, name), np.tile(twist[part], (3, 1)), atol=1e-12)
    assert np.abs(twist).max() > 1e-3


@every_id
def test_what_a_goal_leaves_out_is_nominal(env_id):
    env = CaptureVectorEnv(env_id, 1)
    task, read = env.task, env.task.layout.read
    centre = task.target.position[: 2 if task.kind == "planar" else 3]
    observation, _ = env.reset(seed=0, options={"target_position": centre})
    np.testing.assert_array_equal(read(observation, "joint_position")[0], task.mechanics.home)
    assert not read(observation, "target_angular_velocity").any()
    points = read(observation, "goal_position").reshape(2, -1)
    assert 0.5 * np.linalg.norm(points[0] - points[1]) == pytest.approx(task.target.half_width)
    if task.kind == "planar":
        assert read(observation, "target_angle") == 0.0
    else:
        np.testing.assert_array_equal(read(observation, "target_quaternion")[0], [1.0, 0.0, 0.0, 0.0])


@every_id
def test_one_number_needs_no_brackets(env_id):
    env = CaptureVectorEnv(env_id, 2)
    task = env.task
    options = {"target_position": task.target.position[: 2 if task.kind == "planar" else 3]}
    numbers = {"target_half_width": 0.3} | ({"target_angle": 0.2} if task.kind == "planar" else {})
    given, _ = env.reset(seed=0, options=options | numbers)
    bracketed, _ = env.reset(seed=0, options=options | {name: [value] for name, value in numbers.items()})
    np.testing.assert_array_equal(given, bracketed)


PLANE, SPACE = {"target_position": [2.0, 1.0]}, {"target_position": [0.0, 1.6, 0.0]}
FAR = {"target_position": [3.0, 0.0], "target_half_width": [0.9]}  # one of the points is out of reach


@pytest.mark.parametrize(
    ("env_id", "options", "error", "message"),
    [
        (IDS[0], {"target_angle": [0.3]}, ConfigurationError, "^target_angle needs target_position too$"),
        (IDS[0], {"target_position": [2.0, 1.0, 0.0]}, ConfigurationError, r"shape \(2,\)"),
        (IDS[0], {"target_position": [2.0, np.nan]}, ConfigurationError, "finite"),
        (IDS[0], {"target_position": [9.0, 1.0]}, GoalError, "grapple point 1 out of reach: 8.94 m"),
        (IDS[0], FAR | {"target_angle": [np.pi / 2]}, GoalError, "grapple point 1 out of reach"),
        (IDS[0], FAR | {"target_angle": [-np.pi / 2]}, GoalError, "grapple point 2 out of reach"),
        (IDS[0], {"target_position": [0.2, 0.1]}, GoalError, "inside the satellite"),
        (IDS[0], PLANE | {"target_half_width": [0.0]}, GoalError, r"must lie in \(0, 1\] m"),
        (IDS[0], PLANE | {"target_half_width": [1.5]}, GoalError, r"must lie in \(0, 1\] m"),
        (IDS[0], PLANE | {"target_half_width": 0.0}, GoalError, r"must lie in \(0, 1\] m"),
        (IDS[0], PLANE | {"target_half_width": "wide"}, ConfigurationError, "must be numbers"),
        (
            IDS[0],
            PLANE | {"target_half_width": [0.3, 0.3]},
            ConfigurationError,
            r"must be a number or have shape \(1,\) or \(1, 1\), got \(2,\)",
        ),
        (IDS[0], {"target_position": 2.0}, ConfigurationError, r"must have shape \(2,\)"),
        (IDS[0], PLANE | {"target_angel": [0.3]}, ConfigurationError, "Did you mean 'target_angle'"),
        (IDS[0], PLANE | {"target_quaternion": [1, 0, 0, 0]}, ConfigurationError, "unknown reset option"),
        (IDS[0], PLANE | {"split": "test"}, ConfigurationError, "either a goal or a split"),
        (IDS[0], PLANE | {"index": 4}, ConfigurationError, "either a goal or a split"),
        (IDS[0], {"goal_position": [2.0, 1.0]}, ConfigurationError, "unknown reset option"),
        (
            IDS[1],
            {"target_quaternion": [1, 0, 0, 0]},
            ConfigurationError,
            "^target_quaternion needs target_position",
        ),
        (IDS[1], {"target_position": [0.0, 9.0, 0.0]}, GoalError, "grapple point 1 out of reach"),
        (IDS[1], {"target_position": [0.0, 0.3, 0.1]}, GoalError, "inside the satellite"),
        (IDS[1], SPACE | {"target_quaternion": [2, 0, 0, 0]}, GoalError, "unit quaternion"),
        (IDS[1], SPACE | {"target_quaternion": [0, 0, 0, 0]}, GoalError, "unit quaternion"),
        (IDS[1], SPACE | {"target_angular_velocity": [np.inf, 0, 0]}, ConfigurationError, "finite"),
        (IDS[1], SPACE | {"target_angle": [0.1]}, ConfigurationError, "unknown reset option"),
    ],
)
def test_bad_targets_are_refused_before_anything_moves(env_id, options, error, message):
    env = CaptureVectorEnv(env_id, 1)
    env.reset(seed=0)
    before = env.simulation.state(0)
    with pytest.raises(error, match=message):
        env.reset(options=options)
    np.testing.assert_array_equal(env.simulation.state(0), before)


@every_id
def test_size_by_option_of_one_row_alone(env_id):
    env = CaptureVectorEnv(env_id, 2)
    env.reset(seed=0)
    centre = env.task.target.position[: 2 if env.task.kind == "planar" else 3]
    mask = np.array([False, True])
    before = env.simulation.state(0)
    options = {"target_position": centre, "target_half_width": [[0.2], [0.37]], "reset_mask": mask}
    observation, _ = env.reset(options=options)
    np.testing.assert_array_equal(env.simulation.state(0), before)
    points = env.task.layout.read(observation, "goal_position")[1].reshape(2, -1)
    assert 0.5 * np.linalg.norm(points[0] - points[1]) == pytest.approx(0.37)


@every_id
def test_copies_keep_the_size_and_the_mass_of_every_row(env_id):
    env = CaptureVectorEnv(env_id, 3, split="ood")
    env.reset(seed=3)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    rng = np.random.default_rng(0)
    for _ in range(10):
        action = rng.uniform(-1, 1, env.action_space.shape)
        expected = env.step(action)[0]
        for other in copies:
            np.testing.assert_array_equal(other.step(action)[0], expected)
    for name in ("site_pos", "body_mass", "body_inertia"):
        kept = env.simulation.batch.expanded(name)
        assert len(np.unique(kept.reshape(3, -1), axis=0)) == 3
        np.testing.assert_array_equal(copies[0].simulation.batch.expanded(name), kept)
