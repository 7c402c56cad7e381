"""Pictures of captures for the report, drawn from recorded states."""

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from space_envs.errors import RenderingError
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.play.episodes import EpisodeBatch
from space_envs.tasks.base import CaptureTask

FRAMES = 4
WIDTH, HEIGHT = 480, 360


@dataclass(frozen=True, eq=False)
class Still:
    """Picture out of an episode: `time` in s since its start, `frame` (height, width, 3)."""

    time: float
    frame: NDArray[np.uint8]


def capture_pictures(
    task: CaptureTask, episodes: Mapping[LeaderboardEntry, EpisodeBatch]
) -> tuple[dict[LeaderboardEntry, list[Still]], str]:
    """Stills (HEIGHT, WIDTH, 3) of each policy's farthest capture, and a note where there are none."""
    from space_envs.rendering import Renderer  # OpenGL may be missing, and is not needed without pictures

    model = task.render_model
    data = mujoco.MjData(model)
    state = np.empty(mujoco.mj_stateSize(model, mujoco.mjtState.mjSTATE_INTEGRATION))
    pictures: dict[LeaderboardEntry, list[Still]] = {}
    try:
        renderer = Renderer(model, width=WIDTH, height=HEIGHT, camera="overview")
        for entry, played in episodes.items():
            captured = played.outcome == "captured"
            if not captured.any():
                continue
            row = int(np.argmax(np.where(captured, played.position_error[:, 0], -1.0)))
            stills = []
            for step in np.linspace(0, played.length[row], FRAMES).round().astype(int):
                data.qpos[:] = played.scene[row, step]
                task.update_visuals(renderer.model, data, played.goals, row)
                mujoco.mj_getState(model, data, state, mujoco.mjtState.mjSTATE_INTEGRATION)
                stills.append(Still(float(step * task.control_period), renderer.render(state)))
            pictures[entry] = stills
        renderer.close()
    except RenderingError as error:
        return {}, f"There are no pictures: {error}"
    return pictures, "" if pictures else "There are no pictures, since no policy captured anything."
