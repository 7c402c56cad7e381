"""Videos of replays."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from space_envs.errors import ConfigurationError, RenderingError
from space_envs.evaluation.play.entry import LeaderboardEntry
from space_envs.evaluation.replay.frames import model_states
from space_envs.evaluation.replay.replay import Replay
from space_envs.system.files import atomic_write

WIDTH, HEIGHT = 960, 720  # of videos


def write_videos(
    targets: Mapping[LeaderboardEntry, tuple[Replay, Path]],
) -> tuple[dict[LeaderboardEntry, Path], str]:
    """Write an mp4 of each entry's replay; where this machine cannot, say why in one sentence."""
    written: dict[LeaderboardEntry, Path] = {}
    for entry, (replay, path) in tqdm(targets.items(), unit="video", desc="videos", leave=False):
        try:
            write_video(replay, path)
        except (RenderingError, ConfigurationError) as error:
            return written, f"There are no videos: {error}"
        written[entry] = path
    return written, ""


def write_video(replay: Replay, path: str | Path, camera: str = "overview") -> None:
    """Write a replay as an mp4, or as a gif where the path ends so, in real time, drawn by MuJoCo.

    Raises:
        RenderingError: if this machine cannot draw.
        ConfigurationError: for an unknown camera, or if there is no encoder (imageio with imageio-ffmpeg).
    """
    import imageio.v3 as iio  # neither it nor OpenGL is needed for anything but videos

    from space_envs.rendering import Renderer

    rate = round(1.0 / replay.task.control_period)
    width, height = WIDTH, HEIGHT
    coded: dict[str, Any] = {"fps": rate, "codec": "libx264", "macro_block_size": None}
    if Path(path).suffix == ".gif":
        width, height = WIDTH // 2, HEIGHT // 2  # a gif of the same size is seventy times an mp4
        coded = {"duration": 1000.0 / rate, "loop": 0}  # ms a picture; for ever
    with Renderer(replay.task.render_model, width=width, height=height, camera=camera) as renderer:
        frames = [renderer.render(state) for state in model_states(replay, renderer.model)]
    with atomic_write(path) as temporary:
        try:
            iio.imwrite(temporary, np.stack(frames), **coded)
        except (ImportError, OSError) as error:
            raise ConfigurationError(
                f"no {temporary.suffix[1:]} can be written ({error}); pip install imageio-ffmpeg"
            ) from error
