"""Robots of the zoo: their sources, typed again in `published_robots`, and what works on them."""

import json
from importlib.resources import files

import numpy as np
import pytest
from offenders import assert_none
from published_robots import PUBLISHED
from rollouts import rollout_of

from space_envs.dynamics.rotations import rotate
from space_envs.robots.check.figures.goals import task_of
from space_envs.robots.check.verification import verify
from space_envs.robots.description.plain import robot_from_plain, to_plain
from space_envs.robots.kinematics import tool_poses
from space_envs.robots.robot import Robot
from space_envs.robots.zoo import find_robot

DEGREE = np.deg2rad(0.05)  # rad, sources round joint limits


def single_arms() -> list[tuple[str, Robot]]:
    return [(name, find_robot(name)) for name in PUBLISHED]


def test_masses_and_inertias() -> None:
    for name, robot in single_arms():
        published = PUBLISHED[name]
        masses = [link.inertial.mass for link in robot.links]
        assert masses == pytest.approx(list(published.masses), rel=1e-9), name
        assert robot.satellite.inertial.mass == pytest.approx(published.satellite, rel=1e-9), name
        traces = [sum(link.inertial.moments) for link in robot.links][: len(published.traces)]
        assert traces == pytest.approx(list(published.traces), rel=1e-4), name


def test_plain_values_are_the_same_robots() -> None:
    """As in the files of recorded episodes, which are read without a robot's description."""
    for file in (files("space_envs") / "robots" / "zoo").iterdir():
        if file.name.endswith(".toml"):
            robot = find_robot(file.name.removesuffix(".toml"))
            assert robot_from_plain(json.loads(json.dumps(to_plain(robot)))) == robot


def test_joint_limits() -> None:
    for name, robot in single_arms():
        published = PUBLISHED[name]
        assert np.abs(robot.joint_range - np.deg2rad(published.ranges)).max() < DEGREE, name
        if published.torques:
            assert robot.torque_limit.tolist() == list(published.torques), name


def test_lengths() -> None:
    """The tool is where the vendor's Denavit-Hartenberg parameters say."""
    rng = np.random.default_rng(0)
    for name, robot in single_arms():
        published, origin = PUBLISHED[name], np.array(robot.satellite.box_centre)
        for _ in range(4):
            q = rng.uniform(-2.0, 2.0, robot.n_joints)
            expected = origin + published.mount + published.tool(q)[:3, 3]
            assert np.abs(tool_poses(robot, q)[0].position - expected).max() < 2e-5, name


def test_homes_leave_room_for_goals() -> None:
    """Joint angles of medium goals, 0.6 rad around home, lie within all ranges."""
    for name, robot in [*single_arms(), ("dual_panda", find_robot("dual_panda"))]:
        room = np.minimum(robot.home - robot.joint_range[:, 0], robot.joint_range[:, 1] - robot.home)
        assert room.min() > 0.6, name


def test_the_pandas_face_each_other() -> None:
    """Both hands are before the bus and point at the target between them."""
    robot, panda = find_robot("dual_panda"), find_robot("panda")
    for arm in robot.arms:
        assert [link.inertial for link in arm.links] == [link.inertial for link in panda.links]
    assert robot.target is not None
    for pose in tool_poses(robot, robot.home):
        target = np.array(robot.target.position) - pose.position
        approach = rotate(pose.orientation, np.array([0.0, 0.0, 1.0]))
        assert approach @ target > 0.95 * np.linalg.norm(target)
        assert pose.position[1] - robot.satellite.box_centre[1] > robot.satellite.box[1] + 0.2


@pytest.mark.parametrize("name", [*PUBLISHED, "dual_panda"])
def test_the_physics_holds(name: str) -> None:
    """Momentum in all modes, equal rows, check_env, and mass matrices of independent libraries."""
    robot = find_robot(name)
    assert_none(f"{test.name}: {test.detail}" for test in verify(robot, task_of(robot)) if not test.passed)


@pytest.mark.parametrize("name", PUBLISHED)
def test_medium_goals_are_captured(name: str) -> None:
    """A few test goals; `python -m benchmarks.robots` takes more, and more planners."""
    for policy in ("gjm", "minimum_jerk", "promp_optimal"):
        rollout, _ = rollout_of(policy, 4, robot=name)
        assert rollout.cause.tolist() == [None] * 4, policy
