"""Pictures of a robot at home and with its arms stretched."""

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.errors import RenderingError
from space_envs.rendering import Renderer
from space_envs.robots.check.figures.conditioning import random_configurations
from space_envs.robots.inertias import vector
from space_envs.robots.models import SceneOptions, robot_spec
from space_envs.robots.models.drawing import default_view
from space_envs.robots.models.mechanics import robot_mechanics
from space_envs.robots.robot import Robot

WIDTH, HEIGHT = 720, 540
_FARTHER = 1.6  # times as far as at home, from where a stretched robot is seen
SWEEPS, ANGLES = 4, 25  # of each joint in turn, and the angles tried in a sweep


@dataclass(frozen=True, eq=False)
class RobotPicture:
    """A picture (HEIGHT, WIDTH, 3) and what it shows."""

    title: str
    frame: NDArray[np.uint8]


def robot_pictures(robot: Robot) -> tuple[list[RobotPicture], str]:
    """Pictures of a robot, and a note where there are none since this machine cannot draw."""
    poses = (("At home", robot.home, 1.0), ("Stretched", stretched(robot), _FARTHER))
    try:
        return [RobotPicture(title, _drawn(_seen_from(robot, away), q)) for title, q, away in poses], ""
    except RenderingError as error:
        return [], f"There are no pictures: {error}"


def _seen_from(robot: Robot, away: float) -> Robot:
    """The robot with its camera so many times as far away."""
    view = robot.view or default_view(robot)
    position, toward = (np.array(point) for point in view.overview)
    moved = toward + away * (position - toward)
    return replace(robot, view=replace(view, overview=(vector(moved), view.overview[1])))


def _drawn(robot: Robot, q: Array) -> NDArray[np.uint8]:
    """Picture of a robot at joint angles (n,), rad."""
    model = robot_spec(robot, SceneOptions(visual=True)).compile()
    data, first = mujoco.MjData(model), 3 if robot.planar else 7
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[first : first + robot.n_joints] = q
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
    mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
    with Renderer(model, width=WIDTH, height=HEIGHT) as drawing:
        return drawing.render(state)


def stretched(robot: Robot) -> Array:
    """Joint angles (n,) within the ranges that bring the end-effectors farthest from their mounts, rad."""
    q = random_configurations(robot)
    q = q[_distance(robot, q).argmax()]
    for joint in np.tile(np.arange(robot.n_joints), SWEEPS):
        tried = np.tile(q, (ANGLES + 1, 1))
        low, high = robot.joint_range[joint]
        tried[1:, joint] = np.linspace(low, high, ANGLES)
        q = tried[_distance(robot, tried).argmax()]
    return q


def _distance(robot: Robot, q: Array) -> Array:
    """Sum (K,) of the distances of the end-effectors from the first joints of their arms, m."""
    tree, total, first = robot_mechanics(robot), np.zeros(len(q)), 0
    position = tree.kinematics(q).position
    for number, arm in enumerate(robot.arms):
        tool, _ = tree.end_effector_pose(q, number)
        total += np.linalg.norm(tool - position[:, first], axis=-1)
        first += len(arm.links)
    return total
