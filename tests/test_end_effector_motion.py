"""Motion of several end-effectors that leaves the base alone: exact constraints, least change, roll-outs."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from dual_arm_goals import IDS, at_meeting, task_of
from hypothesis import given, settings
from hypothesis import strategies as st

from space_envs.dynamics import FloatingRobot, reactionless, roll_out_base
from space_envs.dynamics.reactionless import (
    EndEffectors,
    axis_rotation,
    end_effectors,
    reach,
    reactionless_projection,
    reactionless_rates,
)
from space_envs.dynamics.rotations import Array, angle_between, exponential, rotate, to_matrix

KINDS = ("planar", "spatial")
every_kind = pytest.mark.parametrize("kind", KINDS)
seeds = st.integers(0, 2**32 - 1)


@cache
def robot_of(kind: str) -> FloatingRobot:
    return task_of(IDS[KINDS.index(kind)]).mechanics


def drawn(kind: str, rng: np.random.Generator, k: int = 3) -> Array:
    """Joint angles (k, n) around home, where nothing is singular."""
    robot = robot_of(kind)
    return robot.home + rng.uniform(-0.4, 0.4, (k, robot.n_joints))


def in_plane(kind: str, vectors: Array) -> Array:
    """Vectors without what does not exist in the plane."""
    return vectors * [1.0, 1.0, 0.0] if kind == "planar" else vectors


def turns(kind: str, vectors: Array) -> Array:
    """Angular velocities without what does not exist in the plane."""
    return vectors * [0.0, 0.0, 1.0] if kind == "planar" else vectors


def asked(kind: str, now: EndEffectors, rng: np.random.Generator, k: int = 3) -> dict[str, Any]:
    """Random arguments of `reactionless_rates` besides the end-effectors and the damping."""
    n = robot_of(kind).n_joints
    turn = np.cross(now.axis, rng.normal(scale=0.1, size=(k, 2, 3)))  # across the approach axes
    return {
        "velocity": in_plane(kind, rng.normal(scale=0.1, size=(k, 2, 3))),
        "angular_velocity": turn if kind == "spatial" else None,
        "base_rate": turns(kind, rng.normal(scale=0.01, size=(k, 3))),
        "posture": rng.normal(scale=0.05, size=(k, n)),
    }


@every_kind
def test_tips_are_the_poses_and_generalised_jacobians_of_each_end_effector(kind: str) -> None:
    robot, q = robot_of(kind), drawn(kind, np.random.default_rng(0))
    now = end_effectors(robot, q)
    for index in range(2):
        position, rotation = robot.end_effector_pose(q, index)
        np.testing.assert_allclose(now.position[:, index], position, atol=1e-12)
        np.testing.assert_allclose(now.axis[:, index], rotation[..., 2], atol=1e-12)
        jacobian = robot.generalized_jacobian(q, index)
        np.testing.assert_allclose(now.linear[:, index], jacobian[:, :3], atol=1e-12)
        np.testing.assert_allclose(now.angular[:, index], jacobian[:, 3:], atol=1e-12)
    np.testing.assert_allclose(now.base_angular, robot.base_map(q)[:, 3:], atol=1e-12)
    # Of any batch shape.
    for name, value in now._asdict().items():
        np.testing.assert_array_equal(getattr(end_effectors(robot, q[1]), name), value[1])


@every_kind
@given(seed=seeds, damping=st.floats(1e-6, 10.0), weight=st.floats(0.01, 10.0), bare=st.booleans())
@settings(max_examples=25, deadline=None)
def test_the_base_turns_exactly_as_asked_whatever_the_damping(
    kind: str, seed: int, damping: float, weight: float, bare: bool
) -> None:
    rng = np.random.default_rng(seed)
    now = end_effectors(robot_of(kind), drawn(kind, rng))
    wanted = asked(kind, now, rng)
    if bare:
        wanted |= {"base_rate": None, "posture": None, "angular_velocity": None}
    rate = reactionless_rates(now, **wanted, damping=damping, weight=weight)
    base = np.zeros((3, 3)) if bare else wanted["base_rate"]
    np.testing.assert_allclose((now.base_angular @ rate[..., None])[..., 0], base, atol=1e-10)


@every_kind
@given(seed=seeds)
@settings(max_examples=25, deadline=None)
def test_with_little_damping_it_is_the_least_solution_of_all_constraints(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    now = end_effectors(robot_of(kind), drawn(kind, rng))
    wanted = asked(kind, now, rng)
    posture = wanted["posture"]
    rate = reactionless_rates(now, **wanted, damping=1e-7)
    for row in range(3):
        rows, right = [now.base_angular[row]], [wanted["base_rate"][row]]
        for index in range(2):
            rows.append(now.linear[row, index])
            right.append(wanted["velocity"][row, index])
            if wanted["angular_velocity"] is not None:
                axis = now.axis[row, index]
                across = np.linalg.svd(axis[None])[2][1:]  # two directions across the axis
                rows.append(across @ now.angular[row, index])
                right.append(across @ wanted["angular_velocity"][row, index])
        matrix, vector = np.concatenate(rows), np.concatenate(right)
        if np.linalg.svd(matrix)[1][: 5 if kind == "planar" else 13].min() < 0.02:
            continue
        # The solution nearest to the posture, by an inverse of the stacked constraints.
        expected = posture[row] + np.linalg.pinv(matrix, rcond=1e-9) @ (vector - matrix @ posture[row])
        np.testing.assert_allclose(rate[row], expected, atol=1e-5)


@every_kind
@given(seed=seeds)
@settings(max_examples=25, deadline=None)
def test_keeping_the_attitude_changes_rates_as_little_as_possible(kind: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    robot = robot_of(kind)
    turning = end_effectors(robot, drawn(kind, rng)).base_angular
    rate = rng.normal(scale=0.1, size=(3, robot.n_joints))
    base = turns(kind, rng.normal(scale=0.01, size=(3, 3)))
    for given_base in (None, base):
        kept = reactionless_projection(turning, rate, given_base)
        left = (turning @ kept[..., None])[..., 0]
        np.testing.assert_allclose(left, 0.0 if given_base is None else given_base, atol=1e-9)
        np.testing.assert_allclose(reactionless_projection(turning, kept, given_base), kept, atol=1e-8)
        # The change lies in the rows of the map: no rate that leaves the base alone is part of it.
        for row in range(3):
            null = np.linalg.svd(turning[row])[2][1 if kind == "planar" else 3 :]
            np.testing.assert_allclose(null @ (kept - rate)[row], 0.0, atol=1e-12)


@given(seed=seeds, angle=st.floats(0.0, np.pi), length=st.integers(1, 5))
@settings(max_examples=50, deadline=None)
def test_axis_turns_are_the_shortest(seed: int, angle: float, length: int) -> None:
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=(length, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    normal = np.cross(axis, rng.normal(size=3))
    normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
    wanted = rotate(exponential(angle * normal), axis)
    turn = axis_rotation(axis, wanted)
    np.testing.assert_allclose(np.linalg.norm(turn, axis=-1), angle, atol=2e-8)
    np.testing.assert_allclose(rotate(exponential(turn), axis), wanted, atol=2e-8)
    np.testing.assert_allclose((turn * axis).sum(axis=-1), 0.0, atol=2e-8)


@pytest.mark.parametrize("axis", [*np.eye(3), *-np.eye(3), np.array([0.6, 0.0, -0.8])])
def test_axis_turn_of_opposite_and_of_equal_axes(axis: Array) -> None:
    axes = np.stack([axis, axis, [0.0, 1.0, 0.0]])
    wanted = np.stack([-axis, axis, [1.0, 0.0, 0.0]])
    turn = axis_rotation(axes, wanted)
    assert np.isfinite(turn).all()
    np.testing.assert_allclose(np.linalg.norm(turn, axis=-1), [np.pi, 0.0, np.pi / 2], atol=1e-12)
    np.testing.assert_allclose(rotate(exponential(turn), axes), wanted, atol=1e-8)


@every_kind
def test_the_motion_that_proves_a_goal_reachable_leaves_the_base_alone(
    kind: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    task = task_of(IDS[KINDS.index(kind)], difficulty="hard")
    robot, goals = task.mechanics, task.goals("test", np.arange(0, 512, 64))
    path = [goals.joint_position]

    def noted(*arguments: Any) -> Array:
        step = reactionless_projection(*arguments)
        path.append(path[-1] + step)
        return step

    monkeypatch.setattr(reactionless, "reactionless_projection", noted)
    _, _, points, axes = at_meeting(task, goals)
    found = reach(robot, goals.joint_position, points, axes)
    np.testing.assert_allclose(path[-1], found.q, atol=1e-12)
    assert np.abs(np.diff(path, axis=0)).max() > 0.02
    # The base by momentum conservation alone, along each straight piece of the way.
    position, quaternion = np.zeros((8, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (8, 1))
    along = np.linspace(0.0, 1.0, 5)[:, None]
    largest = 0.0
    for start, end in zip(path[:-1], path[1:], strict=True):
        rate = np.repeat((end - start)[:, None], 5, axis=1)
        poses = roll_out_base(robot, start[:, None] + along * rate, rate, 0.25, position, quaternion)
        position, quaternion = (pose[:, -1] for pose in poses)
        largest = max(largest, angle_between(quaternion, np.array([1.0, 0.0, 0.0, 0.0])).max())
    assert largest < 1e-3
    # Where that puts the end-effectors is where they were sent.
    origin = robot.centre_of_mass(robot.kinematics(goals.joint_position))
    expected = origin - robot.centre_of_mass(robot.kinematics(found.q))
    np.testing.assert_allclose(position, expected, atol=2e-3)
    hands = (
        position[:, None]
        + (to_matrix(quaternion)[:, None] @ end_effectors(robot, found.q).position[..., None])[..., 0]
    )
    assert np.linalg.norm(hands - points, axis=-1).max() < 4e-3


def test_what_cannot_be_reached_is_not_reached() -> None:
    robot = robot_of("planar")
    far = np.array([[[9.0, 0.0, 0.0], [9.0, 0.5, 0.0]], [[1.5, 0.7, 0.0], [1.5, 1.3, 0.0]]])
    found = reach(robot, np.tile(robot.home, (2, 1)), far)
    assert found.distance[0] > 3.0
    assert (found.angle == 0.0).all() and np.isfinite(found.q).all()
