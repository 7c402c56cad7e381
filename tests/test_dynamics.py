"""The numpy dynamics against MuJoCo, Pinocchio, finite differences and conservation of momentum."""

from dataclasses import FrozenInstanceError, replace

import mujoco
import numpy as np
import pinocchio
import pytest
from dynamics_models import (
    ROBOTS,
    TIMESTEP,
    data_at,
    jacobian_in_base_axes,
    mass_in_base_axes,
    matrix,
    random_state,
    random_tree,
    robot_and_model,
    simulate,
    straight_arm,
)
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from space_envs.dynamics import FloatingRobot, attitude_cost, minimum_jerk, roll_out_base, trajectory_cost
from space_envs.dynamics.reactionless import reactionless_projection
from space_envs.dynamics.rotations import Array, angle_between, exponential, rotate, to_matrix
from space_envs.errors import ConfigurationError, SpaceEnvsError

pytestmark = pytest.mark.filterwarnings("ignore::space_envs.dynamics.NoCompiledCodeWarning")
EPSILON = 1e-5  # of central differences: truncation and rounding are then both near 1e-10
angles = arrays(np.float64, 7, elements=st.floats(-10.0, 10.0))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(11)


@pytest.fixture(params=ROBOTS)
def name(request: pytest.FixtureRequest) -> str:
    return request.param


def test_momentum_matrices_are_those_of_mujoco(name: str, rng: np.random.Generator) -> None:
    robot, model = robot_and_model(name)
    states = [random_state(rng, robot.n_joints) for _ in range(100)]
    base, coupling = robot.momentum_matrices(np.array([state["q"] for state in states]))
    for row, state in enumerate(states):
        mass = mass_in_base_axes(model, data_at(model, state))
        np.testing.assert_allclose(base[row], mass[:6, :6], rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(coupling[row], mass[:6, 6:], rtol=0.0, atol=1e-10)


def test_momentum_is_what_mujoco_sums_over_bodies(name: str, rng: np.random.Generator) -> None:
    robot, model = robot_and_model(name)
    root = int(model.jnt_bodyid[0])
    for _ in range(20):
        state = random_state(rng, robot.n_joints)
        data = data_at(model, state)
        linear = model.body_subtreemass[root] * data.subtree_linvel[root]
        arm = data.subtree_com[root] - state["position"]
        back = matrix(state["quaternion"]).T
        expected = np.concatenate([back @ linear, back @ (data.subtree_angmom[root] + np.cross(arm, linear))])
        momentum = robot.momentum(state["q"], state["qdot"], state["twist"])
        np.testing.assert_allclose(momentum, expected, rtol=0.0, atol=1e-10)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=30, deadline=None)
def test_base_twist_gives_zero_momentum(seed: int) -> None:
    robot, _ = robot_and_model("random tree")
    state = random_state(np.random.default_rng(seed), robot.n_joints)
    free = robot.base_twist(state["q"], state["qdot"])
    np.testing.assert_allclose(robot.momentum(state["q"], state["qdot"], free), 0.0, atol=1e-10)
    np.testing.assert_allclose(robot.base_map(state["q"]) @ state["qdot"], free, atol=1e-12)


def test_end_effectors_are_where_mujoco_has_them(name: str, rng: np.random.Generator) -> None:
    robot, model = robot_and_model(name)
    sites = ("end_effector",) if name == "single arm" else ("left", "right")
    for tip, site in enumerate(sites):
        state = random_state(rng, robot.n_joints)
        data = data_at(model, state)
        position, rotation = robot.end_effector_pose(state["q"], tip)
        turned = matrix(state["quaternion"])
        np.testing.assert_allclose(state["position"] + turned @ position, data.site(site).xpos, atol=1e-12)
        np.testing.assert_allclose(turned @ rotation, data.site(site).xmat.reshape(3, 3), atol=1e-12)
        jacobian = np.concatenate(robot.end_effector_jacobians(state["q"], tip), axis=-1)
        np.testing.assert_allclose(jacobian, jacobian_in_base_axes(model, data, site), atol=1e-12)


def test_kinematics_are_those_of_mujoco(name: str, rng: np.random.Generator) -> None:
    robot, model = robot_and_model(name)
    state = random_state(rng, robot.n_joints)
    data, back = data_at(model, state), matrix(state["quaternion"]).T
    found = robot.kinematics(state["q"])
    for link in range(robot.n_joints):
        body, joint = data.body(f"link{link + 1}"), data.joint(f"joint{link + 1}")
        np.testing.assert_allclose(found.position[link], back @ (body.xpos - state["position"]), atol=1e-12)
        np.testing.assert_allclose(found.com[link], back @ (body.xipos - state["position"]), atol=1e-12)
        np.testing.assert_allclose(found.rotation[link], back @ body.xmat.reshape(3, 3), atol=1e-12)
        np.testing.assert_allclose(found.axis[link], back @ joint.xaxis, atol=1e-12)


def test_arm_jacobian_is_the_derivative_of_the_pose(name: str, rng: np.random.Generator) -> None:
    robot, _ = robot_and_model(name)
    q = rng.uniform(-np.pi, np.pi, robot.n_joints)
    for tip in range(len(robot.end_effector_link)):
        _, jacobian = robot.end_effector_jacobians(q, tip)
        steps = EPSILON * np.eye(robot.n_joints)
        ahead, behind = robot.end_effector_pose(q + steps, tip), robot.end_effector_pose(q - steps, tip)
        linear = (ahead[0] - behind[0]) / (2 * EPSILON)
        np.testing.assert_allclose(jacobian[:3].T, linear, atol=1e-9)
        spin = (ahead[1] - behind[1]) / (2 * EPSILON) @ robot.end_effector_pose(q, tip)[1].T
        np.testing.assert_allclose(jacobian[3:].T, spin[:, [2, 0, 1], [1, 2, 0]], atol=1e-9)


def test_generalized_jacobian_is_the_velocity_along_a_roll_out(name: str, rng: np.random.Generator) -> None:
    robot, _ = robot_and_model(name)
    q, qdot = rng.uniform(-np.pi, np.pi, robot.n_joints), rng.normal(size=robot.n_joints)
    start = random_state(rng, robot.n_joints)
    path = q + np.array([-EPSILON, 0.0, EPSILON])[:, None] * qdot
    rates = np.tile(qdot, (3, 1))
    base, turned = roll_out_base(robot, path, rates, EPSILON, start["position"], start["quaternion"])
    twist = robot.base_twist(q, qdot)
    np.testing.assert_allclose(rotate(turned[1], twist[:3]), (base[2] - base[0]) / (2 * EPSILON), atol=1e-8)
    for tip in range(len(robot.end_effector_link)):
        position, rotation = robot.end_effector_pose(path, tip)
        points, axes = base + rotate(turned, position), to_matrix(turned) @ rotation
        velocity = robot.generalized_jacobian(q, tip) @ qdot
        np.testing.assert_allclose(
            rotate(turned[1], velocity[:3]), (points[2] - points[0]) / (2 * EPSILON), atol=1e-8
        )
        spin = (axes[2] - axes[0]) / (2 * EPSILON) @ axes[1].T
        np.testing.assert_allclose(rotate(turned[1], velocity[3:]), spin[[2, 0, 1], [1, 2, 0]], atol=1e-8)


def as_pinocchio(robot: FloatingRobot) -> pinocchio.Model:
    """The same tree in Pinocchio, whose free flyer has its velocity [v; w] in base axes."""
    model, frames = pinocchio.Model(), []
    for body in range(robot.n_joints + 1):
        if body == 0:
            joint, parent, place = pinocchio.JointModelFreeFlyer(), 0, pinocchio.SE3.Identity()
        else:
            joint = pinocchio.JointModelRevoluteUnaligned(robot.hinge[body - 1])
            parent = frames[robot.parent[body - 1]]
            place = pinocchio.SE3(robot.mounting[body - 1], robot.offset[body - 1])
        frames.append(model.addJoint(parent, joint, place, f"joint{body}"))
        inertia = pinocchio.Inertia(robot.mass[body], robot.com[body], robot.inertia[body])
        model.appendBodyToJoint(frames[-1], inertia, pinocchio.SE3.Identity())
    for tip, link in enumerate(robot.end_effector_link):
        place = pinocchio.SE3(robot.end_effector_mounting[tip], robot.end_effector_offset[tip])
        model.addFrame(pinocchio.Frame(f"tip{tip}", frames[link], place, pinocchio.FrameType.OP_FRAME))
    return model


def test_agrees_with_pinocchio(name: str, rng: np.random.Generator) -> None:
    robot, _ = robot_and_model(name)
    model = as_pinocchio(robot)
    data = model.createData()
    for _ in range(20):
        q = rng.uniform(-np.pi, np.pi, robot.n_joints)
        configuration = np.concatenate([[0, 0, 0, 0, 0, 0, 1], q])
        mass = pinocchio.crba(model, data, configuration)
        base, coupling = robot.momentum_matrices(q)
        np.testing.assert_allclose(base, mass[:6, :6], rtol=0.0, atol=1e-10)
        np.testing.assert_allclose(coupling, mass[:6, 6:], rtol=0.0, atol=1e-10)
        pinocchio.framesForwardKinematics(model, data, configuration)
        for tip in range(len(robot.end_effector_link)):
            frame = data.oMf[model.getFrameId(f"tip{tip}")]
            position, rotation = robot.end_effector_pose(q, tip)
            np.testing.assert_allclose(position, frame.translation, atol=1e-12)
            np.testing.assert_allclose(rotation, frame.rotation, atol=1e-12)


def test_roll_out_follows_a_simulation_at_second_order(name: str, rng: np.random.Generator) -> None:
    robot, model = robot_and_model(name)
    state = random_state(rng, robot.n_joints)
    state["q"], state["qdot"] = robot.home, 0.1 * state["qdot"]
    state["twist"] = robot.base_twist(state["q"], state["qdot"])
    record = simulate(model, state, rng, torque=0.3 if name == "single arm" else 3.0)
    np.testing.assert_allclose(record["momentum"], 0.0, atol=1e-6)
    assert (
        angle_between(record["quaternion"][0], record["quaternion"]).max() > 0.02
    )  # rad: something to follow
    errors = []
    for stride in (8, 16, 32):
        q, qdot = record["q"][::stride], record["qdot"][::stride]
        start = record["position"][0], record["quaternion"][0]
        position, quaternion = roll_out_base(robot, q, qdot, stride * TIMESTEP, *start)
        errors.append(
            (
                np.linalg.norm(position - record["position"][::stride], axis=1).max(),
                angle_between(quaternion, record["quaternion"][::stride]).max(),
            )
        )
    errors = np.array(errors)
    assert (errors[0] < 1e-4).all()  # m and rad, at steps of 40 ms
    assert (np.log2(errors[1:] / errors[:-1]) > 1.9).all()  # the order


def test_roll_out_is_exact_where_the_twist_is_constant(rng: np.random.Generator) -> None:
    robot, _ = robot_and_model("single arm")
    w, v, nodes, dt = np.array([0.0, 0.0, 0.7]), np.array([0.4, 0.0, 0.1]), 50, 0.1
    twist = np.tile(np.concatenate([v, w]), (nodes, 1))
    still = np.zeros((nodes, 7))
    position, quaternion = roll_out_base(robot, still, still, dt, twist=twist)
    angle = 0.7 * dt * np.arange(nodes)
    circle = np.stack(
        [np.sin(angle) * 0.4 / 0.7, (1.0 - np.cos(angle)) * 0.4 / 0.7, 0.1 * angle / 0.7], axis=-1
    )
    np.testing.assert_allclose(position, circle, atol=1e-13)
    np.testing.assert_allclose(quaternion[:, 3], np.sin(angle / 2), atol=1e-13)


def test_roll_out_is_fourth_order_where_the_twist_is_linear(rng: np.random.Generator) -> None:
    robot, _ = robot_and_model("single arm")
    first, second = rng.normal(size=(2, 6))

    def end(nodes: int) -> tuple[Array, Array]:
        twist = first + np.linspace(0.0, 1.0, nodes)[:, None] * (second - first)
        still = np.zeros((nodes, 7))
        position, quaternion = roll_out_base(robot, still, still, 2.0 / (nodes - 1), twist=twist)
        return position[-1], quaternion[-1]

    exact = end(2001)
    errors = [np.linalg.norm(np.concatenate(end(nodes)) - np.concatenate(exact)) for nodes in (21, 41, 81)]
    assert (np.log2(np.divide(errors[:-1], errors[1:])) > 3.8).all()


def test_roll_out_starts_where_it_is_told(rng: np.random.Generator) -> None:
    robot, _ = robot_and_model("single arm")
    start = random_state(rng, 7)
    q, qdot, dt = minimum_jerk(robot.home, robot.home + 0.5, 10.0, 51)
    at_origin = roll_out_base(robot, q, qdot, dt)
    moved = roll_out_base(robot, q, qdot, dt, start["position"], start["quaternion"])
    expected = start["position"] + rotate(start["quaternion"], at_origin[0])
    np.testing.assert_allclose(moved[0], expected, atol=1e-12)
    np.testing.assert_array_equal(moved[1][0], start["quaternion"])


def test_cost_does_not_depend_on_the_sampling_rate(rng: np.random.Generator) -> None:
    robot, _ = robot_and_model("single arm")
    goal = robot.home + rng.uniform(-1.0, 1.0, (10, 7))
    costs = [trajectory_cost(robot, *minimum_jerk(robot.home, goal, 10.0, nodes)) for nodes in (51, 101, 401)]
    np.testing.assert_allclose(costs[0], costs[2], rtol=1e-5)
    np.testing.assert_allclose(costs[1], costs[2], rtol=1e-6)
    # Twice the time, half the rates: eq. 20 with dt is then half, which a bare sum is not.
    slower = trajectory_cost(robot, *minimum_jerk(robot.home, goal, 20.0, 401))
    np.testing.assert_allclose(slower, costs[2] / 2, rtol=1e-9)


def test_cost_of_a_constant_twist() -> None:
    twist = np.tile([3.0, 0.0, 4.0, 0.0, 2.0, 0.0], (2, 10, 1))
    np.testing.assert_allclose(attitude_cost(twist, 0.5, c=3.0), [5.0 * (9 * 4 + 25)] * 2)


@given(angles)
@settings(deadline=None)
def test_reach_is_never_exceeded(q: Array) -> None:
    robot, _ = robot_and_model("single arm")
    assert distance_from_centre(robot, q) <= robot.reach() + 1e-12


def test_reach_is_attained_by_a_straight_arm(rng: np.random.Generator) -> None:
    robot = FloatingRobot.from_model(straight_arm())
    assert distance_from_centre(robot, np.zeros(2)) == pytest.approx(robot.reach(), abs=1e-12)
    # Centre of mass: (10 (-0.1) + 3 0.9 + 2 1.8) / 15, tip at 2.3 m.
    assert robot.reach() == pytest.approx(2.3 - 5.3 / 15, abs=1e-12)
    assert distance_from_centre(robot, np.array([0.0, 0.3])) < robot.reach() - 1e-3


def test_reach_of_either_arm_is_not_exceeded(rng: np.random.Generator) -> None:
    robot, _ = robot_and_model("random tree")
    for tip in (0, 1):
        distances = distance_from_centre(robot, rng.uniform(-np.pi, np.pi, (5000, 6)), tip)
        assert 0.5 * robot.reach(tip) < distances.max() <= robot.reach(tip)


def distance_from_centre(robot: FloatingRobot, q: Array, tip: int = 0) -> Array:
    com = np.concatenate(
        [np.broadcast_to(robot.com[0], (*q.shape[:-1], 1, 3)), robot.kinematics(q).com], axis=-2
    )
    centre = (robot.mass[:, None] * com).sum(axis=-2) / robot.mass.sum()
    return np.linalg.norm(robot.end_effector_pose(q, tip)[0] - centre, axis=-1)


@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=20, deadline=None)
def test_reactionless_projection_is_the_nearest_motion_that_does_not_rotate_the_base(seed: int) -> None:
    robot, _ = robot_and_model("single arm")
    rng = np.random.default_rng(seed)
    q, rate = rng.uniform(-np.pi, np.pi, (4, 7)), rng.normal(size=(4, 7))
    turning = robot.base_map(q)[:, 3:]
    kept = reactionless_projection(turning, rate)
    np.testing.assert_allclose((turning @ kept[..., None])[..., 0], 0.0, atol=1e-8)
    np.testing.assert_allclose(reactionless_projection(turning, kept), kept, atol=1e-5)
    np.testing.assert_allclose(((rate - kept) * kept).sum(axis=1), 0.0, atol=1e-5)  # at right angles


def test_reactionless_projection_of_a_planar_arm_takes_one_direction() -> None:
    robot = FloatingRobot.from_model(straight_arm())
    # As a file with twelve digits may have it: the second axis is not quite parallel to the first.
    askew = np.array([np.zeros(3), [1e-12, -2e-12, 0.0]])
    robot = replace(robot, mounting=robot.mounting @ to_matrix(exponential(askew)))
    q = np.random.default_rng(3).uniform(-np.pi, np.pi, (50, 2))
    projector = reactionless_projection(robot.base_map(q)[:, None, 3:], np.eye(2))
    np.testing.assert_allclose(np.trace(projector, axis1=-2, axis2=-1), 1.0, atol=1e-9)


def test_motion_in_the_reaction_null_space_keeps_the_attitude(rng: np.random.Generator) -> None:
    robot, _ = robot_and_model("single arm")
    desired, dt = rng.normal(size=7), 0.01

    def projected(q: Array) -> Array:
        return reactionless_projection(robot.base_map(q)[3:], desired)

    path, rates = [robot.home], []
    for _ in range(200):
        q = path[-1]
        rates.append(projected(q))
        path.append(q + dt * projected(q + 0.5 * dt * rates[-1]))
    q = np.array(path[:-1])
    _, kept = roll_out_base(robot, q, np.array(rates), dt)
    _, turned = roll_out_base(robot, q, np.tile(desired, (200, 1)), dt)
    assert angle_between(kept[0], kept).max() < 1e-9
    assert angle_between(turned[0], turned).max() > 0.1


def test_results_do_not_depend_on_the_batch(name: str, rng: np.random.Generator) -> None:
    robot, _ = robot_and_model(name)
    q, qdot = rng.uniform(-4.0, 4.0, (2, 2100, robot.n_joints))
    base, coupling = robot.momentum_matrices(q)
    twist = robot.base_twist(q, qdot)
    for rows in (slice(0, 1), slice(5, 2100, 7), slice(2040, 2060)):
        np.testing.assert_array_equal(robot.momentum_matrices(q[rows])[0], base[rows])
        np.testing.assert_array_equal(robot.momentum_matrices(q[rows])[1], coupling[rows])
        np.testing.assert_array_equal(robot.base_twist(q[rows], qdot[rows]), twist[rows])
    np.testing.assert_array_equal(robot.base_twist(q[7], qdot[7]), twist[7])
    grid = robot.base_twist(q.reshape(3, 700, -1), qdot.reshape(3, 700, -1))
    np.testing.assert_array_equal(grid.reshape(-1, 6), twist)
    assert robot.momentum_matrices(q[:0])[1].shape == (0, 6, robot.n_joints)


def test_minimum_jerk_meets_its_ends_at_rest() -> None:
    start, end = np.zeros(2), np.array([[1.0, -2.0], [0.5, 0.0]])
    q, qdot, dt = minimum_jerk(start, end, 4.0, 401)
    assert dt == pytest.approx(0.01)
    np.testing.assert_allclose(q[:, 0], np.zeros((2, 2)))
    np.testing.assert_allclose(q[:, -1], end)
    np.testing.assert_allclose(qdot[:, [0, -1]], 0.0, atol=1e-15)
    np.testing.assert_allclose(np.gradient(q, dt, axis=1)[:, 1:-1], qdot[:, 1:-1], atol=1e-4)
    np.testing.assert_allclose(qdot[:, 200], 1.875 * end / 4.0)  # peak rate of the 3-4-5 polynomial


def test_wrong_input_is_refused_with_what_was_expected() -> None:
    robot, model = robot_and_model("single arm")
    q = np.zeros((5, 7))
    with pytest.raises(
        ConfigurationError, match=r"joint positions must have shape \(\.\.\., 7\), got \(5, 6\)"
    ):
        robot.kinematics(q[:, :6])
    with pytest.raises(ConfigurationError, match="joint rates"):
        robot.base_twist(q, q[:, :6])
    with pytest.raises(ConfigurationError, match="joint rates"):
        robot.momentum(q, q[:, :6], np.zeros(6))
    with pytest.raises(ConfigurationError, match="q and qdot must both have shape"):
        roll_out_base(robot, q, q[:4], 0.1)
    with pytest.raises(ConfigurationError, match="no body named 'moon'"):
        FloatingRobot.from_model(model, "moon")
    with pytest.raises(ConfigurationError, match="no site named 'thumb'"):
        FloatingRobot.from_model(model, end_effectors=("thumb",))
    with pytest.raises(ConfigurationError, match="is not on a link"):
        FloatingRobot.from_model(model, end_effectors=("grapple",))
    with pytest.raises(ConfigurationError, match="not a free-floating base"):
        FloatingRobot.from_model(model, "target")


@pytest.mark.parametrize(
    ("joint", "keyframe", "message"),
    [
        ('<joint type="slide"/>', "home", "one hinge"),
        ('<joint pos="0.1 0 0"/>', "home", "one hinge"),
        ('<joint/><joint axis="1 0 0"/>', "home", "one hinge"),
        ("", "home", "one hinge"),
        ("<joint/>", "away", "no key named 'home'"),
    ],
)
def test_models_of_another_kind_are_refused(joint: str, keyframe: str, message: str) -> None:
    inertial = '<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><body name="satellite"><freejoint/>{inertial}
        <body name="link">{joint}{inertial}<site name="end_effector"/></body></body></worldbody>
        <keyframe><key name="{keyframe}"/></keyframe></mujoco>"""
    )
    with pytest.raises(SpaceEnvsError, match=message):
        FloatingRobot.from_model(model)


def test_robot_is_frozen_and_knows_its_content() -> None:
    robot, model = robot_and_model("random tree")
    with pytest.raises(ValueError, match="read-only"):
        robot.mass[0] = 1.0
    with pytest.raises(FrozenInstanceError):
        robot.mass = np.ones(7)  # pyright: ignore[reportAttributeAccessIssue]
    same = FloatingRobot.from_model(random_tree(np.random.default_rng(20)), "bus", ("left", "right"))
    other = FloatingRobot.from_model(model, "bus", ("right", "left"))
    assert robot.fingerprint == same.fingerprint != other.fingerprint
    np.testing.assert_array_equal(robot.range[:2], [[-9.0, 8.0], [-np.inf, np.inf]])
    np.testing.assert_array_equal(robot.parent, [0, 1, 2, 0, 4, 4])
