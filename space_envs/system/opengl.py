"""Choice of the OpenGL backend that draws pictures, made when the first picture is requested.

MuJoCo chooses its backend when it is imported, by the environment variable MUJOCO_GL, and on Linux uses
GLFW by default, which needs a screen. Here the choice is made late and nothing happens on import, so that a
machine without OpenGL runs everything but pictures. A driver can end the process instead of raising an
exception, so that each backend is tried in a process of its own.
"""

import importlib
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import Any

from space_envs.errors import RenderingError

_DISABLED = ("disable", "disabled", "off", "false", "0")
_MODULES = {"egl": "mujoco.egl", "osmesa": "mujoco.osmesa", "glfw": "mujoco.glfw", "cgl": "mujoco.cgl"}
_TRIAL = """
import mujoco
model = mujoco.MjModel.from_xml_string("<mujoco/>")
renderer = mujoco.Renderer(model, 8, 8)
renderer.update_scene(mujoco.MjData(model))
renderer.render()
"""
_TRIAL_SECONDS = 60
_LOADED_BY: set[int] = set()  # processes: this one, or those that it was forked from
_ADVICE = (
    "Everything but pictures works without. On Debian or Ubuntu, `apt-get install libegl1 libgl1-mesa-dri`"
    " draws without a screen (or `libosmesa6` with MUJOCO_GL=osmesa)."
)


def has_screen() -> bool:
    """Whether windows can be opened: always on macOS and Windows, by DISPLAY on Linux."""
    return sys.platform != "linux" or any(map(os.environ.get, ("DISPLAY", "WAYLAND_DISPLAY")))


def backends() -> tuple[str, ...]:
    """Names of the backends to try, in this order; none if MUJOCO_GL disables drawing."""
    chosen = os.environ.get("MUJOCO_GL", "").lower().strip()
    if chosen in _DISABLED:
        return ()
    if chosen in _MODULES:
        return (chosen,)
    if sys.platform == "darwin":
        return ("cgl", "glfw")
    if sys.platform != "linux":
        return ("glfw",)
    return ("glfw", "egl", "osmesa") if has_screen() else ("egl", "osmesa")


@cache
def trial_failure(backend: str) -> str | None:
    """Reason for which a backend failed to draw in a process of its own, or None if it did not."""
    try:
        trial = subprocess.run(
            [sys.executable, "-c", _TRIAL],
            env={**os.environ, "MUJOCO_GL": backend},
            capture_output=True,
            text=True,
            timeout=_TRIAL_SECONDS,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return str(error)
    if trial.returncode == 0:
        return None
    lines = [line.strip() for line in trial.stderr.splitlines() if "Error" in line and line[:1].strip()]
    return lines[-1] if lines else f"the trial ended with status {trial.returncode}"


def find_backend() -> str:
    """Name of a backend that draws; trials are made once per process.

    Raises:
        RenderingError: if there is none; the message has the reason and the packages to install.
    """
    candidates = backends()
    if not candidates:
        raise RenderingError(
            f"pictures are switched off by MUJOCO_GL={os.environ['MUJOCO_GL']}; unset it to draw. {_ADVICE}"
        )
    problems = []
    for backend in candidates:
        problem = trial_failure(backend)
        if problem is None:
            return backend
        problems.append(f"{backend}: {problem}")
    raise RenderingError(f"no OpenGL to draw pictures with ({'; '.join(problems)}). {_ADVICE}")


def missing_gl() -> str | None:
    """Reason for which this machine cannot draw pictures, or None if it can."""
    try:
        find_backend()
    except RenderingError as error:
        return str(error)
    return None


def check_process() -> None:
    """Check that no parent of this process has loaded OpenGL, whose state does not survive a fork.

    Raises:
        RenderingError: if one has.
    """
    if _LOADED_BY and os.getpid() not in _LOADED_BY:
        raise RenderingError(
            "this process was forked from one that had drawn, and cannot draw: OpenGL survives no fork."
            " Start it with multiprocessing's 'spawn' or 'forkserver', or do not draw before the fork."
        )


def check_window() -> None:
    """Check that a window can be opened.

    Raises:
        RenderingError: if it cannot; the message has the reason.
    """
    check_process()
    advice = "Use render_mode='rgb_array', or run where there is a screen."
    if not has_screen():
        raise RenderingError(
            f"no screen for render_mode='human': neither DISPLAY nor WAYLAND_DISPLAY is set. {advice}"
        )
    problem = trial_failure("glfw")
    if problem is not None:
        raise RenderingError(f"no window can be opened for render_mode='human' ({problem}). {advice}")


@contextmanager
def chosen_backend(backend: str) -> Iterator[None]:
    """Set the backend for MuJoCo's C library, which reads MUJOCO_GL when it loads OpenGL's functions."""
    before = os.environ.get("MUJOCO_GL")
    os.environ["MUJOCO_GL"] = backend
    try:
        yield
    finally:
        if before is None:
            del os.environ["MUJOCO_GL"]
        else:
            os.environ["MUJOCO_GL"] = before


def create_context(backend: str, width: int, height: int) -> Any:
    """A MuJoCo GLContext of a backend that `find_backend` has named.

    Raises:
        RenderingError: in a forked child of a process that has loaded OpenGL.
    """
    check_process()
    _LOADED_BY.add(os.getpid())
    return importlib.import_module(_MODULES[backend]).GLContext(width, height)


def _leave_display() -> None:
    """In a forked child, detach MuJoCo's exit handler from the parent's display: it would wait forever."""
    egl = sys.modules.get(_MODULES["egl"])
    if egl is not None:
        egl.EGL_DISPLAY = None  # type: ignore[attr-defined]


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_display)
