"""What the cameras see: the whole robot, the goal past the gripper, and a planet that is not noise.

By projection and by MuJoCo's rays, so that no OpenGL is needed.
"""

import copy

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from synthetic_results import make_played

from space_envs.evaluation.replay.frames import model_states
from space_envs.evaluation.replay.replay import make_replays
from space_envs.registration import ENTRIES, make_task

Array = NDArray[np.float64]
ASPECTS = (1.0, 4 / 3, 16 / 9)
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
APPROACH = {  # direction in which a hand closes, in the frame of its site
    "SpaceCapture/SingleArm-v0": (0.0, 1.0, 0.0),
    "SpaceCapture/SingleArmCluttered-v0": (0.0, 1.0, 0.0),
    "SpaceCapture/DualArmPlanar-v0": (0.0, 0.0, -1.0),
    "SpaceCapture/DualArmSpatial-v0": (0.0, 0.0, 1.0),
}
ROBOT = np.array([1, 1, 1, 0, 0, 0], dtype=np.uint8)  # geom groups that are shown


def seen_at(model: mujoco.MjModel, data: mujoco.MjData, camera: str, points: Array) -> tuple[Array, Array]:
    """Places (K, 2) of points in a picture, 1 at its upper edge, and their depths (K,) in m."""
    number = model.camera(camera).id
    local = (points - data.cam_xpos[number]) @ data.cam_xmat[number].reshape(3, 3)
    depth = -local[:, 2]
    return local[:, :2] / (depth * np.tan(np.deg2rad(model.cam_fovy[number]) / 2))[:, None], depth


def corners(model: mujoco.MjModel, data: mujoco.MjData) -> Array:
    """Corners (K, 3) of the boxes around everything that is drawn but the world."""
    moving = np.flatnonzero(model.geom_bodyid > 0)
    signs = np.stack(np.meshgrid(*[[-1.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    boxes = model.geom_aabb[moving, None, :3] + signs * model.geom_aabb[moving, None, 3:]
    axes = data.geom_xmat[moving].reshape(-1, 3, 3)
    return (np.einsum("gij,gkj->gki", axes, boxes) + data.geom_xpos[moving, None]).reshape(-1, 3)


@pytest.mark.parametrize("env_id", ENTRIES)
def test_overview_and_chase_show_the_whole_robot_and_its_target_at_every_aspect(env_id: str) -> None:
    played = make_played("hold", episodes=4, env_id=env_id)
    for replay in make_replays(played.task, played.episodes, played.records):
        model = copy.copy(played.task.render_model)
        data = mujoco.MjData(model)
        for state in list(model_states(replay, model))[::40]:  # the target tumbles
            mujoco.mj_setState(model, data, state, STATE)
            mujoco.mj_forward(model, data)
            for camera in ("overview", "chase"):
                places, depth = seen_at(model, data, camera, corners(model, data))
                assert depth.min() > 0.5
                for aspect in ASPECTS:
                    assert np.abs(places / [aspect, 1.0]).max() < 1.0, (camera, aspect)


def end_effectors(model: mujoco.MjModel) -> list[str]:
    names = [model.site(number).name for number in range(model.nsite)]
    return [name for name in names if name.startswith("end_effector")]


def at_home(env_id: str) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """The drawn robot at home, with the target and the obstacles far away."""
    model = make_task(env_id, {}).render_model
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.mocap_pos[:] = 50.0
    if not model.nmocap:
        first = int(model.jnt_qposadr[model.body("target").jntadr[0]])
        data.qpos[first : first + 2] = 50.0
    mujoco.mj_forward(model, data)
    return model, data


def first_hit(model: mujoco.MjModel, data: mujoco.MjData, start: Array, ray: Array) -> float:
    """Distance of what a ray meets, in lengths of the ray; below 0 for nothing."""
    geom = np.zeros(1, dtype=np.int32)
    return mujoco.mj_ray(model, data, start, ray, ROBOT, 0, -1, geom)


@pytest.mark.parametrize("env_id", ENTRIES)
def test_end_effector_cameras_see_the_goal_past_the_gripper(env_id: str) -> None:
    model, data = at_home(env_id)
    for name in end_effectors(model):
        eye, site = data.camera(name).xpos, data.site(name)
        inward = site.xmat.reshape(3, 3) @ APPROACH[env_id]
        ahead = site.xpos + np.outer([0.0, 0.05, 0.1, 0.3, 0.6, 1.0], inward)
        places, depth = seen_at(model, data, name, ahead)
        assert depth.min() > 0 and np.abs(places).max() < 0.9  # also in a square picture
        for point in ahead:
            hit = first_hit(model, data, eye, point - eye)
            assert hit < 0 or hit > 1


@pytest.mark.parametrize("env_id", ENTRIES)
def test_nothing_that_is_drawn_can_be_seen_through(env_id: str) -> None:
    """Translucent things are blended in a wrong order: spheres were over the arm, clouds over the spheres."""
    model = make_task(env_id, {}).render_model
    shown = model.geom_group < 3
    painted = model.geom_matid >= 0
    alpha = np.where(painted, model.mat_rgba[model.geom_matid, 3], model.geom_rgba[:, 3])
    assert shown.any() and (alpha[shown] == 1).all()


@pytest.mark.parametrize("env_id", ENTRIES)
def test_the_planet_is_smooth_and_as_fine_as_a_large_picture(env_id: str) -> None:
    model = make_task(env_id, {}).render_model
    planet = model.geom("planet")
    assert planet.bodyid == 0
    texture = int(model.mat_texid[planet.matid[0], mujoco.mjtTextureRole.mjTEXROLE_RGB])
    height, width, channels = (
        int(sizes[texture]) for sizes in (model.tex_height, model.tex_width, model.tex_nchannel)
    )
    assert min(height, width) >= 1024 and channels == 3
    start = int(model.tex_adr[texture])
    pixels = model.tex_data[start : start + height * width * channels].reshape(height, width, channels)
    grey = pixels.mean(axis=-1)
    steps = [np.abs(np.diff(grey, axis=axis)).mean() for axis in (0, 1)]
    # Independent pixels differ from their neighbours by 1.1 deviations.
    assert grey.std() > 15 and max(steps) < 0.15 * grey.std()
    # Most of the texture lies on the side that the cameras see, with its middle below the origin.
    distance, radius = np.linalg.norm(planet.pos), model.geom_aabb[planet.id, 3]
    mesh = int(planet.dataid[0])
    vertices = slice(model.mesh_vertadr[mesh], model.mesh_vertadr[mesh] + model.mesh_vertnum[mesh])
    first = model.mesh_texcoordadr[mesh]
    coordinates = model.mesh_texcoord[first : first + model.mesh_texcoordnum[mesh]]
    outward = 2 * np.linalg.norm(coordinates - 0.5, axis=1)
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, planet.quat)
    places = model.mesh_vert[vertices] @ turn.reshape(3, 3).T
    up = places @ (-planet.pos) / (radius * distance)
    assert outward[up > radius / distance].max() > 0.75
    assert up[outward < 0.05].max() > 0.999
