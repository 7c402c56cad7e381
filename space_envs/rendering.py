"""Pictures and a window of a simulation, drawn from its state alone."""

import atexit
import copy
import threading
import time
from typing import Any

import mujoco
import numpy as np
from numpy.typing import ArrayLike, NDArray

from space_envs.checks import finite_array
from space_envs.errors import ConfigurationError, RenderingError, positive_integer, unknown_name
from space_envs.system.forking import never_end, notify_after_fork
from space_envs.system.opengl import check_window, chosen_backend, create_context, find_backend, missing_gl

__all__ = ["Renderer", "missing_gl"]

_STATE = mujoco.mjtState.mjSTATE_INTEGRATION
_MAX_GEOMS = 2000
MAX_SIDE = 4096
OVERVIEW = "overview"  # default camera
_WINDOW_SECONDS = 10.0  # time limit for closing a window
_TRAIL_COLOR = np.array([0.35, 0.95, 1.0, 0.9], dtype=np.float32)
_TRAIL_WIDTH = 0.012  # m


class Renderer:
    """Draws states of one model: `render` makes pictures, `show` moves a window.

    OpenGL is initialised at the first image, so constructing a Renderer never fails without it. Threads may
    render one after another: each image acquires and releases the OpenGL context. A forked child cannot use
    the context or window of its parent: it raises a RenderingError.

    Args:
        model: compiled with `SceneOptions(visual=True)`. It is copied.
        width: of pictures, pixels.
        height: of pictures, pixels.
        camera: the model's camera to look through when none is named later; a model without an `overview` is
            then seen as a whole.
        shadows: False draws about twice as fast.

    Raises:
        ConfigurationError: for a size that is not between 1 and 4096, a model without geometry, or a camera
            that the model does not have.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        *,
        width: int = 480,
        height: int = 480,
        camera: str = OVERVIEW,
        shadows: bool = True,
    ) -> None:
        width, height = (
            positive_integer(name, side, largest=MAX_SIDE)
            for name, side in (("width", width), ("height", height))
        )
        self._model = copy.copy(model)
        self._model.vis.global_.offwidth, self._model.vis.global_.offheight = width, height
        self._cameras = {model.cam(index).name: index for index in range(model.ncam)}
        if not model.ngeom:
            raise ConfigurationError(
                "the model has no geometry to draw; compile it with SceneOptions(visual=True)"
            )
        self._camera = self._camera_named(camera)
        self._data = mujoco.MjData(self._model)
        self._state_size = mujoco.mj_stateSize(self._model, _STATE)
        self._view = mujoco.MjrRect(0, 0, width, height)
        self._shadows = shadows
        self._option = mujoco.MjvOption()
        self._scene: mujoco.MjvScene | None = None
        self._gl: Any = None
        self._context: mujoco.MjrContext | None = None
        self._window: Any = None
        self._window_threads: set[threading.Thread] = set()
        self._lock = threading.RLock()
        self._shown: tuple[float, float] = (0.0, 0.0)  # simulated time and clock of the last state shown, s
        notify_after_fork(self)

    def render(
        self, state: ArrayLike, camera: str | None = None, trail: ArrayLike | None = None
    ) -> NDArray[np.uint8]:
        """Draw one state.

        Args:
            state: (S,) the integration state (mjSTATE_INTEGRATION) of the same model, drawn or not.
            camera: name of the camera; None for the one given at the start.
            trail: (K, 3) points in the inertial frame to join by a line, m, such as the end-effector's path.

        Returns:
            (height, width, 3) picture, rows from top to bottom.

        Raises:
            RenderingError: if this machine cannot draw.
            ConfigurationError: for an unknown camera, a state of another size, or a malformed trail.
        """
        view = self._camera if camera is None else self._camera_named(camera)
        points = _points(trail)
        category = int(mujoco.mjtCatBit.mjCAT_ALL)
        picture = np.empty((self._view.height, self._view.width, 3), dtype=np.uint8)
        with self._lock:
            self._place(state)
            scene, context = self._open()
            mujoco.mjv_updateScene(self._model, self._data, self._option, None, view, category, scene)
            draw_trail(scene, points)
            with self._gl.as_current():
                mujoco.mjr_setBuffer(int(mujoco.mjtFramebuffer.mjFB_OFFSCREEN), context)
                mujoco.mjr_render(self._view, scene, context)
                mujoco.mjr_readPixels(picture, None, self._view, context)
        return picture[::-1].copy()  # OpenGL's rows go from bottom to top

    def show(self, state: ArrayLike) -> bool:
        """Show one state in a window, not before its simulated time has passed on the clock.

        Returns:
            Whether the window is open; once the user has closed it, nothing is shown any more.

        Raises:
            RenderingError: if no window can be opened.
            ConfigurationError: for a state of another size.
        """
        if self._window is None:
            check_window()
            self._place(state)
            self._window = self._open_window()
        if not self._window.is_running():
            return False
        with self._window.lock():
            self._place(state)
        self._window.sync()
        time_before, clock_before = self._shown
        ahead = self._data.time - time_before
        if ahead > 0:  # a reset sets the simulated time back
            time.sleep(max(0.0, min(ahead, clock_before + ahead - time.monotonic())))
        self._shown = (self._data.time, time.monotonic())
        return True

    @property
    def model(self) -> mujoco.MjModel:
        """The Renderer's own copy of the model, which may be modified between images."""
        return self._model

    def close(self) -> None:
        """Close the window and the OpenGL context; rendering opens them again."""
        window, self._window = self._window, None
        if window is not None:
            window.close()
            for thread in self._window_threads:
                thread.join(_WINDOW_SECONDS)
            atexit.unregister(self.close)
        context, self._context = self._context, None
        gl, self._gl = self._gl, None
        self._scene = None
        if context is not None:
            with gl.as_current():
                context.free()
        if gl is not None:
            gl.free()

    def __enter__(self) -> "Renderer":
        return self

    def __exit__(self, *details: object) -> None:
        self.close()

    def _camera_named(self, name: str) -> mujoco.MjvCamera:
        view = mujoco.MjvCamera()
        if isinstance(name, str) and name in self._cameras:
            view.type, view.fixedcamid = int(mujoco.mjtCamera.mjCAMERA_FIXED), self._cameras[name]
        elif isinstance(name, str) and name == OVERVIEW:
            mujoco.mjv_defaultFreeCamera(self._model, view)
        else:
            raise unknown_name("camera", name, self._cameras)
        return view

    def _place(self, state: ArrayLike) -> None:
        """Put the bodies, cameras and lights where a state has them."""
        vector = finite_array("state", state, (self._state_size,))
        mujoco.mj_setState(self._model, self._data, vector, _STATE)
        mujoco.mj_kinematics(self._model, self._data)
        mujoco.mj_comPos(self._model, self._data)
        mujoco.mj_camlight(self._model, self._data)

    def after_fork(self) -> None:
        """Set the context and the window aside in a forked child, since they belong to the parent."""
        for opened in (self._window, self._context, self._gl):
            never_end(opened)
        self._window = self._context = self._gl = self._scene = None
        self._lock = threading.RLock()

    def _open(self) -> tuple[mujoco.MjvScene, mujoco.MjrContext]:
        if self._scene is None or self._context is None:
            backend = find_backend()
            try:
                with chosen_backend(backend):
                    self._gl = create_context(backend, self._view.width, self._view.height)
                    with self._gl.as_current():
                        font = mujoco.mjtFontScale.mjFONTSCALE_100.value
                        self._context = mujoco.MjrContext(self._model, font)
            except RenderingError:
                raise
            except Exception as error:  # a driver may raise anything
                self.close()
                raise RenderingError(f"OpenGL ({backend}) could not be opened: {error}") from error
            scene = self._scene = mujoco.MjvScene(self._model, _MAX_GEOMS)
            scene.flags[int(mujoco.mjtRndFlag.mjRND_SHADOW)] = self._shadows
        return self._scene, self._context

    def _open_window(self) -> Any:
        import mujoco.viewer  # it needs GLFW, which images do not

        before = set(threading.enumerate())
        try:
            window = mujoco.viewer.launch_passive(
                self._model, self._data, show_left_ui=False, show_right_ui=False
            )
        except RuntimeError as error:  # macOS needs `mjpython` instead of `python`
            raise RenderingError(f"no window for render_mode='human': {error}") from error
        # The window's thread crashes in a process that ends under it, so `close` waits for it, at exit too.
        self._window_threads = set(threading.enumerate()) - before
        atexit.register(self.close)
        with window.lock():
            window.cam.type, window.cam.fixedcamid = self._camera.type, self._camera.fixedcamid
        self._shown = (self._data.time, time.monotonic())
        return window


def _points(trail: ArrayLike | None) -> NDArray[np.float64]:
    return np.zeros((0, 3)) if trail is None else finite_array("trail", trail, (None, 3))


def draw_trail(scene: mujoco.MjvScene, points: NDArray[np.float64]) -> None:
    """Add a line through points (n, 3) to a scene; the oldest are left out if the scene has no room."""
    points = points[-(scene.maxgeom - scene.ngeom + 1) :]
    capsule = int(mujoco.mjtGeom.mjGEOM_CAPSULE)
    for start, end in zip(points[:-1], points[1:], strict=True):
        geom = scene.geoms[scene.ngeom]
        mujoco.mjv_initGeom(geom, capsule, np.zeros(3), np.zeros(3), np.eye(3).ravel(), _TRAIL_COLOR)
        mujoco.mjv_connector(geom, capsule, _TRAIL_WIDTH, start, end)
        geom.emission = 0.8
        scene.ngeom += 1
