"""shyam2020 reproduced: the demonstrations and vectors that its page draws."""

from xml.etree import ElementTree

import mujoco
import numpy as np

from reproduce.shyam2020.cases import MOST, goal
from reproduce.shyam2020.demonstrated import cover, distance_to_demonstrated
from reproduce.shyam2020.measures import link_vectors
from reproduce.shyam2020.page.demonstrations import NAMES, learned, variations, workspace
from reproduce.shyam2020.page.model import HOME, compiled
from reproduce.shyam2020.page.vectors import vectors
from space_envs.robots.models import robot_model
from space_envs.robots.zoo import find_robot


def test_demonstrations_cover_the_workspace_and_vary_as_they_say():
    found = cover(seed=0, count=24)
    home = np.tile(compiled().end_effector, (8, 1))
    for name in NAMES:
        bands, rows = found.rows(name)
        assert len(rows) == 8
        position = found.made[bands].position[rows]
        assert (found.made[bands].kind[rows] == found.made[bands].kind[rows[0]]).all()
        # All start at the end-effector's place at home.
        np.testing.assert_allclose(found.end_effector[bands][rows, 0], home, atol=1e-9)
        assert np.abs(position[:, 0] - HOME).max() < 1e-12
    assert len(found.goals) == MOST and 0.05 < np.median(distance_to_demonstrated(found)) < 1.0
    bend = {row[0]: float(row[2]) for row in variations(found).rows}
    assert bend[NAMES["task"]] > 2 * bend[NAMES["noise"]]
    assert len(workspace(found).panels) == 3 and ElementTree.fromstring(workspace(found).file.split("?>")[1])
    priors = learned(found, goal(-1), 0).rows
    assert len(priors) == 2 and priors[0][1:] != priors[1][1:]


def test_vectors_of_fig_2_are_those_of_eq_1_and_4_and_of_mujoco():
    model = robot_model(find_robot("shyam2020", "paper"))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[7:] += np.linspace(-0.4, 0.5, 7)
    mujoco.mj_forward(model, data)
    found = link_vectors(data.qpos[7:])
    np.testing.assert_allclose(found.centre[1:], found.centre[:-1] + found.outward[:-1] + found.inward)
    np.testing.assert_allclose(model.body_mass[1:9] @ found.centre, 0.0, atol=1e-9)
    np.testing.assert_allclose(found.centre - found.centre[0], data.xipos[1:9] - data.xipos[1], atol=1e-9)
    np.testing.assert_allclose(found.joint[:7] - found.centre[0], data.xanchor[1:] - data.xipos[1], atol=1e-9)
    drawn = vectors().file
    assert all(f"r{chr(0x2080 + number)}" in drawn for number in range(8))
