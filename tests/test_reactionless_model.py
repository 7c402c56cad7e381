"""Matrices of reactionless manipulation against the momentum-level mathematics, MuJoCo and differences."""

from functools import cache

import mujoco
import numpy as np
import pytest
from dual_arm_robots import DUAL_ARMS, END_EFFECTORS

from agents.planners.dual_arm.prescribed_paths.model import PathModel
from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.reactionless import end_effectors
from space_envs.dynamics.rotations import Array
from space_envs.robots.models import robot_mechanics, robot_model

ROBOTS = DUAL_ARMS | {"other mounts": DUAL_ARMS["planar"].mounted_at(((0.3, 0.4), (-0.2, 0.5)))}
STATES = 6


@cache
def robot_of(name: str) -> FloatingRobot:
    return robot_mechanics(ROBOTS[name])


def states(name: str) -> tuple[FloatingRobot, PathModel, Array, Array]:
    """Random configurations and joint rates (STATES, n)."""
    robot, rng = robot_of(name), np.random.default_rng(3)
    shape = (STATES, robot.n_joints)
    return robot, PathModel.of(robot), rng.uniform(-2.5, 2.5, shape), rng.normal(size=shape)


def reactionless(model: PathModel, q: Array, rate: Array) -> Array:
    """The part of joint rates (n,) that leaves the attitude alone."""
    turning = model(q).task[-model.momenta :]
    return rate - np.linalg.pinv(turning) @ turning @ rate


@pytest.mark.parametrize("name", ROBOTS)
def test_places_and_rows_are_those_of_the_momentum_level(name):
    robot, model, positions, rates = states(name)
    d = model.dimensions
    assert d == (3 if name == "spatial" else 2)
    for q, rate in zip(positions, rates, strict=True):
        at, now = model(q), end_effectors(robot, q)
        centre = robot.centre_of_mass(robot.kinematics(q))
        np.testing.assert_allclose(at.positions, (now.position - centre)[:, :d].ravel(), atol=1e-12)
        # The generalised Jacobian's rows differ by multiples of Ibm~, so they agree on reactionless motion.
        rate = reactionless(model, q, rate)
        np.testing.assert_allclose(
            at.task[: 2 * d] @ rate, (now.linear @ rate)[:, :d].ravel(), atol=1e-10 * np.abs(rate).max()
        )
        angular = now.angular @ rate
        np.testing.assert_allclose(at.angular @ rate, angular.ravel() if d == 3 else angular[:, 2], atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_linear_rows_are_derivatives_of_the_places(name):
    robot, model, positions, _ = states(name)
    step = 1e-5
    for q in positions:
        slopes = [
            (model(q + step * e).positions - model(q - step * e).positions) / (2 * step)
            for e in np.eye(robot.n_joints)
        ]
        np.testing.assert_allclose(model(q).task[: -model.momenta], np.transpose(slopes), atol=1e-8)


@pytest.mark.parametrize("name", ROBOTS)
def test_last_rows_are_the_angular_momentum_about_the_common_centre(name):
    robot, model, positions, rates = states(name)
    for q, rate in zip(positions, rates, strict=True):
        # A base that does not turn, and moves so that there is no linear momentum.
        _, coupling = robot.momentum_matrices(q)
        drift = -(coupling[:3] @ rate) / robot.mass.sum()
        momentum = robot.momentum(q, rate, np.concatenate([drift, np.zeros(3)]))
        np.testing.assert_allclose(momentum[:3], 0.0, atol=1e-9)
        found = model.scale * model(q).task[-model.momenta :] @ rate
        np.testing.assert_allclose(found, momentum[3:] if model.momenta == 3 else momentum[5:], atol=1e-9)


@pytest.mark.parametrize("name", ROBOTS)
def test_reactionless_rates_do_not_rotate_the_base(name):
    robot, model, positions, rates = states(name)
    for q, rate in zip(positions, rates, strict=True):
        kept = reactionless(model, q, rate)
        assert np.abs(robot.base_twist(q, kept)[3:]).max() < 1e-13 * max(np.abs(rate).max(), 1.0) * 100
        assert np.abs(robot.base_twist(q, rate)[3:]).max() > 1e-3


@pytest.mark.parametrize("name", ROBOTS)
def test_mass_gives_the_kinetic_energy_that_mujoco_has(name):
    robot, model, positions, rates = states(name)
    mj = robot_model(ROBOTS[name])
    data = mujoco.MjData(mj)
    home = mj.key_qpos[0]
    joints = [int(mj.jnt_qposadr[mj.joint(mj.actuator(i).name).id]) for i in range(mj.nu)]
    dofs = [int(mj.jnt_dofadr[mj.joint(mj.actuator(i).name).id]) for i in range(mj.nu)]
    base = slice(0, dofs[0])
    for q, rate in zip(positions, rates, strict=True):
        rate = reactionless(model, q, rate)
        twist = robot.base_twist(q, rate)
        data.qpos[:], data.qvel[:] = home, 0.0
        data.qpos[joints], data.qvel[dofs] = q, rate
        data.qvel[base] = twist if model.dimensions == 3 else twist[[0, 1, 5]]
        mujoco.mj_forward(mj, data)
        full = np.empty((mj.nv, mj.nv))
        mujoco.mj_fullM(mj, data, full)
        doubled = data.qvel @ full @ data.qvel
        np.testing.assert_allclose(rate @ model(q).mass @ rate, doubled, rtol=1e-10)


def test_one_model_per_robot_and_no_shared_results():
    robot = robot_of("planar")
    model = PathModel.of(robot)
    again = FloatingRobot.from_model(robot_model(ROBOTS["planar"]), end_effectors=END_EFFECTORS)
    assert PathModel.of(again) is model
    assert PathModel.of(robot_of("other mounts")) is not model
    first = model(robot.home)
    kept = first.task.copy()
    model(robot.home + 0.3)
    np.testing.assert_array_equal(first.task, kept)


def test_compiled_and_symbolic_functions_agree():
    robot, model, positions, _ = states("planar")
    for q in positions:
        expected = [np.array(value) for value in model.symbolic(q)]
        at = model(q)
        np.testing.assert_allclose(at.positions, expected[0].ravel(), atol=1e-14)
        for found, value in zip((at.task, at.angular, at.mass), expected[1:], strict=True):
            np.testing.assert_allclose(found, value, atol=1e-12)
