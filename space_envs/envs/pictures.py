"""Images and a window of episodes, rendered from their simulation and goals."""

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from space_envs.envs.episodes import EpisodeTracker
from space_envs.envs.keywords import CAMERA, EnvOptions
from space_envs.errors import unknown_name
from space_envs.simulation import Simulation
from space_envs.tasks.base import CaptureTask

if TYPE_CHECKING:
    from space_envs.rendering import Renderer


class Pictures:
    """Renders the episodes of a task; OpenGL is initialised at the first image.

    Raises:
        ConfigurationError: for a camera that the task's model for rendering does not have.
    """

    def __init__(self, task: CaptureTask, options: EnvOptions) -> None:
        if not isinstance(options.camera, str) or options.camera != CAMERA:
            model = task.render_model
            cameras = [model.cam(index).name for index in range(model.ncam)]
            if not isinstance(options.camera, str) or options.camera not in cameras:
                raise unknown_name("camera", options.camera, cameras)
        self._task = task
        self._view: dict[str, Any] = {
            "width": options.width,
            "height": options.height,
            "camera": options.camera,
        }
        self._renderer: Renderer | None = None

    def draw(self, simulation: Simulation, episodes: EpisodeTracker) -> tuple[NDArray[np.uint8], ...]:
        """Images (H, W, 3) of all episodes.

        Raises:
            RenderingError: if this machine cannot render.
        """
        pictures = []
        for row in range(simulation.n):
            renderer = self._prepared(episodes, row)
            pictures.append(renderer.render(simulation.state(row)))
        return tuple(pictures)

    def show(self, simulation: Simulation, episodes: EpisodeTracker) -> None:
        """Show the first episode in a window; errors as in `draw`."""
        self._prepared(episodes, 0).show(simulation.state(0))

    def _prepared(self, episodes: EpisodeTracker, row: int) -> "Renderer":
        """The renderer, with the visuals of a row's goal."""
        if self._renderer is None:
            from space_envs.rendering import Renderer  # images are rare, and OpenGL may be missing

            self._renderer = Renderer(self._task.render_model, **self._view)
        if (goals := episodes.goals[row]) is not None:
            self._task.update_visuals(self._renderer.model, None, goals, 0)
        return self._renderer

    def close(self) -> None:
        """Close the window and release OpenGL."""
        if self._renderer is not None:
            self._renderer.close()
            self._renderer = None
