"""Distances of links, boxes and a moving target, against MuJoCo and brute force."""

from typing import Any

import mujoco
import numpy as np
import pytest
from dual_arm_robots import DUAL_ARMS

from agents.planners.dual_arm.clearance import Links, gaps
from agents.planners.dual_arm.free_paths.nearness import POSE, Nearness, parameters
from agents.planners.dual_arm.surroundings import Surroundings, tumbling_target
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.capsules import box_distance, point_segment, segment_distance
from space_envs.dynamics.rigid_body import tumble
from space_envs.dynamics.rotations import Array, exponential
from space_envs.errors import ConfigurationError
from space_envs.robots.models import robot_mechanics, robot_spec

RADIUS = 0.05
CENTRE = {"planar": np.array([2.0, 1.0, 0.0]), "spatial": np.array([0.0, 1.25, 0.0])}
TURN = {"planar": np.array([0.0, 0.0, 0.4]), "spatial": np.array([0.3, -0.2, 0.5])}
HALF = np.array([0.2, 0.15, 0.25])
BUS = np.full(3, 0.5)
every_kind = pytest.mark.parametrize("kind", DUAL_ARMS)


def robot_of(kind: str) -> FloatingRobot:
    return robot_mechanics(DUAL_ARMS[kind])


def surroundings(kind: str, **changes: Any) -> Surroundings:
    """A target that turns slowly, and in space the satellite."""
    spin, inertia = np.array([0.0, 0.0, 0.02]), np.array([1.0, 2.0, 3.0])
    motion = tumbling_target(CENTRE[kind], exponential(TURN[kind]), spin, inertia)
    settings: dict[str, Any] = {"radius": RADIUS, "target": HALF, "motion": motion, "contact": 0.0}
    settings |= {"bus": BUS if kind == "spatial" else None}
    return Surroundings(**(settings | changes))


def configurations(robot: FloatingRobot, count: int) -> Array:
    random = np.random.default_rng(0)
    return robot.home + random.uniform(-0.7, 0.7, (count, robot.n_joints))


# Shapes -----------------------------------------------------------------------------------------------


def test_segments_are_as_far_apart_as_their_nearest_points() -> None:
    a, b, c, d = np.random.default_rng(0).normal(size=(4, 200, 3))
    d[:20] = c[:20] + 2.0 * (b - a)[:20]  # parallel
    d[20:30] = c[20:30]  # a point
    s = np.linspace(0.0, 1.0, 401)
    way = (a[:, None] + s[:, None] * (b - a)[:, None])[..., None, :]
    brute = np.min([point_segment(way[:, k, 0], c, d) for k in range(401)], axis=0)
    exact = segment_distance(a, b, c, d)
    assert (exact <= brute + 1e-12).all()
    assert (brute - exact).max() < 1e-3
    np.testing.assert_allclose(segment_distance(c, d, b, a), exact, atol=1e-12)


def test_segments_that_cross_touch() -> None:
    x, y = np.array([[1.0, 0.0, 0.0]]), np.array([[0.0, 1.0, 0.0]])
    assert segment_distance(-x, x, -y, y)[0] == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("flat", [False, True])
def test_distance_from_a_box_is_signed_and_least_along_the_segment(flat: bool) -> None:
    a, b = np.random.default_rng(1).normal(size=(2, 300, 3)) * (1.0, 1.0, 0.0 if flat else 1.0)
    half = np.array([0.4, 0.7, 0.5])
    share = np.linspace(0.0, 1.0, 4001)[:, None, None]
    beyond = np.abs(a + share * (b - a)) - half
    outside = np.linalg.norm(np.maximum(beyond, 0.0), axis=-1)
    brute = (outside + np.minimum(beyond.max(axis=-1), 0.0)).min(axis=0)
    exact = box_distance(a, b, half)
    assert (exact <= brute + 1e-7).all()
    assert (brute - exact).max() < 1e-3
    assert (exact < -0.1).any() and (exact > 0.5).any()


# Robots -----------------------------------------------------------------------------------------------


@every_kind
def test_links_run_from_joint_to_joint_and_to_the_end_effector(kind: str) -> None:
    robot, links = robot_of(kind), Links.of(robot_of(kind))
    q = configurations(robot, 5)
    begin, end, _ = links.segments(robot, q)
    for arm in range(2):
        mine = np.flatnonzero(links.arm == arm)
        np.testing.assert_allclose(end[:, mine[:-1]], begin[:, mine[1:]], atol=1e-12)
        np.testing.assert_allclose(end[:, mine[-1]], robot.end_effector_pose(q, arm)[0], atol=1e-12)
        assert links.last[mine].tolist() == [False] * (len(mine) - 1) + [True]
    length = np.linalg.norm(links.end, axis=1)
    assert length.sum() == pytest.approx(6.0 if kind == "planar" else 4.7)


@every_kind
def test_gaps_are_those_that_mujoco_measures_between_the_same_shapes(kind: str) -> None:
    robot, around = robot_of(kind), surroundings(kind)
    links, n = Links.of(robot), robot.n_joints
    spec = robot_spec(DUAL_ARMS[kind])
    names = [f"arm{arm}_link{number}" for arm in (1, 2) for number in range(1, n // 2 + 1)]
    for place, link in enumerate(links.link):
        capsule = spec.body(names[link - 1]).add_geom(name=f"capsule{place}", mass=0.0)
        capsule.type, capsule.size[0] = mujoco.mjtGeom.mjGEOM_CAPSULE, RADIUS
        capsule.fromto = [0.0, 0.0, 0.0, *links.end[place]]
    for body, half in (("satellite", BUS), ("target", HALF)):
        box = spec.body(body).add_geom(name=body, mass=0.0)
        box.type, box.size = mujoco.mjtGeom.mjGEOM_BOX, half
    model = spec.compile()
    data = mujoco.MjData(model)
    q = configurations(robot, 60)
    start, times = robot.home, np.linspace(0.0, 20.0, 60)
    origin = robot.centre_of_mass(robot.kinematics(start))
    centre, attitude = tumbling(kind, times)
    expected = np.empty((60, 3))

    def distance(one: str, other: str) -> float:
        ids = (model.geom(name).id for name in (one, other))
        return mujoco.mj_geomDistance(model, data, *ids, 10.0, None)

    capsules = [f"capsule{place}" for place in range(len(links.link))]
    for row in range(60):
        base = origin - robot.centre_of_mass(robot.kinematics(q[row]))
        set_pose(model, data, "satellite", base, np.array([1.0, 0.0, 0.0, 0.0]))
        set_pose(model, data, "target", centre, attitude[row])
        for name, angle in zip(names, q[row], strict=True):
            data.joint(name.replace("link", "joint")).qpos[0] = angle
        mujoco.mj_kinematics(model, data)
        first = [name for name, arm in zip(capsules, links.arm, strict=True) if arm == 0]
        second = [name for name, arm in zip(capsules, links.arm, strict=True) if arm == 1]
        free = [name for name, order in zip(capsules, links.order, strict=True) if order >= around.standing]
        expected[row] = (
            min(distance(one, other) for one in first for other in second),
            min(distance(name, "satellite") for name in free),
            min(distance(name, "target") for name in capsules),
        )
    measured = gaps(robot, around, times, q, 20.0, start)
    for column, gap in enumerate((measured.arms, measured.bus, measured.target)):
        if column == 1 and kind == "planar":
            assert np.isinf(gap).all()
            continue
        # MuJoCo's depth of overlap is another one, its sign is not.
        apart = expected[:, column] > 0.0
        np.testing.assert_allclose(gap[apart], expected[apart, column], atol=1e-5)
        assert (gap[~apart] < 1e-5).all()
        assert apart.any()
    assert measured.least == measured.each.min()
    name, row = measured.worst()
    assert measured.each[row] == measured.least and measured.row(row).worst()[0] == name


def tumbling(kind: str, times: Array) -> tuple[Array, Array]:
    """Centre (3,) and attitudes (T, 4) of the target of `surroundings`, integrated directly."""
    spin, inertia = np.array([0.0, 0.0, 0.02]), np.array([1.0, 2.0, 3.0])
    return CENTRE[kind], tumble(exponential(TURN[kind]), spin, inertia, times)[0]


def set_pose(
    model: mujoco.MjModel, data: mujoco.MjData, body: str, position: Array, quaternion: Array
) -> None:
    first = int(model.body(body).jntadr[0])
    at = int(model.jnt_qposadr[first])
    if int(model.jnt_type[first]) == int(mujoco.mjtJoint.mjJNT_FREE):
        data.qpos[at : at + 7] = [*position, *quaternion]
    else:
        data.qpos[at : at + 3] = [*position[:2], 2.0 * np.arctan2(quaternion[3], quaternion[0])]


def test_the_gripper_stops_counting_while_it_grapples() -> None:
    robot = robot_of("planar")
    q = robot.home[None]
    tip = robot.end_effector_pose(robot.home, 0)[0]
    elbow = robot.kinematics(robot.home).position[2]
    beside = tip + 0.1 * np.cross([0.0, 0.0, 1.0], tip - elbow)  # 0.1 m beside the tip, on a 1 m link

    def still(times: Array) -> tuple[Array, Array]:
        return np.tile(beside, (len(times), 1)), np.tile([1.0, 0.0, 0.0, 0.0], (len(times), 1))

    around = Surroundings(target=np.full(3, 0.03), motion=still, gripper=0.3, contact=4.0, arms=False)
    gap = [
        gaps(robot, around, np.array([time]), q, 20.0, robot.home).target[0]
        for time in (0.0, 15.9, 17.0, 18.0, 20.0)
    ]
    assert gap[0] == gap[1] < gap[2] < gap[3] == gap[4]
    shares = around.counted(np.array([1.0, 0.2]), np.array([16.0, 17.0, 19.0]), 20.0)
    np.testing.assert_allclose(shares, [[1.0, 1.0], [0.85, 0.25], [0.7, 0.0]])


def test_a_tumbling_target_is_torque_free_forwards_and_backwards() -> None:
    inertia, spin = np.array([1.0, 2.0, 3.0]), np.array([0.05, -0.03, 0.06])
    quaternion, centre = exponential(np.array([0.4, 0.1, -0.3])), np.array([1.0, 2.0, 3.0])
    times = np.array([3.0, 0.0, 8.0, 20.0, 13.7])
    position, attitude = tumbling_target(centre, quaternion, spin, inertia, at=8.0)(times)
    assert (position == centre).all()
    for time, found in zip(times, attitude, strict=True):
        expected = tumble(quaternion, spin, inertia, np.array([time - 8.0]))[0][0]
        np.testing.assert_allclose(found, expected, atol=1e-7)


# What the planner is kept clear by --------------------------------------------------------------------


def nearness_cases(kind: str) -> tuple[FloatingRobot, Nearness, Surroundings, Array, Array]:
    robot = robot_of(kind)
    around = surroundings(kind, margin=0.0, contact=4.0)
    q, times = configurations(robot, 12), np.linspace(0.0, 20.0, 12)
    assert around.motion is not None
    poses = around.motion(times)
    p = parameters(robot, around, robot.home, times, 20.0, poses, 0.6, 2.0)
    assert (p[:, -1] == 2.0).all()
    return robot, Nearness.of(robot, kind == "planar"), around, q, p


def check_nearness(kind: str) -> None:
    robot, nearness, around, q, p = nearness_cases(kind)
    least = gaps(robot, around, np.linspace(0.0, 20.0, 12), q, 20.0, robot.home).each
    random = np.random.default_rng(2)
    for row in range(12):
        pose, shared = p[row, :POSE], p[row, POSE:-1]
        missing, slope = (out.full() for out in nearness.slope(q[row], pose, shared))
        np.testing.assert_array_equal(missing, nearness.missing(q[row], pose, shared).full())
        # Crossing centre lines are no distance for `gaps`; here their overlap has a depth.
        if least[row] > -2.0 * RADIUS:
            assert missing.max() == pytest.approx(max(0.6 - least[row], 0.0), abs=1e-3)
        way = random.normal(size=robot.n_joints)

        def cost(angles: Array, pose: Array = pose, shared: Array = shared) -> float:
            return float((nearness.missing(angles, pose, shared).full() ** 2).sum())

        difference = (cost(q[row] + 1e-5 * way) - cost(q[row] - 1e-5 * way)) / 2e-5
        assert difference == pytest.approx((2.0 * missing[:, 0] @ slope) @ way, rel=2e-3, abs=1e-3)


def test_nearness_agrees_with_gaps_and_its_slope_with_differences() -> None:
    check_nearness("planar")


@pytest.mark.slow
def test_nearness_agrees_with_gaps_in_space() -> None:
    check_nearness("spatial")


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"radius": 0.0}, "radius"),
        ({"margin": -0.1}, "margin"),
        ({"contact": float("nan")}, "contact"),
        ({"bus": [1.0, 2.0]}, "bus"),
        ({"target": [0.1, 0.1, -0.1], "motion": lambda times: None}, "target"),
        ({"target": [0.1, 0.1, 0.1]}, "motion"),
    ],
)
def test_malformed_surroundings_are_refused(settings: dict, message: str) -> None:
    with pytest.raises(ConfigurationError, match=message):
        Surroundings(**settings)
