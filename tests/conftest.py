"""Settings of the whole suite."""

import os
from collections.abc import Iterator

import pytest
from hypothesis import settings
from page_layout import CHROMIUM
from playwright.sync_api import Browser, Playwright, sync_playwright

# Speeds of shared machines vary too much for deadlines. In CI the same examples are drawn every time, so
# that a red run can be repeated; at a desk new ones are looked for.
settings.register_profile("desk", deadline=None)
settings.register_profile("ci", deadline=None, derandomize=True)
settings.load_profile("ci" if os.environ.get("CI") else "desk")


@pytest.fixture(scope="session")
def engine() -> Iterator[Playwright]:
    """Drives browsers; there can be one of it in a process."""
    with sync_playwright() as started:
        yield started


@pytest.fixture(scope="session")
def browser(engine: Playwright) -> Iterator[Browser]:
    """Debian's Chromium, headless, that draws in 3D without a graphics card."""
    if CHROMIUM is None:
        pytest.skip("no chromium: apt-get install chromium")
    opened = engine.chromium.launch(
        executable_path=CHROMIUM,
        args=["--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"],
    )
    yield opened
    opened.close()
