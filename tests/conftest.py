"""Settings of the whole suite."""

import os
from collections.abc import Iterator

import pytest
from hypothesis import settings
from page_layout import CHROMIUM
from playwright.sync_api import Browser, Playwright, sync_playwright

from space_envs.evaluation.harness import policy_times
from space_envs.evaluation.replay import videos
from space_envs.evaluation.report import folder
from space_envs.system.opengl import trial_failure

# Speeds of shared machines vary too much for deadlines. In CI the same examples are drawn every time, so
# that a red run can be repeated; at a desk new ones are looked for.
settings.register_profile("desk", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "desk")


@pytest.fixture(scope="session")
def engine() -> Iterator[Playwright]:
    """Driver of browsers, at most one per process."""
    with sync_playwright() as started:
        yield started


@pytest.fixture(scope="session")
def browser(engine: Playwright) -> Iterator[Browser]:
    """Headless Chromium that draws in 3D without a graphics card."""
    if CHROMIUM is None:
        pytest.skip("no chromium: apt-get install chromium")
    opened = engine.chromium.launch(
        executable_path=CHROMIUM,
        args=["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
    )
    yield opened
    opened.close()


@pytest.fixture
def brief_reports(monkeypatch: pytest.MonkeyPatch) -> None:
    """Evaluations in this process time each policy once and here, draw no plots, and small videos."""
    monkeypatch.setattr(policy_times, "ROUNDS", 1)
    monkeypatch.setattr(policy_times, "elsewhere", lambda call: call[0](*call[1], **call[2]))
    monkeypatch.setattr(folder, "make_plots", lambda _, rows, *more: {row.task: [] for row in rows})
    monkeypatch.setattr(videos, "WIDTH", 160)
    monkeypatch.setattr(videos, "HEIGHT", 120)


@pytest.fixture
def fresh_trials() -> Iterator[None]:
    """Trials of OpenGL backends are made again during a test."""
    trial_failure.cache_clear()
    yield
    trial_failure.cache_clear()
