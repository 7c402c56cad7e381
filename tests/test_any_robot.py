"""Tasks with robots that a user describes: physics, goals, ways to give a robot, and errors."""

import pickle
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import gymnasium as gym
import numpy as np
import pytest
from any_robots import DESCRIPTIONS, PLANAR_FOUR, SIX_JOINTS, TWO_SIX
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray

from space_envs.codegen.cache import CACHE_VARIABLE
from space_envs.control import CONTROL_MODES
from space_envs.drives import STOP_MARGIN, braking_deceleration
from space_envs.dynamics import minimum_jerk, roll_out_base
from space_envs.dynamics.bodies import body_motion, momentum_drift
from space_envs.dynamics.reactionless import reach, reach_rotating
from space_envs.dynamics.rigid_body import tumble
from space_envs.dynamics.rotations import rotate
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, GoalError
from space_envs.policy import Needs, PolicyContext
from space_envs.registration import make_task
from space_envs.robots.robot import Robot, StepLimits, Target
from space_envs.robots.zoo import find_robot, register_robot
from space_envs.tasks.common import DIFFICULTIES, SPLITS
from space_envs.tasks.dual_arm_planar import DualArmPlanarTask
from space_envs.tasks.goals import poses
from space_envs.tasks.goals.stored import stored_draws
from space_envs.tasks.goals.tumbling import RENDEZVOUS_TIME

SINGLE, CLUTTERED, PLANAR, SPATIAL = DESCRIPTIONS
every_id = pytest.mark.parametrize("env_id", DESCRIPTIONS)


@pytest.fixture(scope="module", autouse=True)
def cache(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache of goals for this file alone."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv(CACHE_VARIABLE, str(folder))
        yield folder


@pytest.fixture(scope="module")
def robots(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Robot]:
    """Robots by the text of their description."""
    folder = tmp_path_factory.mktemp("robots")
    found = {}
    for number, text in enumerate({SIX_JOINTS, PLANAR_FOUR, TWO_SIX}):
        file = folder / f"robot{number}.toml"
        file.write_text(text)
        found[text] = find_robot(file)
    return found


def make(robots: dict[str, Robot], env_id: str, n: int = 4, **keywords: Any) -> CaptureVectorEnv:
    return CaptureVectorEnv(
        env_id, n, robot=robots[DESCRIPTIONS[env_id]], autoreset_mode="disabled", **keywords
    )


@every_id
def test_environments_pass_the_checks_of_gymnasium(robots: dict[str, Robot], env_id: str) -> None:
    robot = robots[DESCRIPTIONS[env_id]]
    env = gym.make(env_id, robot=robot, split="validation")
    check_env(env.unwrapped, skip_render_check=True)
    layout = env.unwrapped.task.layout
    assert layout.slices["joint_position"] == slice(0, robot.n_joints)
    assert env.observation_space.shape == (layout.size,)


@pytest.mark.parametrize("mode", CONTROL_MODES)
@every_id
def test_momentum_limits_and_determinism_in_every_mode(
    robots: dict[str, Robot], env_id: str, mode: str
) -> None:
    """The bound on momentum, rates and stops under full strokes, and rows that do not depend on others."""
    free = {"collisions": False, "attitude_limit": 179.0, "hold_time": 1e3}
    env, alone = (make(robots, env_id, n, control_mode=mode, **free) for n in (4, 1))
    env.reset(options={"split": "validation", "index": [3, 5, 8, 9]})
    alone.reset(options={"split": "validation", "index": 5})
    rng, states = np.random.default_rng(0), []
    action = np.zeros((4, env.mode.size))
    for step in range(80):
        if step % 20 == 0:
            action = np.sign(rng.uniform(-1.0, 1.0, action.shape))
        observation, reward, *_ = env.step(action)
        row, row_reward, *_ = alone.step(action[1:2])
        np.testing.assert_array_equal(observation[1], row[0])
        assert reward[1] == row_reward[0] and np.isfinite(observation).all()
        states.append(env.simulation.robot_state())
    qpos, qvel = (np.stack(part, axis=1) for part in zip(*states, strict=True))
    assert momentum_drift(body_motion(env.task.mechanics, qpos, qvel))[1].max() <= 1e-6
    robot = env.task.robot
    assert (np.abs(qvel[..., 6:]) < 1.2 * robot.rate_limit).all()
    assert (np.abs(qvel[..., 6:]) > 0.02 * robot.rate_limit).any()
    low, high = robot.joint_range.T
    assert ((qpos[..., 7:] > low) & (qpos[..., 7:] < high)).all()
    # A copy continues exactly like the original.
    copy = pickle.loads(pickle.dumps(env))
    for one, other in zip(env.step(action)[:4], copy.step(action)[:4], strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_robot_is_given_by_name_by_file_or_as_it_is(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(SIX_JOINTS)
    register_robot("mine_by_name", file)
    found = [
        make_task(SINGLE, {"robot": given}) for given in ("mine_by_name", file, str(file), find_robot(file))
    ]
    assert len({task.robot.digest for task in found}) == 1
    goals = [task.goals("test", np.arange(3)).position for task in found]
    assert all((each == goals[0]).all() for each in goals)
    assert make_task(SINGLE, {}).robot == find_robot("shyam2020", "paper")
    assert make_task(SINGLE, {"variant": "physical"}).robot == find_robot("shyam2020", "physical")
    assert replace(found[0], difficulty="hard").robot == found[0].robot


def test_robots_of_another_kind_are_refused(robots: dict[str, Robot]) -> None:
    six, planar, two = robots[SIX_JOINTS], robots[PLANAR_FOUR], robots[TWO_SIX]
    few = replace(six, arms=(replace(six.arms[0], links=six.arms[0].links[:5]),))
    arm = two.arms[0]
    joint = replace(arm.links[2].joint, home=2.85)
    links = (*arm.links[:2], replace(arm.links[2], joint=joint), *arm.links[3:])
    at_stop = replace(two, arms=(replace(arm, links=links), two.arms[1]))
    for env_id, robot, message in (
        (SINGLE, two, f"{SINGLE} needs a robot with one arm in space, 'two_six' has two arms in space"),
        (SPATIAL, six, "needs a robot with two arms in space, 'six_joints' has one arm in space"),
        (SPATIAL, planar, "needs a robot with two arms in space, 'planar_four' has two arms in the plane"),
        (PLANAR, two, "needs a robot with two arms in the plane, 'two_six' has two arms in space"),
        (SINGLE, few, f"{SINGLE} needs arms of at least 6 joints in space, 'six_joints' has one of 5"),
        (SPATIAL, at_stop, "2.85 rad, must be more than 0.1 rad inside its range"),
        (SINGLE, "shyam", "unknown robot 'shyam'.*Did you mean 'shyam2020'"),
        (SINGLE, 7, "robot must be a name, a path of a TOML file or a Robot, got 7"),
        (SINGLE, "nowhere/arm.toml", "there is no file"),
    ):
        with pytest.raises(ConfigurationError, match=message):
            make_task(env_id, {"robot": robot})
    with pytest.raises(ConfigurationError, match="unknown model variant 'real'; valid are 'nominal'"):
        make_task(SINGLE, {"robot": six, "variant": "real"})


@pytest.mark.parametrize(
    ("env_id", "difficulty"), [*((SINGLE, each) for each in DIFFICULTIES), (CLUTTERED, "medium")]
)
def test_goals_of_an_arm_are_reached_within_its_ranges(
    robots: dict[str, Robot], env_id: str, difficulty: str
) -> None:
    robot = robots[SIX_JOINTS]
    task = make_task(env_id, {"robot": robot, "difficulty": difficulty})
    for split in SPLITS if env_id == SINGLE else ("validation", "ood"):
        goals = task.goals(split, np.arange(64))
        assert (goals.joint_position == robot.home).all()
        assert (goals.mass_scale != 1.0).all() if split == "ood" else (goals.mass_scale == 1.0).all()
        task.check_goals(goals.position, goals.quaternion)
        if env_id == SINGLE:
            end, _ = poses.goal_configurations(robot, difficulty, split, 0)
            low, high = robot.joint_range.T
            assert ((end > low + 0.999 * STOP_MARGIN) & (end < high - 0.999 * STOP_MARGIN)).all()
            path, rate, dt = minimum_jerk(robot.home, end, 10.0, 101)
            assert (np.abs(rate) <= robot.rate_limit).all()
            position, attitude = roll_out_base(task.mechanics, path, rate, dt)
            hand = position[:, -1] + rotate(attitude[:, -1], task.mechanics.end_effector_pose(end)[0])
            np.testing.assert_allclose(hand, goals.position, atol=1e-3)
            gaps = task.contacts.satellite_gaps(task.contacts.points(task.mechanics, path))
            assert gaps.min() > 0.0
        else:
            task.check_spheres(goals)


@pytest.mark.parametrize(("env_id", "move"), [(PLANAR, reach), (SPATIAL, reach_rotating)])
def test_goals_of_two_arms_are_reached(robots: dict[str, Robot], env_id: str, move: Any) -> None:
    """Without rotating the satellite, where there are joints enough for it."""
    task = make_task(env_id, {"robot": robots[DESCRIPTIONS[env_id]]})
    goals = task.goals("test", np.arange(64))
    inertia = np.array(task.target.inertia)
    attitude, _ = tumble(goals.quaternion, goals.angular_velocity, inertia, np.array([RENDEZVOUS_TIME]))
    points = goals.position[:, None] + rotate(attitude, task.grapples(goals.half_width))
    axes = None if task.approach_axes is None else rotate(attitude, task.approach_axes)
    found = move(task.mechanics, goals.joint_position, points, axes)
    assert found.distance.max() < 2e-3 and np.rad2deg(found.angle.max()) < 0.5
    task.check_start(goals)
    nominal = np.array(task.target.position)
    assert np.abs(goals.position - nominal).max() <= max(task.draws.displacement)


def test_searched_draws_are_kept_by_robot_and_survive_damage(robots: dict[str, Robot], cache: Path) -> None:
    robot, calls = robots[SIX_JOINTS], []

    def find() -> NDArray[np.int64]:
        calls.append(1)
        return np.arange(3 * 64).reshape(64, 3)

    for damage, searches in ((None, 1), (None, 1), (b"damaged", 2), (b"", 3), (None, 3)):
        if damage is not None:
            (cache / "goals" / robot.digest / "mine-0.npy").write_bytes(damage)
        np.testing.assert_array_equal(stored_draws(robot, "mine-0", find), np.arange(3 * 64).reshape(64, 3))
        assert len(calls) == searches
    stored_draws(robots[TWO_SIX], "mine-0", find)
    assert len(calls) == 4


def test_stored_draws_are_those_of_their_robot_alone(robots: dict[str, Robot]) -> None:
    """A task of a user, whose own robot is another, does not take them."""

    class OtherRobotTask(DualArmPlanarTask):
        own_robot = "planar_four_of_a_user"

    register_robot("planar_four_of_a_user", robots[PLANAR_FOUR])
    assert DualArmPlanarTask().frozen and not OtherRobotTask().frozen
    assert not DualArmPlanarTask(mounts=((0.5, 0.1), (-0.5, 0.1))).frozen
    assert DualArmPlanarTask(mounts=((0.5, 0.0), (-0.5, 0.0))).frozen
    own = find_robot("shah2013")
    assert DualArmPlanarTask(robot=replace(own, steps=StepLimits(0.01, 0.01, 0.1))).frozen


def test_a_robot_without_room_for_goals_says_so(robots: dict[str, Robot]) -> None:
    robot = robots[SIX_JOINTS]
    large = replace(robot, satellite=replace(robot.satellite, box=(3.0, 3.0, 3.0)))
    with pytest.raises(GoalError, match=r"64 of 64 goals of split 'test'.*for 'six_joints'.*another mount"):
        make_task(SINGLE, {"robot": large, "collisions": False}).goals("test", np.arange(1))
    two = robots[TWO_SIX]
    far = replace(two, target=replace(cast("Target", two.target), position=(0.0, 9.0, 0.0)))
    with pytest.raises(GoalError, match="0 of 64 are in reach.*target.position"):
        make_task(SPATIAL, {"robot": far}).goals("test", np.arange(1))


def test_the_box_of_a_satellite_need_not_be_a_cube_around_the_centre_of_mass(
    robots: dict[str, Robot],
) -> None:
    """Contacts of a satellite whose box is moved are those of the arm moved the other way."""
    robot = robots[SIX_JOINTS]
    shift = np.array([0.0, 0.1, 0.05])
    moved = replace(robot, satellite=replace(robot.satellite, box_centre=tuple(shift.tolist())))
    here, there = (make_task(SINGLE, {"robot": each}).contacts for each in (robot, moved))
    mechanics = make_task(SINGLE, {"robot": robot}).mechanics
    low, high = robot.joint_range.T
    q = np.random.default_rng(0).uniform(low, high, (200, 6))
    points = here.points(mechanics, q)
    np.testing.assert_allclose(there.satellite_gaps(points), here.satellite_gaps(points - shift), atol=1e-12)
    gaps = here.satellite_gaps(points)
    assert (gaps > 0.0).any() and (gaps < 0.0).any()


def test_bounds_of_positions_grow_with_the_robot(robots: dict[str, Robot], tmp_path: Path) -> None:
    text = SIX_JOINTS.replace("a = 0.9", "a = 9.0").replace("a = 0.7", "a = 7.0")
    (tmp_path / "long.toml").write_text(text.replace("mass = 300.0", "mass = 20000.0"))
    env = make(robots, SINGLE, 1)
    assert env.task.layout == make_task(SINGLE, {"robot": robots[SIX_JOINTS]}).layout
    long = CaptureVectorEnv(SINGLE, 2, robot=tmp_path / "long.toml", difficulty="hard")
    observation, _ = long.reset(options={"split": "ood", "index": [0, 1]})
    field = {field.name: field for field in long.task.layout.fields}["goal_position"]
    assert field.bound > 2.0 * long.task.robot.reach > 30.0
    assert long.observation_space.contains(observation)
    (tmp_path / "long.toml").unlink()
    copy = pickle.loads(pickle.dumps(long))
    np.testing.assert_array_equal(copy.episodes.observation, observation)


def test_policies_see_the_robot_and_need_joints_enough(robots: dict[str, Robot]) -> None:
    context = PolicyContext.from_env(make(robots, SPATIAL, 1))
    robot = robots[TWO_SIX]
    assert context.robot == robot and (context.arms, context.joints, context.planar) == (2, 12, False)
    np.testing.assert_array_equal(context.rate_limit, robot.rate_limit)
    assert Needs(arms=2, joints=6).missing(context) == []
    assert Needs(joints=7).missing(context) == [
        "it needs arms of at least 7 joints, those of 'two_six' have 6"
    ]


def test_drives_brake_as_the_torques_allow(robots: dict[str, Robot]) -> None:
    for name, variant in (("shyam2020", "paper"), ("shyam2020", "physical"), ("shah2013", None)):
        assert (braking_deceleration(find_robot(name, variant)) == 0.04).all()
    strong = robots[SIX_JOINTS]
    np.testing.assert_allclose(braking_deceleration(strong), 0.16 * 0.3)
    weak = [
        replace(link, joint=replace(link.joint, torque_limit=0.01 * link.joint.torque_limit))
        for link in strong.arms[0].links
    ]
    weak_robot = replace(strong, arms=(replace(strong.arms[0], links=tuple(weak)),))
    assert (braking_deceleration(weak_robot) < 0.5 * braking_deceleration(strong)).all()
