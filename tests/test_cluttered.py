"""SpaceCapture/SingleArmCluttered: spheres, collisions, what may be asked for and what is recorded."""

import copy
import pickle
from dataclasses import replace

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from cluttered_scenes import ENV_ID, make, scene
from drawn_models import geoms

import space_envs  # noqa: F401  (registers the ids)
from space_envs.dynamics import minimum_jerk
from space_envs.dynamics.bodies import body_motion, momentum_drift
from space_envs.dynamics.spheres import link_ends, sphere_gaps
from space_envs.envs import CaptureVectorEnv
from space_envs.errors import ConfigurationError, GoalError
from space_envs.evaluation.records.storage import read_records
from space_envs.policy import PolicyContext
from space_envs.robots.models import SceneOptions, robot_model
from space_envs.robots.zoo import find_robot
from space_envs.tasks.goals import clutter
from space_envs.tasks.single_arm_cluttered import SingleArmClutteredTask

RADIUS = 0.08  # m, of the links
RATE_LIMIT = 0.3  # rad/s, of every joint


# Distances ---------------------------------------------------------------------------------------------


def test_gaps_are_those_of_mujoco_between_capsules_and_spheres():
    rng = np.random.default_rng(0)
    ends = rng.uniform(-1, 1, (20, 3, 3))
    spheres = np.concatenate([rng.uniform(-1.5, 1.5, (20, 2, 3)), rng.uniform(0.1, 0.3, (20, 2, 1))], axis=-1)
    gaps = sphere_gaps(ends, spheres, RADIUS)
    for row in range(20):
        spec = mujoco.MjSpec()
        for link in range(2):
            fromto = [*ends[row, link], *ends[row, link + 1]]
            spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_CAPSULE, fromto=fromto, size=[RADIUS, 0, 0])
        for x, y, z, size in spheres[row]:
            spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, pos=[x, y, z], size=[size, 0, 0])
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        for link in range(2):
            for sphere in range(2):
                found = mujoco.mj_geomDistance(model, data, link, 2 + sphere, 10.0, None)
                assert gaps[row, link, sphere] == pytest.approx(found, abs=1e-9)


def test_gap_to_the_bus_is_that_to_points_of_a_cube():
    rng = np.random.default_rng(1)
    cube = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 21)] * 3), axis=-1).reshape(-1, 3)
    centre, radius = rng.uniform(-1.5, 1.5, (30, 3)), rng.uniform(0.1, 0.3, 30)
    centre[np.abs(centre).max(axis=-1) < 0.6] += 1.0
    brute = np.linalg.norm(centre[:, None] - cube, axis=-1).min(axis=1) - radius
    np.testing.assert_allclose(
        clutter.bus_gaps(SingleArmClutteredTask().contacts, centre, radius), brute, atol=5e-3
    )


def test_sensors_see_spheres_and_links_where_they_are():
    env = make(4, difficulty="hard", variant="physical")
    observation, _ = env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(12):
        observation, *_ = env.step(rng.uniform(-1, 1, (4, 7)))
    read = env.task.layout.read
    goals = [goal for goal in env.episodes.goals if goal is not None]
    position = np.concatenate([goal.obstacle_position for goal in goals])
    radius = np.concatenate([goal.obstacle_radius for goal in goals])
    np.testing.assert_array_equal(read(observation, "obstacle_position"), position.reshape(4, 9))
    np.testing.assert_allclose(read(observation, "obstacle_radius"), radius, rtol=1e-14)
    # The gaps that decide are those of forward kinematics from the observation, from step to step.
    ends = link_ends(
        env.task.mechanics,
        read(observation, "joint_position"),
        read(observation, "base_position"),
        read(observation, "base_quaternion"),
    )
    gap = sphere_gaps(ends, np.concatenate([position, radius[..., None]], axis=-1), RADIUS).min(axis=(1, 2))
    sensors = env.simulation.sensors.copy()
    np.testing.assert_array_equal(env.task.collided(sensors, sensors) > 0, gap <= 0)
    # Spheres grown until they touch, and not quite.
    for more, touched in ((1e-9, True), (-1e-9, False)):
        grown = sensors.copy()
        grown[:, 56:65:3] += (gap + more)[:, None]
        assert ((env.task.collided(grown, grown) > 0) == touched).all()


def test_nothing_is_jumped_over_between_control_steps():
    """Ends of links that pass a small sphere within a period, found as on 401 points of the way."""
    env = make(300)
    env.reset(seed=0)
    rng = np.random.default_rng(2)
    before = env.simulation.sensors.copy()
    after = before.copy()
    contacts = env.task.contacts
    seen = contacts.columns["world"]
    count = (seen.stop - seen.start) // 3
    after[:, seen] += np.repeat(rng.normal(0, 0.15, (300, count, 1)), 3, axis=2).reshape(300, -1)
    # Small spheres close to a point half way along the last link, half way through the period.
    points = [s[:, seen].reshape(300, count, 3) for s in (before, after)]
    middle = 0.25 * sum(
        p[:, contacts.near_others.start[-1]] + p[:, contacts.near_others.end[-1]] for p in points
    )
    centre = middle + rng.normal(0, 0.09, (300, 3))
    before[:, 47:50] = after[:, 47:50] = centre
    before[:, 56:65:3] = after[:, 56:65:3] = 0.02
    found = env.task.collided(before, after) > 0
    spheres = np.concatenate([before[:, 47:56].reshape(300, 3, 3), np.full((300, 3, 1), 0.02)], axis=-1)
    least = np.full(300, np.inf)
    for share in np.linspace(0, 1, 401):
        now = (1 - share) * points[0] + share * points[1]
        gap = contacts.sphere_gaps(now, spheres).min(axis=(1, 2))
        least = np.minimum(least, gap)
    at_ends = (env.task.collided(before, before) + env.task.collided(after, after)) > 0
    assert (found & ~at_ends).sum() > 5  # some are seen in between only
    assert not (found & (least > 0)).any()
    assert not (~found & (least < -8e-3)).any()


# Collisions --------------------------------------------------------------------------------------------


def test_the_straight_way_ends_in_a_collision_which_is_reported():
    indices = np.arange(16)
    env = make(16)
    env.reset(options={"split": "validation", "index": indices})
    robot, scenes, _, _ = scene("paper", "medium", "validation", indices)
    _, rates, _ = minimum_jerk(scenes.start, scenes.end, 10.0, 101)
    ends = np.zeros(16)
    for step in range(1, 101):
        before = env.episodes.outcome.copy()
        state = env.simulation.qpos.copy()
        observation, reward, terminated, truncated, info = env.step(rates[:, step] / RATE_LIMIT)
        new = terminated & (before == 0)
        ends[new] = step
        if new.any():
            assert (info["outcome"][new] == "collision").all()
            assert all(" and obstacle " in told for told in info["collision"][new])
            assert not info["is_success"][new].any() and not truncated[new].any()
            np.testing.assert_array_equal(info["reward_terms"]["failure"][new], -0.5)
        frozen = before != 0
        np.testing.assert_array_equal(env.simulation.qpos[frozen], state[frozen])
        assert (reward[frozen] == 0).all()
    assert (ends > 0).all() and (ends < 100).all()


def test_every_kind_of_end_leaves_later_episodes_alone():
    """next_step starts anew after a collision, same_step in the same step with what was said of it."""
    options = {"split": "validation", "index": 3}
    _, scenes, _, _ = scene("paper", "medium", "validation", np.array([3]))
    _, rates, _ = minimum_jerk(scenes.start, scenes.end, 10.0, 101)
    for mode in ("next_step", "same_step"):
        env = CaptureVectorEnv(ENV_ID, 1, autoreset_mode=mode)
        env.reset(seed=0, options=options)
        for step in range(1, 101):
            _, _, terminated, _, info = env.step(rates[:, step] / RATE_LIMIT)
            if terminated[0]:
                break
        said = info["final_info"] if mode == "same_step" else info
        assert said["outcome"][0] == "collision"
        for _ in range(3):
            _, _, terminated, _, info = env.step(np.zeros((1, 7)))
        assert not terminated[0] and info["outcome"][0] == "running"


def test_a_row_is_the_same_alone_and_among_64():
    indices = np.arange(64)
    _, scenes, _, _ = scene("paper", "hard", "test", indices)
    _, rates, _ = minimum_jerk(scenes.start, scenes.end, 10.0, 101)
    many = make(64, difficulty="hard")
    many.reset(seed=0, options={"split": "test", "index": indices})
    ones = {}
    for row in (0, 17, 63):
        ones[row] = make(1, difficulty="hard")
        ones[row].reset(seed=0, options={"split": "test", "index": row})
    for step in range(1, 80):
        action = rates[:, step] / RATE_LIMIT
        all_of = many.step(action)
        for row, one in ones.items():
            alone = one.step(action[row : row + 1])
            for a, b in zip(alone[:4], all_of[:4], strict=True):
                np.testing.assert_array_equal(a[0], b[row])
            assert alone[4]["outcome"][0] == all_of[4]["outcome"][row]
    assert (all_of[4]["outcome"] == "collision").sum() > 20


def test_copies_keep_the_spheres():
    env = make(3, split="ood")
    env.reset(seed=3)
    copies = [copy.deepcopy(env), pickle.loads(pickle.dumps(env))]
    rng = np.random.default_rng(0)
    for _ in range(20):
        action = rng.uniform(-1, 1, (3, 7))
        expected = env.step(action)
        for other in copies:
            got = other.step(action)
            np.testing.assert_array_equal(got[0], expected[0])
            np.testing.assert_array_equal(got[4]["outcome"], expected[4]["outcome"])
    assert len(np.unique(env.task.layout.read(expected[0], "obstacle_radius"))) == 9


@pytest.mark.parametrize("variant", ["paper", "physical"])
def test_spheres_leave_the_dynamics_of_the_single_arm_alone(variant):
    env = make(8, variant=variant, difficulty="hard")
    plain = gym.make_vec("SpaceCapture/SingleArm-v0", num_envs=8, variant=variant, autoreset_mode="disabled")
    _, _ = env.reset(seed=0), plain.reset(seed=0)
    rng = np.random.default_rng(0)
    qpos, qvel = [env.simulation.qpos.copy()], [env.simulation.qvel.copy()]
    running = np.ones(8, dtype=bool)
    for _ in range(60):
        action = rng.uniform(-1, 1, (8, 7))
        *_, info = env.step(action)
        plain.step(action)
        qpos.append(env.simulation.qpos.copy())
        qvel.append(env.simulation.qvel.copy())
        running &= info["outcome"] == "running"
        np.testing.assert_array_equal(env.simulation.qpos[running], plain.simulation.qpos[running])
    assert running.sum() > 2
    motion = body_motion(env.task.mechanics, np.stack(qpos, axis=1), np.stack(qvel, axis=1))
    assert momentum_drift(motion)[1].max() <= 1e-6


# Options -----------------------------------------------------------------------------------------------

FAR = [3.0, 0.0, 3.0, 3.0, 1.0, 3.0, 3.0, 2.0, 3.0]
GIVEN = {
    "goal_position": [0.0, 1.5, 2.0],
    "goal_quaternion": [1.0, 0.0, 0.0, 0.0],
    "obstacle_position": FAR,
    "obstacle_radius": [0.2, 0.3, 0.25],
}


def test_given_spheres_stand_where_they_are_told():
    env = make(2)
    radius = [[0.2, 0.3, 0.25], [0.1, 0.2, 0.3]]
    observation, info = env.reset(options=GIVEN | {"obstacle_radius": radius})
    read = env.task.layout.read
    np.testing.assert_array_equal(read(observation, "obstacle_position"), np.tile(FAR, (2, 1)))
    np.testing.assert_allclose(read(observation, "obstacle_radius"), radius, rtol=1e-14)
    assert info["split"].tolist() == ["given"] * 2
    single = gym.make(ENV_ID)
    alone, _ = single.reset(options=GIVEN)
    np.testing.assert_array_equal(alone, observation[0])


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"obstacle_position": [0.0, 0.0, 0.6, *FAR[3:]]}, GoalError, "obstacle 1 touches the satellite"),
        (
            {"obstacle_position": [*FAR[:6], -1.0, 0.1, 1.77]},
            GoalError,
            "obstacle 3 touches the arm at the start",
        ),
        ({"obstacle_position": [*FAR[:3], 0.1, 1.6, 2.1, *FAR[6:]]}, GoalError, "obstacle 2 holds the goal"),
        ({"obstacle_radius": [0.2, 0.0, 0.2]}, GoalError, r"must lie in \(0, 1\] m"),
        ({"obstacle_radius": [0.2, -0.1, 0.2]}, GoalError, r"must lie in \(0, 1\] m"),
        ({"obstacle_radius": [0.2, 1.5, 0.2]}, GoalError, r"must lie in \(0, 1\] m"),
        ({"obstacle_radius": [0.2, np.nan, 0.2]}, ConfigurationError, "finite"),
        ({"obstacle_radius": 0.2}, ConfigurationError, r"shape \(3,\) or \(1, 3\), 3 spheres x 1, got \(\)"),
        (
            {"obstacle_position": [0.0, 1.0, 2.0]},
            ConfigurationError,
            r"obstacle_position must have shape \(9,\) or \(1, 9\), 3 spheres x 3, got \(3,\)",
        ),
        ({"obstacle_positon": FAR}, ConfigurationError, "Did you mean 'obstacle_position'"),
        ({"goal_position": [0.0, 9.0, 0.0]}, GoalError, "out of reach"),
        ({"index": 2}, ConfigurationError, "either a goal or a split"),
    ],
)
def test_bad_spheres_are_refused_before_anything_moves(options, error, message):
    env = make(1)
    env.reset(seed=0)
    before = env.simulation.state(0)
    with pytest.raises(error, match=message):
        env.reset(options=GIVEN | options)
    np.testing.assert_array_equal(env.simulation.state(0), before)


def test_a_goal_needs_its_spheres():
    with pytest.raises(
        ConfigurationError, match="^goal_position needs obstacle_position and obstacle_radius too$"
    ):
        make(1).reset(options={name: GIVEN[name] for name in ("goal_position", "goal_quaternion")})


def test_the_model_refuses_fewer_than_no_obstacles():
    with pytest.raises(ConfigurationError, match="must be an integer from 0"):
        SceneOptions(obstacles=-1)
    model = robot_model(find_robot("shyam2020"), SceneOptions(obstacles=2))
    names = [model.body(i).name for i in range(model.nbody)]
    assert names[-2:] == ["obstacle1", "obstacle2"]


# What is drawn, and what is recorded ---------------------------------------------------------------------


def test_drawn_spheres_have_the_size_and_place_of_the_goal():
    task = SingleArmClutteredTask()
    goals = task.goals("test", np.array([4, 9]))
    model = copy.copy(task.render_model)
    data = mujoco.MjData(model)
    for row in range(2):
        task.update_visuals(model, data, goals, row)
        mujoco.mj_forward(model, data)
        for sphere in range(3):
            cage = geoms(model, f"obstacle{sphere + 1}", "keep_out")
            away = data.geom_xpos[cage] - goals.obstacle_position[row, sphere]
            distance, radius = np.linalg.norm(away, axis=1), goals.obstacle_radius[row, sphere]
            np.testing.assert_allclose(away.mean(axis=0), 0.0, atol=1e-12)
            np.testing.assert_allclose(distance, np.cos(np.pi / 24) * radius, rtol=1e-6)  # middles of chords
            np.testing.assert_allclose(np.hypot(distance, model.geom_size[cage, 1]), radius, rtol=1e-6)
            assert model.geom_size[cage, 0].max() < 0.05 * radius  # what lies behind can be seen
            assert not model.geom_contype[cage].any() and not model.geom_conaffinity[cage].any()
    np.testing.assert_allclose(data.sensor("obstacle2_radius").data, [goals.obstacle_radius[1, 1], 0, 0])
    plain = task.model
    for name in ("nq", "nv", "nu", "nsensordata", "nmocap"):
        assert getattr(plain, name) == getattr(model, name)


@pytest.mark.usefixtures("brief_reports")
def test_collisions_are_counted_in_the_records(tmp_path, capsys):
    from agents.commands.evaluate import main
    from agents.policies.registry import policies_for

    names = policies_for(ENV_ID)
    assert {"minimum_jerk", "gjm", "mpc", "promp"} <= set(names) and not {"bc", "ppo"} & set(names)
    arguments = "--policy gjm minimum_jerk hold --episodes 6 --no-pictures".split()
    assert main(["--env", ENV_ID, *arguments, "--jobs", "1", "--output", str(tmp_path)]) == 0
    assert "gjm" in capsys.readouterr().out
    records = read_records(tmp_path / "records.jsonl")
    for record in records:
        assert record.metrics["collisions"] == (record.outcome == "collision")
    assert sum(record.outcome == "collision" for record in records if record.policy == "gjm") >= 4
    # What is planned is refused where it would touch, and what does not move touches nothing.
    assert not any(record.metrics["collisions"] for record in records if record.policy != "gjm")
    assert "clearance" in {record.cause for record in records if record.policy == "minimum_jerk"}


def test_tasks_differ_by_their_spheres_only_where_they_should():
    plain = gym.make("SpaceCapture/SingleArm-v0").unwrapped.task
    ours = SingleArmClutteredTask()
    fields = plain.layout.fields
    assert ours.layout.fields[: len(fields)] == fields
    assert [field.name for field in ours.layout.fields[len(fields) :]] == [
        "obstacle_position",
        "obstacle_radius",
    ]
    assert ours.reward_terms == plain.reward_terms and ours.envelope == plain.envelope
    context = PolicyContext.from_env(make(1))
    assert context.layout == ours.layout
    assert replace(ours, difficulty="easy").goals("test", np.arange(2)).spheres.shape == (2, 3, 4)
