"""The momentum-level mathematics of the dual-arm robots, and of rotors, against MuJoCo."""

from copy import copy
from functools import cache

import mujoco
import numpy as np
import pytest
from dual_arm_robots import DUAL_ARMS, END_EFFECTORS

from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.bodies import body_motion, momentum_drift
from space_envs.dynamics.rotations import Array
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.robots.models import robot_mechanics, robot_model
from space_envs.robots.zoo import find_robot

ROTORS = ("spatial", "physical")  # the robots whose joints have rotor inertia
EPSILON = 1e-6  # of central differences


@cache
def robot_and_model(name: str) -> tuple[FloatingRobot, SymbolicRobot, mujoco.MjModel]:
    """A dual-arm robot, or the single arm with rotors."""
    robot = find_robot("shyam2020", "physical") if name == "physical" else DUAL_ARMS[name]
    mechanics = robot_mechanics(robot)
    return mechanics, SymbolicRobot(mechanics), robot_model(robot)


@pytest.fixture(params=[*DUAL_ARMS, "physical"])
def name(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture(params=range(4))
def rng(request: pytest.FixtureRequest) -> np.random.Generator:
    return np.random.default_rng(request.param)


def moving(name: str) -> list[int]:
    """Components of a base twist that are not zero by construction, in MuJoCo's order."""
    return [0, 1, 5] if name == "planar" else list(range(6))


class State:
    """A random configuration of a robot in MuJoCo; joints are inside their limits, the target rests."""

    def __init__(self, name: str, rng: np.random.Generator) -> None:
        robot, _, model = robot_and_model(name)
        self.name, self.robot, self.model = name, robot, model
        self.b = len(moving(name))
        self.size = self.b + robot.n_joints
        self.data = mujoco.MjData(model)
        mujoco.mj_resetDataKeyframe(model, self.data, 0)
        pose = rng.normal(size=3 if name == "planar" else 7)
        pose[3:] /= max(np.linalg.norm(pose[3:]), 1e-12)
        self.q = rng.uniform(*robot.range.T)
        self.qdot = rng.normal(size=robot.n_joints)
        self.data.qpos[: len(pose) + robot.n_joints] = [*pose, *self.q]
        mujoco.mj_forward(model, self.data)
        self.turn = self.data.body("satellite").xmat.reshape(3, 3).copy()
        # MuJoCo's base velocity is linear in world axes; slides and hinges have angular ones in z.
        self.to_mujoco = np.eye(self.size)
        self.to_mujoco[: self.b - 3, : self.b - 3] = self.turn[: self.b - 3, : self.b - 3]
        if name == "planar":
            self.to_mujoco[:2, :2] = self.turn[:2, :2]

    def mass(self) -> Array:
        """MuJoCo's mass matrix of the robot, for velocities with all vectors in base axes."""
        full = np.empty((self.model.nv, self.model.nv))
        mujoco.mj_fullM(self.model, self.data, full)
        return self.to_mujoco.T @ full[: self.size, : self.size] @ self.to_mujoco

    def map(self) -> Array:
        """From joint rates to the base's velocity at zero momentum, by MuJoCo's mass matrix."""
        mass = self.mass()
        return -np.linalg.solve(mass[: self.b, : self.b], mass[: self.b, self.b :])

    def set_velocity(self, velocity: Array) -> None:
        """Velocity (b + n) with the base's vectors in base axes."""
        self.data.qvel[:] = 0.0
        self.data.qvel[: self.size] = self.to_mujoco @ velocity
        mujoco.mj_forward(self.model, self.data)


@pytest.mark.parametrize("name", DUAL_ARMS)
def test_momentum_matrices_are_those_of_mujoco(name: str, rng: np.random.Generator) -> None:
    state = State(name, rng)
    robot, symbolic, _ = robot_and_model(name)
    rows, mass = moving(name), state.mass()
    base, coupling = robot.momentum_matrices(state.q)
    np.testing.assert_allclose(base[np.ix_(rows, rows)], mass[: state.b, : state.b], rtol=0, atol=1e-10)
    np.testing.assert_allclose(coupling[rows], mass[: state.b, state.b :], rtol=0, atol=1e-10)
    found = symbolic.momentum_matrices(q=state.q)
    np.testing.assert_allclose(found["base"].full(), base, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found["coupling"].full(), coupling, rtol=0, atol=1e-10)
    base_map = robot.base_map(state.q)
    np.testing.assert_allclose(base_map[rows], state.map(), rtol=0, atol=1e-12)
    still = [row for row in range(6) if row not in rows]
    np.testing.assert_allclose(base_map[still], 0.0, atol=1e-15)  # a planar robot stays in its plane
    twist = symbolic.base_twist(q=state.q, qdot=state.qdot)["twist"]
    np.testing.assert_allclose(np.ravel(twist.full()), base_map @ state.qdot, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", DUAL_ARMS)
def test_end_effector_jacobians_are_those_of_mujoco(name: str, rng: np.random.Generator) -> None:
    state = State(name, rng)
    robot, symbolic, model = robot_and_model(name)
    rows = moving(name)
    for tip, site in enumerate(END_EFFECTORS):
        position, rotation = robot.end_effector_pose(state.q, tip)
        found = state.data.site(site)
        origin = state.data.body("satellite").xpos
        np.testing.assert_allclose(origin + state.turn @ position, found.xpos, rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.turn @ rotation, found.xmat.reshape(3, 3), rtol=0, atol=1e-12)
        linear, angular = np.empty((3, model.nv)), np.empty((3, model.nv))
        mujoco.mj_jacSite(model, state.data, linear, angular, model.site(site).id)
        expected = np.concatenate([state.turn.T @ linear, state.turn.T @ angular])
        expected = expected[:, : state.size] @ state.to_mujoco
        base, arm = robot.end_effector_jacobians(state.q, tip)
        np.testing.assert_allclose(base[:, rows], expected[:, : state.b], rtol=0, atol=1e-12)
        np.testing.assert_allclose(arm, expected[:, state.b :], rtol=0, atol=1e-12)
        other = slice(0, robot.n_joints // 2) if tip else slice(robot.n_joints // 2, None)
        assert not arm[:, other].any()  # an arm does not move the other one
        generalized = robot.generalized_jacobian(state.q, tip)
        found = symbolic.generalized_jacobian(tip)(q=state.q)["jacobian"].full()
        np.testing.assert_allclose(found, generalized, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", DUAL_ARMS)
def test_generalized_jacobians_are_derivatives_of_poses(name: str, rng: np.random.Generator) -> None:
    state = State(name, rng)
    robot, _, model = robot_and_model(name)
    velocity = np.zeros(model.nv)
    velocity[: state.size] = state.to_mujoco @ np.concatenate([state.map() @ state.qdot, state.qdot])
    poses = []
    for step in (-EPSILON, EPSILON):
        data = mujoco.MjData(model)
        data.qpos[:] = state.data.qpos
        mujoco.mj_integratePos(model, data.qpos, velocity, step)
        mujoco.mj_kinematics(model, data)
        poses.append([(data.site(s).xpos.copy(), data.site(s).xmat.reshape(3, 3)) for s in END_EFFECTORS])
    for tip, (behind, ahead) in enumerate(zip(*poses, strict=True)):
        found = robot.generalized_jacobian(state.q, tip) @ state.qdot
        linear = (ahead[0] - behind[0]) / (2 * EPSILON)
        np.testing.assert_allclose(state.turn @ found[:3], linear, rtol=0, atol=1e-7)
        skew = (ahead[1] - behind[1]) / (2 * EPSILON) @ ahead[1].T
        np.testing.assert_allclose(state.turn @ found[3:], skew[[2, 0, 1], [1, 2, 0]], rtol=0, atol=1e-4)


def test_masses_include_the_rotors(name: str, rng: np.random.Generator) -> None:
    state = State(name, rng)
    robot, symbolic, model = robot_and_model(name)
    assert (robot.rotor_inertia > 0).all() == (name in ROTORS)
    rows = [*moving(name), *range(6, 6 + robot.n_joints)]
    mass, b = state.mass(), state.b
    found = symbolic.mass_matrix(q=state.q)["mass"].full()
    np.testing.assert_allclose(found[np.ix_(rows, rows)], mass, rtol=0, atol=1e-10)
    reduced = mass[b:, b:] + mass[b:, :b] @ state.map()
    np.testing.assert_allclose(symbolic.reduced_mass(q=state.q)["mass"].full(), reduced, atol=1e-10)
    # Without rotors it is smaller by exactly these: they have no momentum.
    base, coupling = robot.momentum_matrices(state.q)
    links = found[6:, 6:] - np.diag(robot.rotor_inertia)
    np.testing.assert_allclose(
        reduced - np.diag(robot.rotor_inertia),
        links - coupling.T @ np.linalg.solve(base, coupling),
        atol=1e-10,
    )
    assert np.linalg.eigvalsh(reduced).min() > max(robot.rotor_inertia.min(), 0.01)


def test_kinetic_energy_is_that_of_mujoco(name: str, rng: np.random.Generator) -> None:
    state = State(name, rng)
    robot, symbolic, model = robot_and_model(name)
    twist = np.zeros(6)
    twist[moving(name)] = rng.normal(size=state.b)
    state.set_velocity(np.concatenate([twist[moving(name)], state.qdot]))
    mujoco.mj_energyVel(model, state.data)
    expected = state.data.energy[1]
    found = symbolic.kinetic_energy(q=state.q, qdot=state.qdot, twist=twist)["energy"]
    np.testing.assert_allclose(float(found), expected, rtol=1e-12)
    quaternion = np.empty(4)
    mujoco.mju_mat2Quat(quaternion, state.turn.ravel())
    qpos = np.concatenate([state.data.body("satellite").xpos, quaternion, state.q])
    qvel = np.concatenate([state.turn @ twist[:3], twist[3:], state.qdot])
    motion = body_motion(robot, qpos, qvel)
    np.testing.assert_allclose(motion.kinetic_energy, expected, rtol=1e-12)
    # MuJoCo's momentum has no rotors in it either.
    mujoco.mj_subtreeVel(model, state.data)
    satellite = model.body("satellite").id
    linear = model.body_subtreemass[satellite] * state.data.subtree_linvel[satellite]
    arm = state.data.subtree_com[satellite]
    angular = state.data.subtree_angmom[satellite] + np.cross(arm, linear)
    np.testing.assert_allclose(motion.total, np.concatenate([linear, angular]), rtol=0, atol=1e-9)


def test_inverse_dynamics_is_that_of_mujoco(name: str, rng: np.random.Generator) -> None:
    state = State(name, rng)
    robot, symbolic, model = robot_and_model(name)
    data, b = state.data, state.b
    state.set_velocity(np.concatenate([state.map() @ state.qdot, state.qdot]))
    qddot = rng.normal(size=robot.n_joints)
    full = np.empty((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    # The base's acceleration is what leaves it without a force from outside.
    free = np.linalg.solve(full[:b, :b], -full[:b, b : state.size] @ qddot - data.qfrc_bias[:b])
    data.qacc[:] = 0.0
    data.qacc[: state.size] = [*free, *qddot]
    mujoco.mj_inverse(model, data)
    np.testing.assert_allclose(data.qfrc_inverse[:b], 0.0, atol=1e-9)
    found = symbolic.inverse_dynamics(q=state.q, qdot=state.qdot, qddot=qddot)["torque"].full()[:, 0]
    np.testing.assert_allclose(found, data.qfrc_inverse[b : state.size], rtol=0, atol=1e-8)


def vigorous(name: str, timestep: float, seconds: float = 30.0) -> tuple[Array, Array]:
    """qpos (T, 7 + n) and qvel (T, 6 + n) once a second, under torques that swing every joint about home."""
    robot, symbolic, shared = robot_and_model(name)
    model = copy(shared)
    model.opt.timestep = timestep
    model.jnt_limited[:] = 0  # the drives never let a joint run into its end, which is stiff
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    n, b = robot.n_joints, len(moving(name))
    first = 3 if name == "planar" else 7
    inertia = np.diag(symbolic.reduced_mass(q=robot.home)["mass"].full())
    rate = np.linspace(0.9, 1.7, n)
    states = []
    for step in range(round(seconds / timestep) + 1):
        q = data.qpos[first : first + n]
        if step % round(1 / timestep) == 0:
            mujoco.mj_kinematics(model, data)
            satellite = data.body("satellite")
            qvel = np.zeros(6 + n)
            qvel[[*moving(name), *range(6, 6 + n)]] = data.qvel[: b + n]
            states.append((np.concatenate([satellite.xpos, satellite.xquat, q]), qvel))
        swing = 0.2 * np.cos(rate * timestep * step)
        data.ctrl[:] = inertia * (swing - (q - robot.home) - 0.5 * data.qvel[b : b + n])
        mujoco.mj_step(model, data)
    qpos, qvel = (np.array(part) for part in zip(*states, strict=True))
    return qpos, qvel


@pytest.mark.parametrize("name", DUAL_ARMS)
def test_momentum_drifts_with_the_fourth_power_of_the_step(name: str) -> None:
    robot, _, _ = robot_and_model(name)
    drifts, ratios = [], {}
    for timestep in (0.04, 0.02, 0.01):
        qpos, qvel = vigorous(name, timestep)
        motion = body_motion(robot, qpos, qvel)
        assert np.linalg.norm(motion.linear, axis=-1).max() > 1.0  # N s
        assert np.abs(qvel[:, 6:]).max() > 2.0 * 0.3  # rad/s, twice what the drives do
        drift, ratios[timestep] = momentum_drift(motion)
        drifts.append(float(drift))
    assert (np.log2(np.divide(drifts[:-1], drifts[1:])) > 3.7).all()
    assert ratios[0.02] < 1e-7
