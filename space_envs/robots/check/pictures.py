"""Pictures of a robot at home and with its arms stretched."""

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.dynamics.rotations import Array
from space_envs.errors import RenderingError
from space_envs.robots.check.figures.conditioning import random_configurations
from space_envs.robots.models import SceneOptions, robot_model
from space_envs.robots.robot import Robot
from space_envs.step_limits.motions import mechanics

WIDTH, HEIGHT = 720, 540
SWEEPS, ANGLES = 4, 25  # of each joint in turn, and the angles tried in a sweep


@dataclass(frozen=True, eq=False)
class RobotPicture:
    """A picture (HEIGHT, WIDTH, 3) and what it shows."""

    title: str
    frame: NDArray[np.uint8]


def robot_pictures(robot: Robot) -> tuple[list[RobotPicture], str]:
    """Pictures of a robot, and a note where there are none since this machine cannot draw."""
    from space_envs.rendering import Renderer  # OpenGL may be missing, and is not needed without pictures

    model = robot_model(robot, SceneOptions(visual=True))
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
    first, pictures = 3 if robot.planar else 7, []
    try:
        with Renderer(model, width=WIDTH, height=HEIGHT) as renderer:
            for title, q in (("At home", robot.home), ("Stretched", stretched(robot))):
                data.qpos[first : first + robot.n_joints] = q
                mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
                pictures.append(RobotPicture(title, renderer.render(state)))
    except RenderingError as error:
        return [], f"There are no pictures: {error}"
    return pictures, ""


def stretched(robot: Robot) -> Array:
    """Joint angles (n,) within the ranges that bring the end-effectors farthest from their mounts, rad."""
    q = random_configurations(robot)
    q = q[_distance(robot, q).argmax()]
    for joint in np.tile(np.arange(robot.n_joints), SWEEPS):
        tried = np.tile(q, (ANGLES + 1, 1))
        tried[1:, joint] = np.linspace(*robot.joint_range[joint], ANGLES)
        q = tried[_distance(robot, tried).argmax()]
    return q


def _distance(robot: Robot, q: Array) -> Array:
    """Sum (K,) of the distances of the end-effectors from the first joints of their arms, m."""
    tree, total, first = mechanics(robot), np.zeros(len(q)), 0
    position = tree.kinematics(q).position
    for number, arm in enumerate(robot.arms):
        tool, _ = tree.end_effector_pose(q, number)
        total += np.linalg.norm(tool - position[:, first], axis=-1)
        first += len(arm.links)
    return total
