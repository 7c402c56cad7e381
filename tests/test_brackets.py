"""Brackets of the reaction null space: against CasADi's derivatives and against small loops."""

import casadi as ca
import numpy as np
import pytest

from benchmarks.brackets import bracket_singular_values, null_space
from space_envs.dynamics.symbolic import SymbolicRobot
from space_envs.robots.models import robot_mechanics
from space_envs.robots.zoo import find_robot


@pytest.mark.parametrize("name", ["shyam2020", "panda", "ur10", "shah2013"])
def test_singular_values_against_exact_derivatives(name):
    """Lie brackets of projected fields, differentiated by CasADi: D g f - D f g, projected."""
    robot = robot_mechanics(find_robot(name))
    n, q = robot.n_joints, ca.SX.sym("q", robot.n_joints)
    angular = SymbolicRobot(robot).base_map(q)[3:, :]
    rows = angular[2, :] if find_robot(name).planar else angular
    back = rows.T @ ca.inv(rows @ rows.T)
    projector = ca.SX.eye(n) - back @ rows
    first, second = ca.SX.sym("a", n), ca.SX.sym("b", n)
    fields = projector @ first, projector @ second
    bracket = ca.jtimes(fields[1], q, fields[0]) - ca.jtimes(fields[0], q, fields[1])
    leaving = ca.Function("leaving", [q, first, second], [back @ rows @ bracket])
    rng = np.random.default_rng(1)
    for angles in robot.home + rng.uniform(-0.5, 0.5, (3, n)):
        rank = rows.shape[0]
        basis = null_space(robot.base_map(angles)[3:], rank)
        pairs = zip(*np.triu_indices(n - rank, 1), strict=True)
        columns = [np.array(leaving(angles, basis[:, i], basis[:, j]))[:, 0] for i, j in pairs]
        exact = np.linalg.svd(np.stack(columns, axis=1), compute_uv=False)[:rank]
        np.testing.assert_allclose(bracket_singular_values(robot, angles), exact, rtol=1e-4, atol=1e-8)


def test_a_small_loop_of_null_motions_leaves_the_null_space():
    """The end of a loop along a, b, -a, -b differs from its begin by e^2 [a, b]; the base does not rotate."""
    robot = robot_mechanics(find_robot("shyam2020"))
    size, steps = 2e-2, 40
    basis = null_space(robot.base_map(robot.home)[3:], 3)

    def ended(first, second):
        q = robot.home.copy()
        for vector in (first, second, -first, -second):
            for _ in range(steps):
                slopes = []
                for share in (0.0, 0.5, 0.5, 1.0):
                    at = q + share * size / steps * (slopes[-1] if slopes else 0.0)
                    angular = robot.base_map(at)[3:]
                    slopes.append(vector - np.linalg.pinv(angular) @ (angular @ vector))
                q = q + size / steps * (np.array([1.0, 2.0, 2.0, 1.0]) / 6.0 @ np.array(slopes))
        return (q - robot.home) / size**2

    angular = robot.base_map(robot.home)[3:]
    loops = [ended(basis[:, i], basis[:, j]) for i in range(4) for j in range(i + 1, 4)]
    leaving = np.linalg.pinv(angular) @ angular @ np.stack(loops, axis=1)
    np.testing.assert_allclose(
        np.linalg.svd(leaving, compute_uv=False)[:3], bracket_singular_values(robot, robot.home), rtol=0.05
    )
