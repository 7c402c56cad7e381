"""The CasADi functions against numpy, which has another algorithm, and against MuJoCo."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from dynamics_models import ROBOTS, data_at, mass_in_base_axes, random_state, robot_and_model

from space_envs.dynamics import FloatingRobot
from space_envs.dynamics.rotations import Array, exponential, to_matrix
from space_envs.dynamics.symbolic import SymbolicRobot


@cache
def both(name: str) -> tuple[SymbolicRobot, FloatingRobot, mujoco.MjModel]:
    robot, model = robot_and_model(name)
    return SymbolicRobot(robot), robot, model


@pytest.fixture(params=[*ROBOTS, "arm with rotors"])
def name(request: pytest.FixtureRequest) -> str:
    return request.param


def states(name: str) -> list[dict[str, Array]]:
    """Five random states of a robot."""
    return [random_state(np.random.default_rng(seed), both(name)[1].n_joints) for seed in range(5)]


def close(found: object, expected: Array, tolerance: float = 1e-10) -> None:
    np.testing.assert_allclose(np.squeeze(np.asarray(found)), np.squeeze(expected), rtol=0.0, atol=tolerance)


def test_kinematics(name: str) -> None:
    symbolic, robot, _ = both(name)
    for state in states(name):
        found, expected = symbolic.kinematics(q=state["q"]), robot.kinematics(state["q"])
        for field in ("position", "axis", "com"):
            close(found[field], getattr(expected, field).T, 1e-12)
        close(found["rotation"], np.concatenate(list(expected.rotation), axis=1), 1e-12)
        close(found["centre_of_mass"], robot.centre_of_mass(expected)[:, None], 1e-12)


def test_momentum(name: str) -> None:
    symbolic, robot, _ = both(name)
    for state in states(name):
        q, qdot, twist = state["q"], state["qdot"], state["twist"]
        matrices, (base, coupling) = symbolic.momentum_matrices(q=q), robot.momentum_matrices(q)
        close(matrices["base"], base)
        close(matrices["coupling"], coupling)
        close(symbolic.momentum(q=q, qdot=qdot, twist=twist)["momentum"], robot.momentum(q, qdot, twist))


def test_base_motion(name: str) -> None:
    symbolic, robot, _ = both(name)
    for state in states(name):
        q, qdot = state["q"], state["qdot"]
        close(symbolic.base_map(q=q)["base_map"], robot.base_map(q), 1e-12)
        close(symbolic.base_twist(q=q, qdot=qdot)["twist"], robot.base_twist(q, qdot), 1e-12)


def test_end_effectors(name: str) -> None:
    symbolic, robot, _ = both(name)
    for state in states(name):
        for tip in range(len(robot.end_effector_link)):
            found, expected = (
                symbolic.end_effector_pose(tip)(q=state["q"]),
                robot.end_effector_pose(state["q"], tip),
            )
            close(found["position"], expected[0], 1e-12)
            close(found["rotation"], expected[1], 1e-12)
            jacobian = symbolic.generalized_jacobian(tip)(q=state["q"])["jacobian"]
            close(jacobian, robot.generalized_jacobian(state["q"], tip), 1e-12)


def test_mountings_next_to_a_quarter_turn_are_kept() -> None:
    _, robot, _ = both("single arm")
    askew = to_matrix(exponential(np.array([1e-6, 2e-6, -1e-6])))
    robot = replace(robot, mounting=robot.mounting @ askew)
    state = random_state(np.random.default_rng(0), 7)
    found = SymbolicRobot(robot).base_twist(q=state["q"], qdot=state["qdot"])["twist"]
    close(found, robot.base_twist(state["q"], state["qdot"]), 1e-12)


def test_masses_and_energy(name: str) -> None:
    symbolic, _, model = both(name)
    for state in states(name):
        mass = mass_in_base_axes(model, data_at(model, state))
        close(symbolic.mass_matrix(q=state["q"])["mass"], mass)
        reduced = mass[6:, 6:] - mass[6:, :6] @ np.linalg.solve(mass[:6, :6], mass[:6, 6:])
        close(symbolic.reduced_mass(q=state["q"])["mass"], reduced)
        velocity = np.concatenate([state["twist"], state["qdot"]])
        energy = symbolic.kinetic_energy(q=state["q"], qdot=state["qdot"], twist=state["twist"])["energy"]
        close(energy, 0.5 * velocity @ mass @ velocity, 1e-9)


def test_inverse_dynamics(name: str) -> None:
    symbolic, robot, model = both(name)
    for state in states(name):
        q, qdot = state["q"], state["qdot"]
        state = {**state, "twist": robot.base_twist(q, qdot)}
        qddot = np.random.default_rng(1).normal(size=robot.n_joints)
        data = data_at(model, state)
        mass = np.empty((model.nv, model.nv))
        mujoco.mj_fullM(model, data, mass)
        # The base's acceleration is what leaves it without a force from outside.
        free = np.linalg.solve(mass[:6, :6], -mass[:6, 6:] @ qddot - data.qfrc_bias[:6])
        expected = mass[6:] @ np.concatenate([free, qddot]) + data.qfrc_bias[6:]
        found = symbolic.inverse_dynamics(q=q, qdot=qdot, qddot=qddot)["torque"]
        close(found, expected, 1e-9)
