"""Home and goal pose as MuJoCo draws them, where there is OpenGL."""

import io

import mujoco
import numpy as np
from PIL import Image

from reproduce.page import Picture, Text
from reproduce.shyam2020.cases import DIFFICULTY, Case
from reproduce.shyam2020.measures import Course
from space_envs.errors import RenderingError
from space_envs.tasks.single_arm import SingleArmTask

WIDTH, HEIGHT = 720, 540  # of each of the two
QUALITY = 88


def poses(case: Case, course: Course) -> Picture | Text:
    """The robot at home and at the end of a motion, whose way is drawn; or why there is no picture."""
    from space_envs.rendering import Renderer  # OpenGL may be missing, and is not needed without pictures

    model = SingleArmTask(difficulty=DIFFICULTY).render_model
    data = mujoco.MjData(model)
    data.mocap_pos[0], data.mocap_quat[0] = case.position, case.quaternion
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
    frames = []
    try:
        with Renderer(model, width=WIDTH, height=HEIGHT, camera="overview") as renderer:
            for row, trail in ((0, None), (-1, course.tip[::10])):
                data.qpos[:] = np.concatenate([course.base[row], course.attitude[row], course.joints[row]])
                mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
                frames.append(renderer.render(state, trail=trail))
    except RenderingError as error:
        return Text((f"There is no picture of the poses: {error}. The drawing below has them.",))
    content = io.BytesIO()
    Image.fromarray(np.concatenate(frames, axis=1)).save(content, format="JPEG", quality=QUALITY)
    return Picture(
        "poses",
        "Home and goal pose",
        "Left: at home. Right: at the goal, with the way of the end-effector along the ProMP's best sample. "
        "Drawn by MuJoCo from the same model that the tables are read from; shapes are ours.",
        "Two renderings of a satellite with a seven-joint arm: at home, and with its end-effector at "
        "the grapple "
        "bar of a piece of debris.",
        content.getvalue(),
    )
