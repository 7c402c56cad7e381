"""Home and goal pose as MuJoCo draws them, where there is OpenGL."""

import io

import mujoco
import numpy as np
from PIL import Image

from reproduce.blocks import Picture, Prose
from reproduce.shyam2020.cases import DIFFICULTY, GoalCase
from reproduce.shyam2020.measures import Course
from reproduce.shyam2020.page.text import TEXT
from space_envs.errors import RenderingError
from space_envs.tasks.single_arm import SingleArmTask

WIDTH, HEIGHT = 720, 540  # of each of the two
QUALITY = 88


def poses(case: GoalCase, course: Course) -> Picture | Prose:
    """The robot at home and at the end of a motion, with its path; or why there is no picture."""
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
        return Prose(*TEXT.paragraphs("texts.no_picture", error=error))
    content = io.BytesIO()
    Image.fromarray(np.concatenate(frames, axis=1)).save(content, format="JPEG", quality=QUALITY)
    return Picture("poses", **TEXT.fill("pictures.poses"), jpeg=content.getvalue())
