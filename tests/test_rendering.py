"""Pictures where the machine can draw them, and a plain reason where it cannot."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from mujoco import viewer

from space_envs import rendering
from space_envs.errors import ConfigurationError, RenderingError
from space_envs.rendering import Renderer, missing_gl
from space_envs.robots.models import SceneOptions, robot_model
from space_envs.robots.zoo import find_robot
from space_envs.system import opengl

ROBOT = find_robot("shyam2020")
STATE = mujoco.mjtState.mjSTATE_INTEGRATION
WITHOUT_GL = """
import gymnasium as gym, numpy as np, space_envs
from space_envs.errors import RenderingError
env = gym.make("SpaceCapture/SingleArm-v0", render_mode="rgb_array").unwrapped
env.reset(seed=0)
observation, *_ = env.step(env.action_space.sample() * 0)
assert np.isfinite(observation).all()
try:
    env.render()
except RenderingError as error:
    print(error)
env.step(env.action_space.sample() * 0)
env.close()
"""


def drawn_model() -> mujoco.MjModel:
    return robot_model(ROBOT, SceneOptions(visual=True))


def home_state(first_joint: float = 0.0, seconds: float = 0.0) -> np.ndarray:
    """State of the model without geometry, as the simulation holds it."""
    model = robot_model(ROBOT)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[7] += first_joint
    data.time = seconds
    state = np.empty(mujoco.mj_stateSize(model, STATE))
    mujoco.mj_getState(model, data, state, STATE)
    return state


@pytest.fixture
def renderer() -> Iterator[Renderer]:
    with Renderer(drawn_model(), width=160, height=120) as made:
        yield made


def test_a_picture_or_the_reason_why_not(renderer: Renderer) -> None:
    reason = missing_gl()
    if reason is not None:
        with pytest.raises(RenderingError, match="libegl1"):
            renderer.render(home_state())
        return
    picture = renderer.render(home_state())
    assert picture.shape == (120, 160, 3)
    assert picture.dtype == np.uint8
    # The planet fills the lower half, black sky the upper one.
    assert picture[80:].mean() > 2 * picture[:30].mean()
    assert picture[80:, :, 2].mean() > picture[80:, :, 0].mean()
    # The same state gives the same picture, another pose, camera or trail another one.
    np.testing.assert_array_equal(renderer.render(home_state()), picture)
    assert (renderer.render(home_state(0.5)) != picture).mean() > 0.005
    assert (renderer.render(home_state(), camera="chase") != picture).mean() > 0.2
    assert (renderer.render(home_state(), camera="end_effector") != picture).mean() > 0.2
    trail = np.linspace([0, -0.5, 2.5], [0, 2.0, 2.5], 30)
    assert (renderer.render(home_state(), trail=trail) != picture).any(axis=-1).sum() > 40
    np.testing.assert_array_equal(renderer.render(home_state(), trail=trail[:1]), picture)


def test_shadows_are_a_choice() -> None:
    pictures = []
    for shadows in (True, False):
        with Renderer(drawn_model(), width=160, height=120, shadows=shadows) as made:
            if missing_gl() is not None:
                with pytest.raises(RenderingError):
                    made.render(home_state())
                return
            pictures.append(made.render(home_state()).astype(int))
    assert pictures[1].sum() > pictures[0].sum()


def test_the_context_is_opened_late_once_and_again_after_close(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    if missing_gl() is not None:
        with pytest.raises(RenderingError):
            renderer.render(home_state())
        return
    opened = []
    create = rendering.create_context
    monkeypatch.setattr(rendering, "create_context", lambda *a: opened.append(a) or create(*a))
    before = os.environ.get("MUJOCO_GL")
    for _ in range(3):
        renderer.render(home_state())
    assert len(opened) == 1
    assert os.environ.get("MUJOCO_GL") == before
    renderer.close()
    renderer.close()
    renderer.render(home_state())
    assert len(opened) == 2


def test_two_renderers_do_not_disturb_each_other(renderer: Renderer) -> None:
    if missing_gl() is not None:
        with pytest.raises(RenderingError):
            renderer.render(home_state())
        return
    alone = renderer.render(home_state())
    with Renderer(drawn_model(), width=64, height=64, camera="chase") as other:
        other.render(home_state())
        np.testing.assert_array_equal(renderer.render(home_state()), alone)
    np.testing.assert_array_equal(renderer.render(home_state()), alone)


def test_without_gl_the_environment_runs_and_says_what_is_missing() -> None:
    environment = {**os.environ, "MUJOCO_GL": "disable"}
    done = subprocess.run([sys.executable, "-c", WITHOUT_GL], env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert "MUJOCO_GL=disable" in done.stdout
    assert "libegl1" in done.stdout


@pytest.mark.parametrize(
    ("trial", "seconds", "message"),
    [
        ("import os; os.abort()", 60, "egl: the trial ended with status -6"),
        ("raise ImportError('no such driver')", 60, "egl: ImportError: no such driver"),
        ("import time; time.sleep(30)", 0.3, "timed out"),
    ],
)
def test_a_driver_that_fails_is_reported(
    trial: str,
    seconds: float,
    message: str,
    renderer: Renderer,
    fresh_trials: None,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("MUJOCO_GL", "egl")
    monkeypatch.setattr(opengl, "_TRIAL", trial)
    monkeypatch.setattr(opengl, "_TRIAL_SECONDS", seconds)
    with pytest.raises(RenderingError, match=message) as caught:
        renderer.render(home_state())
    assert "apt-get install libegl1 libgl1-mesa-dri" in str(caught.value)
    assert missing_gl() == str(caught.value)


@pytest.mark.parametrize(
    ("platform", "variables", "expected"),
    [
        ("linux", {}, ("egl", "osmesa")),
        ("linux", {"DISPLAY": ":0"}, ("glfw", "egl", "osmesa")),
        ("linux", {"WAYLAND_DISPLAY": "wayland-0", "MUJOCO_GL": "EGL"}, ("egl",)),
        ("linux", {"MUJOCO_GL": "off"}, ()),
        ("darwin", {}, ("cgl", "glfw")),
        ("win32", {}, ("glfw",)),
    ],
)
def test_the_backends_that_are_tried(
    platform: str, variables: dict[str, str], expected: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "MUJOCO_GL"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(opengl.sys, "platform", platform)
    assert opengl.backends() == expected


def test_no_window_without_a_screen(
    renderer: Renderer, fresh_trials: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opengl.sys, "platform", "linux")
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(RenderingError, match="no screen"):
        renderer.show(home_state())
    monkeypatch.setenv("DISPLAY", ":9999")
    monkeypatch.setattr(opengl, "_TRIAL", "raise RuntimeError('cannot connect')")
    with pytest.raises(RenderingError, match="cannot connect"):
        renderer.show(home_state())


def test_the_window_follows_the_clock_until_it_is_closed(
    renderer: Renderer, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[float] = []
    window: Any = SimpleNamespace(cam=SimpleNamespace(), open=True, lock=nullcontext, closed=0)
    window.is_running = lambda: window.open

    def launch(model: mujoco.MjModel, data: mujoco.MjData, **_: bool) -> Any:
        window.sync = lambda: seen.append(float(data.qpos[7]))
        window.close = lambda: setattr(window, "closed", window.closed + 1)
        return window

    monkeypatch.setattr(rendering, "check_window", lambda: None)
    monkeypatch.setattr(viewer, "launch_passive", launch)
    start = time.monotonic()
    for step in range(4):
        assert renderer.show(home_state(0.1 * step, seconds=0.1 * step))
    assert time.monotonic() - start >= 0.3
    assert renderer.show(home_state(0.7, seconds=0.0))  # a reset does not wait
    np.testing.assert_allclose(seen, [0.0, 0.1, 0.2, 0.3, 0.7])
    window.open = False
    assert not renderer.show(home_state())
    assert len(seen) == 5
    renderer.close()
    renderer.close()
    assert window.closed == 1


def test_bad_input_is_refused(renderer: Renderer) -> None:
    model = drawn_model()
    with pytest.raises(ConfigurationError, match="unknown camera 'overveiw'.*Did you mean 'overview'"):
        Renderer(model, camera="overveiw")
    with pytest.raises(ConfigurationError, match="unknown camera"):
        renderer.render(home_state(), camera="none")
    for size in (0, -1, 5000, 1.5, True, "9", 10**400, np.zeros(2)):
        with pytest.raises(ConfigurationError, match="width must be a positive integer"):
            Renderer(model, width=size)  # type: ignore[arg-type]
    with pytest.raises(ConfigurationError, match="visual=True"):
        Renderer(robot_model(ROBOT))
    for state in (home_state()[:-1], home_state() * np.nan, "a", [[1.0], [2.0, 3.0]], None, [10**400]):
        with pytest.raises(ConfigurationError, match="state must be"):
            renderer.render(state)  # type: ignore[arg-type]
    for trail in (
        np.zeros(3),
        np.zeros((2, 2)),
        np.full((2, 3), np.nan),
        "a",
        [[1.0], [2.0, 3.0]],
        [["1"] * 3],
    ):
        with pytest.raises(ConfigurationError, match="trail must be"):
            renderer.render(home_state(), trail=trail)  # type: ignore[arg-type]
    for camera in ([], 3, np.zeros(2)):
        with pytest.raises(ConfigurationError, match="unknown camera"):
            renderer.render(home_state(), camera=camera)  # type: ignore[arg-type]


def test_a_long_trail_keeps_its_end(renderer: Renderer) -> None:
    scene = mujoco.MjvScene(drawn_model(), 10)
    points = np.linspace([0, 0, 0], [0, 0, 30], 31)
    rendering.draw_trail(scene, points)
    assert scene.ngeom == 10
    np.testing.assert_allclose(scene.geoms[9].pos, [0, 0, 29.5], atol=1e-5)
    np.testing.assert_allclose(scene.geoms[0].pos, [0, 0, 20.5], atol=1e-5)
    rendering.draw_trail(scene, points)  # a full scene takes no more
    assert scene.ngeom == 10


def test_threads_draw_in_turn(renderer: Renderer) -> None:
    if missing_gl() is not None:
        with pytest.raises(RenderingError):
            renderer.render(home_state())
        return
    states = [home_state(angle) for angle in (0.0, 0.5)]
    expected = [renderer.render(state) for state in states]
    with ThreadPoolExecutor(1) as one, ThreadPoolExecutor(1) as other:
        for thread in (one, other, one):
            np.testing.assert_array_equal(thread.submit(renderer.render, states[1]).result(), expected[1])
        np.testing.assert_array_equal(renderer.render(states[0]), expected[0])
        # Whoever is late waits.
        drawn = [thread.submit(renderer.render, state) for state in states for thread in (one, other)]
        for place, picture in enumerate(drawn):
            np.testing.assert_array_equal(picture.result(), expected[place // 2 % 2])
        other.submit(renderer.close).result()
        np.testing.assert_array_equal(one.submit(renderer.render, states[0]).result(), expected[0])
    np.testing.assert_array_equal(renderer.render(states[0]), expected[0])
